// What is known of one control point or one scene.

import { html, nothing } from '../../vendor/lit.js';
import { api } from '../../api.js';
import { number, percent, t, time } from '../../texts.js';
import { figures, heading } from '../result/figures.js';
import { classOf, healthSign } from './health.js';

function place([longitude, latitude, height]) {
  return html`${number(longitude, 7, { exactly: true })}° · ${number(latitude, 7, { exactly: true })}° · ${number(height, 2,
    { exactly: true })} m`;
}

/** A control point: its feature, and what the API says of its health. */
export function pointPanel(feature, health, { mayDelete, remove, close }) {
  const { name, set, use, valid_from, valid_to, sigma_m, reference } = feature.properties;
  const known = health ?? feature.properties.health;
  return html`${heading(name, html`<button type="button" class="quiet small" @click=${close}>${t('control.back')}</button>`)}
    <p class="health-line">${healthSign(classOf(known))}</p>
    ${health?.detail ? html`<p class="quiet-text">${health.detail}</p>` : nothing}
    ${known ? figures([
      [t('control.seen_in'), number(known.seen_in, 0)], [t('control.found'), number(known.found, 0)],
      [t('control.missed'), number(known.missed, 0)], [t('control.contradicts'), number(known.contradicts, 0)],
      [t('control.probability'), health?.probability_if_sound === undefined ? undefined : percent(health.probability_if_sound, 2)],
      [t('control.usual'), health?.usually_found_share === undefined ? undefined : percent(health.usually_found_share, 1)],
      [t('control.last_found'), known.last_found_at ? time(known.last_found_at) : undefined],
      [t('control.last_failed'), known.last_failed_at ? time(known.last_failed_at) : undefined],
    ]) : nothing}
    ${figures([[t('control.reference'), place(reference)], [t('control.sigma'), `${number(sigma_m, 4)} m`],
      [t('control.lines'), number(feature.geometry.coordinates.length, 0)], [t('control.set'), set],
      [t('control.use'), use && t(`control.use_${use}`)], [t('control.valid_from'), valid_from],
      [t('control.valid_to'), valid_to]])}
    ${mayDelete ? html`<button type="button" class="danger small" @click=${remove}>${t('control.delete')}</button>` : nothing}`;
}

/** A control scene. */
export function scenePanel(scene, { mayDelete, remove, close }) {
  return html`${heading(scene.name, html`<button type="button" class="quiet small" @click=${close}>${t('control.back')}</button>`)}
    <figure class="scene-picture"><img src=${api.address(`/control-scenes/${scene.id}/picture`)}
      alt=${t('control.scene_picture', { name: scene.name })}></figure>
    ${figures([
      [t('control.reference'), place(scene.reference.coordinates)], [t('control.reference_px'),
        scene.reference_px.map((value) => number(value, 1)).join(' · ')],
      [t('control.gsd'), `${number(scene.gsd_m, 4)} m`], [t('control.size'),
        `${number(scene.width_px, 0)} × ${number(scene.height_px, 0)} px`],
      [t('control.azimuth'), `${number(scene.azimuth_of_image_up_deg, 2)}° ± ${number(scene.sigma_azimuth_deg, 2)}°`],
      [t('control.sigma'), `${number(scene.sigma_m, 4)} m`], [t('control.updated'), time(scene.updated_at)],
    ])}
    ${mayDelete ? html`<button type="button" class="danger small" @click=${remove}>${t('control.delete')}</button>` : nothing}`;
}
