// The images of an upload: how far each one is, where it was taken, and what was found.

import { html, nothing, repeat } from '../../vendor/lit.js';
import { bytes, number, percent, problemText, t } from '../../texts.js';
import { failureText, reasonText } from '../../parts/reasons.js';
import { verdict } from '../../parts/verdict.js';
import { isGeographic } from './settings.js';
import { ended } from './watch.js';

function button(key, sign, name, pressed) {
  const label = t(`upload.${key}_button`, { name });
  return html`<button type="button" class="quiet sign" aria-label=${label} title=${label} @click=${pressed}>${sign}</button>`;
}

function sending(entry, work) {
  const { state, sent, file, name } = entry;
  const share = file.size ? sent / file.size : 0;
  const controls = {
    waiting: ['pause', 'remove'], sending: ['pause', 'remove'], paused: ['resume', 'remove'], failed: ['retry', 'remove'],
    new: ['remove'], unlisted: ['remove'],
  }[state] ?? [];
  const signs = { pause: '❚❚', resume: '▶', retry: '↻', remove: '✕' };
  const act = { pause: () => work.pause(entry), resume: () => work.resume(entry), retry: () => work.resume(entry), remove: () => work.remove(entry) };
  const moves = ['waiting', 'sending', 'paused'].includes(state);
  return html`<div class="sending"><div>
      <span>${t(`upload.state_${state}`)}${moves && sent ? ` ${percent(share)}` : ''}${entry.resumed && moves ? ` · ${t('upload.resumed')}` : ''}</span>
      ${moves ? html`<progress max="1" .value=${share} aria-label=${t('upload.progress', { name })}></progress>` : nothing}
      ${entry.problem ? html`<span class="fault">${name}: ${problemText(entry.problem)}</span>` : nothing}
    </div>${controls.map((key) => button(key, signs[key], name, act[key]))}</div>`;
}

function camera(entry, work) {
  const { image } = entry;
  const found = work.cameraOf(entry);
  const size = `${image.width_px} × ${image.height_px}`;
  return html`<span class="two-lines"><span class=${found ? '' : 'fault'}>${found?.name ?? t('upload.camera_none', { size })}</span>
    <span class="quiet-text">${image.camera_model ?? size}</span></span>`;
}

function position(entry, work) {
  const { image, typed, editing } = entry;
  if (work.list) return html`<span class="quiet-text">${t('upload.position_list')}</span>`;
  const lacks = work.lacks(entry);
  if (image.position && !editing && !typed) {
    const [longitude, latitude] = image.position.coordinates;
    const height = image.position.height_above_geoid_m;
    return html`<span class="two-lines"><span>${number(longitude, 5, { exactly: true })}° ${number(latitude, 5, { exactly: true })}°
        ${height === undefined || height === null ? '' : ` ${number(height, 0)} m`}</span>
      <span class="quiet-text">${t('upload.position_exif')}
        ${entry.orientation ? nothing : html`<button type="button" class="quiet link" @click=${() => { entry.editing = true; work.tell(); }}>
          ${t('upload.position_change')}<span class="unseen"> (${t('upload.position_of', { name: entry.name })})</span></button>`}</span></span>`;
  }
  const wrong = lacks === 'position' || lacks === 'typed';
  const hint = t(isGeographic(work.settings.crs) ? 'upload.position_hint_geographic' : 'upload.position_hint');
  const changed = (event) => { Object.assign(entry, { typed: event.target.value, fault: null, key: null }); work.tell(); };
  return html`<label class="typed"><span class="unseen">${t('upload.position_of', { name: entry.name })}</span>
    <input .value=${typed} placeholder=${hint} autocomplete="off" ?disabled=${entry.orientation !== null}
      aria-invalid=${wrong ? 'true' : 'false'} @input=${changed}></label>
    ${wrong ? html`<span class="fault">${t(`upload.lacks_${lacks}`)}</span>` : nothing}`;
}

function result(entry) {
  const { orientation, fault, name } = entry;
  if (fault) return html`<span class="fault" role="alert">${name}: ${problemText(fault)}</span>`;
  if (!orientation) return nothing;
  const link = (inside) => html`<a class="result-link" href="/orientations/${orientation.id}">${inside}</a>`;
  if (!ended(orientation)) {
    const running = orientation.status === 'running';
    return html`<span class="running">${link(running && orientation.stage ? t(`stage.${orientation.stage}`) : t(`status.${orientation.status}`))}
      ${running ? html`<progress max="1" .value=${orientation.progress} aria-label=${t('queue.progress', { name })}></progress>` : nothing}</span>`;
  }
  if (orientation.status !== 'succeeded') {
    return html`<span class="two-lines"><span>${link(t(`status.${orientation.status}`))}</span>
      <span class="fault">${orientation.error ? failureText(orientation.error) : ''}</span></span>`;
  }
  const [reason] = orientation.result?.diagnosis?.reasons ?? [];
  return html`<span class="two-lines"><span>${link(verdict(orientation.verdict))}</span>
    ${reason ? html`<span class="quiet-text" title=${reason.detail}>${reasonText(reason)}</span>` : nothing}</span>`;
}

function row(entry, work) {
  const { file, name, image } = entry;
  return html`<tr>
    <th scope="row"><span class="two-lines"><span title=${name}>${name}</span><span class="quiet-text">${bytes(file.size)}</span></span></th>
    <td>${sending(entry, work)}</td>
    <td>${image ? camera(entry, work) : nothing}</td>
    <td>${image ? position(entry, work) : nothing}</td>
    <td>${result(entry)}</td></tr>`;
}

/** The table of all entries. */
export function table(work) {
  return html`<table class="uploads"><caption class="unseen">${t('upload.table')}</caption>
    <thead><tr>${['image', 'upload', 'camera', 'position', 'result'].map((name) => html`<th scope="col">${t(`upload.column_${name}`)}</th>`)}</tr></thead>
    <tbody>${repeat(work.entries, (entry) => entry, (entry) => row(entry, work))}</tbody></table>`;
}
