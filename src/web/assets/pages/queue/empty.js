// What stands in place of rows where there are none.

import { html } from '../../vendor/lit.js';
import { api } from '../../api.js';
import { problemText, t } from '../../texts.js';

/** What a service needs before it can orient anything: which of it is there. */
export async function beginnings() {
  const has = (path) => api.get(path, { query: { limit: 1 } }).then(({ items }) => items.length > 0, () => false);
  const [points, scenes] = await Promise.all([has('/control-points'), has('/control-scenes')]);
  return { control: points || scenes };
}

/** Nothing was ever oriented: what to do first. `known` is what `beginnings` has found, or null. */
export function nothingYet(known) {
  const step = (name, address, done) => html`<li class=${done ? 'done' : ''}>
    <a href=${address}>${t(`queue.first_${name}`)}</a> <span class="quiet-text">${done ? t('queue.first_done') : t(`queue.first_${name}_text`)}</span></li>`;
  return html`<div class="nothing"><h2>${t('queue.first_title')}</h2><ol>
    ${step('control', '/control', known?.control)}${step('upload', '/upload', false)}${step('look', '/help', false)}</ol></div>`;
}

/** The filters leave nothing. */
export function nothingFound(clear) {
  return html`<div class="nothing"><p>${t('queue.none')}</p><button type="button" @click=${clear}>${t('queue.clear')}</button></div>`;
}

/** The list cannot be had. */
export function failed(error, again) {
  return html`<div class="nothing" role="alert"><p>${problemText(error)}</p><button type="button" @click=${again}>${t('queue.again')}</button></div>`;
}
