// What all images of an upload have in common.

import { html, nothing } from '../../vendor/lit.js';
import { t } from '../../texts.js';
import { parseThree } from './position.js';

/** As a fresh page has them: all left to the service. */
export const fresh = () => ({
  camera: '', tolerance: '10', tolerance_unit: 'gsd', crs: 'EPSG:4979', undulation: '', sigma_position: '', sigma_tilt: '',
  kappa: '', sigma_kappa: '', control: '', output_crs: '', block: '', angles: 'deg', priority: 'normal',
});

/** Whether positions in this CRS are longitude and latitude. */
export const isGeographic = (crs) => /^EPSG:(4326|4979|4258)$|\+proj=longlat/.test(crs.trim());

const numberOf = (text) => (text.trim() ? Number(text.trim().replace(',', '.')) : undefined);
const given = (fields) => Object.fromEntries(Object.entries(fields).filter(([, value]) => value !== undefined && value !== '' && value !== null));

/** The body of `POST /orientations` for an image; `coordinates` is a position that was typed. */
export function orientationRequest(settings, { image, camera, coordinates }) {
  const undulation = numberOf(settings.undulation);
  const vertical = undulation === undefined ? {} : { vertical: { geoid_undulation_m: undulation } };
  const approximation = given({
    position: coordinates && { crs: settings.crs, coordinates, ...vertical },
    ...(coordinates ? {} : vertical),
    sigma_position_m: settings.sigma_position.trim() ? parseThree(settings.sigma_position) : undefined,
    sigma_tilt_deg: numberOf(settings.sigma_tilt), kappa_deg: numberOf(settings.kappa), sigma_kappa_deg: numberOf(settings.sigma_kappa),
  });
  return given({
    image, camera, approximation, [`tolerance_${settings.tolerance_unit}`]: numberOf(settings.tolerance),
    control: settings.control, output_crs: settings.output_crs.trim(), priority: settings.priority,
  });
}

/** The query of `POST /blocks`. */
export function blockQuery(settings, camera) {
  const sigma = settings.sigma_position.trim() ? parseThree(settings.sigma_position)?.join(',') : undefined;
  return given({
    name: settings.block.trim(), camera, crs: settings.crs, geoid_undulation_m: numberOf(settings.undulation), angles: settings.angles,
    sigma_position_m: sigma, sigma_tilt_deg: numberOf(settings.sigma_tilt), sigma_kappa_deg: numberOf(settings.sigma_kappa),
    [`tolerance_${settings.tolerance_unit}`]: numberOf(settings.tolerance),
    control: settings.control, output_crs: settings.output_crs.trim(), priority: settings.priority,
  });
}

// which field a pointer of the service is about: that of an orientation, or `?name` of a block
const POINTERS = {
  tolerance: /tolerance_/, crs: /position\/crs|^\?crs/, undulation: /undulation/, sigma_position: /sigma_position/, sigma_tilt: /sigma_tilt/,
  kappa: /\/kappa_deg/, sigma_kappa: /sigma_kappa/, control: /control$/, output_crs: /output_crs/, block: /^\?name/, camera: /camera$/,
};

/** The fault that the service found with a field, out of `errors` (`[{pointer, detail}]`). */
export function faultOf(name, errors) {
  return errors.find(({ pointer }) => POINTERS[name]?.test(pointer))?.detail;
}

/**
 * The form. `change` is given what changes, `addCamera` is called for a new one; with a list of positions (`hasList`)
 * there is a block to be named, and a heading is that of the list.
 */
export function settingsForm({ settings, cameras, errors, hasList, change, addCamera, mayAdd }) {
  const wrap = (name, label, inside) => {
    const fault = faultOf(name, errors);
    return html`<div class="field"><label for="set-${name}">${label}</label>${inside(fault ? 'true' : 'false')}
      ${fault ? html`<span class="fault" id="fault-${name}">${fault}</span>` : nothing}</div>`;
  };
  const set = (name) => (event) => change({ [name]: event.target.value });
  const text = (name, { hint = '', mode = 'decimal' } = {}) => wrap(name, t(`upload.${name}`), (bad) => html`
    <input id="set-${name}" .value=${settings[name]} placeholder=${hint || nothing} inputmode=${mode} autocomplete="off" aria-invalid=${bad}
      aria-describedby=${bad === 'true' ? `fault-${name}` : nothing} @change=${set(name)}>`);
  const select = (name, options) => wrap(name, t(`upload.${name}`), (bad) => html`
    <select id="set-${name}" aria-invalid=${bad} @change=${set(name)}>
      ${options.map(([value, word]) => html`<option value=${value} ?selected=${value === settings[name]}>${word}</option>`)}</select>`);
  const words = (name, values) => values.map((value) => [value, t(`upload.${name}_${value || 'any'}`)]);
  return html`<form class="settings" aria-label=${t('upload.settings')} @submit=${(event) => event.preventDefault()}>
    ${select('camera', [['', t('upload.camera_auto')], ...cameras.map(({ id, name }) => [id, name])])}
    ${mayAdd ? html`<button type="button" class="quiet link" @click=${addCamera}>${t('upload.camera_new')}</button>` : nothing}
    <div class="in-row">${text('tolerance')}${select('tolerance_unit', words('tolerance_unit', ['gsd', 'm']))}</div>
    ${hasList ? text('block', { mode: 'text' }) : nothing}
    ${text('crs', { mode: 'text' })}
    <details><summary>${t('upload.more')}</summary>
      ${text('undulation')}
      ${text('sigma_position', { hint: '15; 15; 30', mode: 'text' })}
      <div class="in-row">${text('sigma_tilt', { hint: '5' })}${text('sigma_kappa', { hint: '15' })}</div>
      ${hasList ? select('angles', words('angles', ['deg', 'gon'])) : text('kappa', { hint: t('upload.kappa_hint') })}
      ${select('control', words('control', ['', 'lines', 'scenes', 'both']))}
      ${text('output_crs', { mode: 'text', hint: settings.crs })}
      ${select('priority', words('priority', ['high', 'normal', 'low']))}
    </details>
  </form>`;
}
