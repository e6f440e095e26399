// Uploading a control scene: its picture and what is said of it.

import { html, nothing } from '../../vendor/lit.js';
import { api } from '../../api.js';
import { notify } from '../../parts/notices.js';
import { faultOf, faultsOf, inputField } from '../../parts/fields.js';
import { number, problemText, t } from '../../texts.js';

/** What is kept of the form while the page is there. */
export const newScene = () => ({ file: undefined, preview: undefined, at_px: undefined, busy: false, error: undefined });

const POINTERS = ['/name', '/gsd_m', '/azimuth_of_image_up_deg', '/sigma_azimuth_deg', '/reference_px', '/reference', '/sigma_m'];

function request(form) {
  const value = (name) => form.elements[name].value.trim();
  const figure = (name) => Number(value(name));
  return {
    name: value('name'), gsd_m: figure('gsd_m'), azimuth_of_image_up_deg: figure('azimuth'),
    ...(value('sigma_azimuth') ? { sigma_azimuth_deg: figure('sigma_azimuth') } : {}),
    reference_px: [figure('px_x'), figure('px_y')],
    reference: { crs: value('crs'), coordinates: [figure('x'), figure('y'), figure('z')] }, sigma_m: figure('sigma_m'),
  };
}

async function send(state, form, { draw, done }) {
  const body = new FormData();
  body.append('file', state.file);
  body.append('scene', new Blob([JSON.stringify(request(form))], { type: 'application/json' }));
  Object.assign(state, { busy: true, error: undefined });
  draw();
  try {
    const scene = await api.post('/control-scenes', body);
    notify(t('control.scene_done', { name: scene.name }), 'done');
    forget(state);
    form.reset();
    done();
  } catch (error) {
    state.error = error;
  }
  state.busy = false;
  draw();
}

/** Forgets the picture that was chosen. */
export function forget(state) {
  if (state.preview) URL.revokeObjectURL(state.preview);
  Object.assign(state, newScene());
}

// a click into the preview gives the reference, in pixels of the file
function pick(state, draw) {
  return ({ target, offsetX, offsetY }) => {
    state.at_px = [offsetX * target.naturalWidth / target.clientWidth, offsetY * target.naturalHeight / target.clientHeight];
    draw();
  };
}

/** The form; `acts` are `{draw, done}`. */
export function sceneForm(state, acts) {
  const faults = faultsOf(state.error);
  const of = (pointer) => faultOf(faults, pointer);
  const known = state.error
    && [...faults.keys()].some((at) => POINTERS.some((pointer) => at === pointer || at.startsWith(`${pointer}/`)));
  const take = (event) => {
    const [file] = event.target.files;
    forget(state);
    if (file) Object.assign(state, { file, preview: URL.createObjectURL(file) });
    acts.draw();
  };
  const submit = (event) => { event.preventDefault(); if (state.file) send(state, event.target, acts); };
  const figure = { type: 'number', step: 'any', required: true };
  return html`<form class="control-form" @submit=${submit}>
    <label class="drop field-wide"><span>${state.file ? state.file.name
      : t('control.scene_file')}</span><input type="file" name="file" accept="image/jpeg,image/png,image/tiff"
        @change=${take}></label>
    ${state.preview ? html`<figure class="field-wide scene-picture"><img class="pick" src=${state.preview}
      alt=${t('control.scene_preview')} @click=${pick(state, acts.draw)}>
      <figcaption class="quiet-text">${state.at_px ? t('control.picked',
        { x: number(state.at_px[0], 1), y: number(state.at_px[1], 1) }) : t('control.pick')}</figcaption></figure>` : nothing}
    ${inputField(t('control.name'), 'name', of('/name'), { required: true, wide: true })}
    ${inputField(`${t('control.gsd')} (m)`, 'gsd_m', of('/gsd_m'), figure)}
    ${inputField(`${t('control.sigma')} (m)`, 'sigma_m', of('/sigma_m'), figure)}
    ${inputField(`${t('control.azimuth')} (°)`, 'azimuth', of('/azimuth_of_image_up_deg'), { ...figure, value: 0 })}
    ${inputField(`${t('control.sigma_azimuth')} (°)`, 'sigma_azimuth', of('/sigma_azimuth_deg'), { type: 'number', step: 'any' })}
    ${inputField(`${t('control.reference_px')} x`, 'px_x', of('/reference_px'),
      { ...figure, value: state.at_px?.[0].toFixed(1) ?? '' })}
    ${inputField(`${t('control.reference_px')} y`, 'px_y', undefined, { ...figure, value: state.at_px?.[1].toFixed(1) ?? '' })}
    ${inputField(t('control.crs'), 'crs', of('/reference/crs'), { value: 'EPSG:4979', required: true, wide: true })}
    <div class="field-wide three">${['x', 'y', 'z'].map((axis) => inputField(t(`control.coordinate_${axis}`), axis, axis === 'x'
      ? of('/reference/coordinates') : undefined, figure))}</div>
    <div class="field-wide"><button type="submit" class="main" ?disabled=${!state.file
      || state.busy}>${t('control.upload')}</button></div></form>
    ${state.error && !known ? html`<p class="fault" role="alert">${problemText(state.error)}</p>` : nothing}`;
}
