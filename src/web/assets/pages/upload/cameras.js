// Which camera has taken an image, and a form for a new one.

import { html } from '../../vendor/lit.js';
import { api, Problem } from '../../api.js';
import { problemText, t } from '../../texts.js';
import { openDialog } from '../../parts/dialog.js';

const words = (text) => (text ?? '').toLowerCase().match(/[a-z]+|\d+/g) ?? [];

function likeness(camera, model) {
  const named = new Set(words(camera.name));
  return words(model).filter((word) => named.has(word)).length;
}

/**
 * The camera of an image by its size; of several the one whose name resembles what the image says of its camera, then
 * the newest. Undefined if there is none.
 */
export function recognised(image, cameras) {
  const fits = ({ image_size_px: size }) => size?.[0] === image.width_px && size[1] === image.height_px;
  const better = (a, b) => likeness(b, image.camera_model) - likeness(a, image.camera_model) || (b.created_at > a.created_at ? 1 : -1);
  return cameras.filter(fits).sort(better)[0];
}

const COEFFICIENTS = ['k1', 'k2', 'k3', 'p1', 'p2', 'b1_px', 'b2_px'];

function requestOf(form) {
  const value = (name) => Number(form.elements[name].value.trim().replace(',', '.'));
  const [width, height] = [value('width'), value('height')];
  const middle = (name, size) => (form.elements[name].value.trim() ? value(name) : size / 2);
  return {
    name: form.elements.name.value.trim(), image_size_px: [width, height],
    principal_distance_px: value('principal_distance_px'),
    principal_point_px: [middle('x0', width), middle('y0', height)],
    distortion: { model: 'brown', ...Object.fromEntries(COEFFICIENTS.map((name) => [name, value(name)])) },
  };
}

// the field of the form that a pointer of the service is about
const FIELDS = [[/^\/name/, 'name'], [/^\/image_size_px\/1/, 'height'], [/^\/image_size_px/, 'width'], [/^\/principal_point_px\/1/, 'y0'],
  [/^\/principal_point_px/, 'x0'], [/^\/principal_distance_px/, 'principal_distance_px'], [/^\/distortion\/(\w+)/, null]];

function fieldOf(pointer) {
  for (const [pattern, name] of FIELDS) {
    const match = pattern.exec(pointer);
    if (match) return name ?? match[1];
  }
  return undefined;
}

function showFaults(form, error) {
  form.querySelectorAll('[aria-invalid]').forEach((field) => field.removeAttribute('aria-invalid'));
  form.querySelector('.fault').textContent = problemText(error);
  const fields = error instanceof Problem ? error.errors.map(({ pointer }) => form.elements[fieldOf(pointer)]).filter(Boolean) : [];
  fields.forEach((field) => field.setAttribute('aria-invalid', 'true'));
  fields[0]?.focus();
}

/** Asks for a new camera, of images of this size if it is given; resolves with it, or undefined. */
export function newCamera({ name = '', size = [] } = {}) {
  const field = (key, { value = '', required = true, text = false } = {}) => html`<label class="field"><span>${t(`upload.camera_${key}`)}</span>
    <input name=${key} .value=${String(value)} ?required=${required} inputmode=${text ? 'text' : 'decimal'} autocomplete="off"></label>`;
  return openDialog(t('upload.camera_new'), (close) => {
    const submit = async (event) => {
      event.preventDefault();
      const form = event.target;
      try {
        close(await api.post('/cameras', requestOf(form)));
      } catch (error) {
        showFaults(form, error);
      }
    };
    return html`<form class="camera-form" @submit=${submit}>
      ${field('name', { value: name, text: true })}
      <div class="in-row">${field('width', { value: size[0] ?? '' })}${field('height', { value: size[1] ?? '' })}</div>
      <div class="in-row">${field('principal_distance_px')}${field('x0', { required: false })}${field('y0', { required: false })}</div>
      <p class="quiet-text">${t('upload.camera_hint')}</p>
      <div class="in-row">${COEFFICIENTS.map((key) => field(key, { value: 0 }))}</div>
      <p class="fault" role="alert"></p>
      <div class="dialog-buttons"><button type="button" @click=${() => close()}>${t('dialog.cancel')}</button>
        <button type="submit" class="main">${t('upload.camera_save')}</button></div>
    </form>`;
  });
}
