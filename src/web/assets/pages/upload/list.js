// The list of a flight: names of images with their positions. It makes a block, of which the service reads it.

import { html, nothing } from '../../vendor/lit.js';
import { api, pages, Problem } from '../../api.js';
import { problemText, t } from '../../texts.js';
import { blockQuery } from './settings.js';

const TYPES = { csv: 'text/csv', tsv: 'text/csv', geojson: 'application/geo+json', json: 'application/geo+json', txt: 'text/plain' };

/** The kind of list that a file is by its name, as `{type}`, or undefined if it is none. */
export function listOf({ name }) {
  const type = TYPES[name.split('.').pop().toLowerCase()];
  return type && { type };
}

/** Gives a list to the service: `block`, and the `names` of its images by their lower-case form. */
export async function postList(list, settings, camera) {
  const query = new URLSearchParams(blockQuery(settings, camera));
  const block = await api.post(`/blocks?${query}`, await list.file.text(), { type: list.type });
  const names = new Map();
  for await (const items of pages(`/blocks/${block.id}/images`)) items.forEach(({ name }) => names.set(name.toLowerCase(), name));
  return { block, names, problem: null };
}

/** What is wrong with a list, as `{text, faults}`: faults are those of single lines. */
export function listProblem(error) {
  const faults = error instanceof Problem ? error.errors.map(({ pointer, detail }) => `${pointer}: ${detail}`) : [];
  return { text: faults.length ? error.title : problemText(error), faults };
}

/** The list as a line above the images. */
export function listLine(list, entries, drop) {
  const { block, names, problem, file } = list;
  const here = new Set(entries.map(({ name }) => name.toLowerCase()));
  const missing = names ? [...names.keys()].filter((name) => !here.has(name)).length : 0;
  return html`<div class="list-line ${problem ? 'bad' : ''}">
    <strong>${t('upload.list', { name: file.name })}</strong>
    ${block
      ? html`<span>${t('upload.list_images', { count: names.size })}${missing ? ` · ${t('upload.list_missing', { count: missing })}` : ''}</span>
          <a href="/?block=${block.id}">${t('upload.list_block', { name: block.name })}</a>`
      : html`<span class="quiet-text">${t('upload.list_hint')}</span>
          <button type="button" class="quiet" @click=${drop}>${t('upload.list_drop')}</button>`}
    ${problem ? html`<div class="fault" role="alert">${problem.text}
      ${problem.faults.length ? html`<ul>${problem.faults.map((fault) => html`<li>${fault}</li>`)}</ul>` : nothing}</div>` : nothing}
    ${(block?.warnings ?? []).map(({ detail }) => html`<div class="quiet-text">${detail}</div>`)}
    ${block?.ignored_columns?.length ? html`<div class="quiet-text">${t('upload.list_ignored', { names: block.ignored_columns.join(', ') })}</div>` : nothing}
  </div>`;
}
