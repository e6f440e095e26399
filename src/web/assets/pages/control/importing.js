// Importing control points: GeoJSON, a building model or a GeoPackage, what it is in, and what became of each feature.

import { html, nothing } from '../../vendor/lit.js';
import { api } from '../../api.js';
import { confirm } from '../../parts/dialog.js';
import { faultOf, faultsOf, inputField } from '../../parts/fields.js';
import { number, problemText, t } from '../../texts.js';
import { heading } from '../result/figures.js';
import { csv, download } from './csv.js';

const CRS = 'gable.control_crs';
const SET = 'gable.control_set';
const MODES = ['upsert', 'insert', 'replace'];
const USES = ['control', 'check'];
const SHOWN = 200;
const ACCEPTED = '.geojson,.json,.jsonl,.gml,.xml,.gpkg';
const FIRST_BYTES = 4096;
const TYPES = { gml: 'application/gml+xml', xml: 'application/gml+xml', jsonl: 'application/city+json-seq',
  gpkg: 'application/geopackage+sqlite3' };

/** What a file is, by the end of its name; JSON may be a building model, and says so. */
async function typeOf(file) {
  const known = TYPES[file.name.split('.').at(-1).toLowerCase()];
  if (known) return known;
  const first = await file.slice(0, FIRST_BYTES).text();
  return /"CityJSON"/.test(first) ? 'application/city+json' : 'application/geo+json';
}

/** What is kept of an import while the page is there. */
export const newImport = () => ({ file: undefined, busy: false, report: undefined, error: undefined });

async function send(state, form, { draw, done }) {
  const { crs, mode, geoid, set, use } = Object.fromEntries(new FormData(form));
  if (mode === 'replace') {
    const title = t('control.replace');
    const sure = await confirm({ title, text: t('control.replace_text'), yes: title, danger: true });
    if (!sure) return;
  }
  localStorage.setItem(CRS, crs);
  localStorage.setItem(SET, set);
  Object.assign(state, { busy: true, report: undefined, error: undefined });
  draw();
  try {
    const query = { crs: crs.trim(), mode, geoid_undulation_m: geoid, set: set.trim(), use };
    state.report = await api.post('/control-points', state.file, { query, type: await typeOf(state.file) });
    state.file = undefined;
    done();
  } catch (error) {
    state.error = error;
  }
  state.busy = false;
  draw();
}

function rejectedTable(rejected) {
  const save = () => download('rejected.csv',
    csv([['index', 'name', 'detail'], ...rejected.map(({ index, name, detail }) => [index, name, detail])]), 'text/csv');
  return html`<div class="wide" tabindex="0" role="region" aria-label=${t('control.rejected')}>
    <table class="figure-table rejected"><thead><tr><th scope="col" class="figure">${t('control.index')}</th>
      <th scope="col">${t('control.name')}</th><th scope="col">${t('control.reason')}</th></tr></thead>
      <tbody>${rejected.slice(0, SHOWN).map(({ index, name, detail }) => html`<tr><td class="figure">${number(index, 0)}</td>
        <th scope="row">${name ?? '–'}</th><td class="detail">${detail}</td></tr>`)}</tbody></table></div>
    ${rejected.length > SHOWN ? html`
      <p class="quiet-text">${t('control.more_rejected', { count: number(rejected.length - SHOWN) })}</p>` : nothing}
    <button type="button" class="small" @click=${save}>${t('control.csv')}</button>`;
}

function report({ imported, updated, rejected, rejected_count }) {
  return html`<div role="status">${heading(t('control.report'))}
    <p class="report-counts"><span><strong>${number(imported,
      0)}</strong> ${t('control.imported')}</span><span><strong>${number(updated, 0)}</strong> ${t('control.updated_count')}</span>
      <span class=${rejected_count ? 'fault' : ''}><strong>${number(rejected_count,
        0)}</strong> ${t('control.rejected')}</span></p></div>
    ${rejected.length ? rejectedTable(rejected) : nothing}`;
}

/** The form and the report. `acts`: `{draw, done}`, the latter called when the control has changed. */
export function importing(state, acts) {
  const faults = faultsOf(state.error);
  const take = (event) => {
    Object.assign(state, { file: event.target.files[0], report: undefined, error: undefined });
    event.target.value = '';
    acts.draw();
  };
  const submit = (event) => { event.preventDefault(); if (state.file) send(state, event.target, acts); };
  const named = ['?crs', '?geoid_undulation_m', '?mode', '?set'].some((pointer) => faults.has(pointer));
  return html`<form class="control-form" @submit=${submit}>
    <label class="drop field-wide"><span>${state.file ? state.file.name : t('control.drop')}</span>
      <input type="file" name="file" accept=${ACCEPTED} @change=${take}></label>
    ${inputField(t('control.crs'), 'crs', faultOf(faults, '?crs'), { value: localStorage.getItem(CRS) ?? '',
      wide: true, hint: t('control.crs_hint') })}
    ${inputField(t('control.set'), 'set', faultOf(faults, '?set'), { value: localStorage.getItem(SET) ?? '',
      hint: t('control.set_hint') })}
    <label class="field"><span>${t('control.use')}</span><select name="use">${USES.map((use) => html`
      <option value=${use}>${t(`control.use_${use}`)}</option>`)}</select></label>
    <label class="field"><span>${t('control.mode')}</span><select name="mode">${MODES.map((mode) => html`
      <option value=${mode}>${t(`control.mode_${mode}`)}</option>`)}</select></label>
    ${inputField(t('control.geoid'), 'geoid', faultOf(faults, '?geoid_undulation_m'), { type: 'number', step: 'any' })}
    <div class="field-wide"><button type="submit" class="main" ?disabled=${!state.file || state.busy}>${state.busy
      ? html`<span class="busy" aria-hidden="true"></span>${t('control.importing')}` : t('control.import')}</button></div>
    </form>
    ${state.error && !named ? html`<p class="fault" role="alert">${problemText(state.error)}</p>` : nothing}
    ${state.report ? report(state.report) : nothing}`;
}
