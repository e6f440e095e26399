// How much there is to do: yellow ones that nobody has decided about, and what the service is working on.

import { html } from '../../vendor/lit.js';
import { api } from '../../api.js';
import { number, t } from '../../texts.js';
import { light } from '../../parts/verdict.js';

const HOUR_MS = 3_600_000;

/** The counts; what cannot be had is left out. */
export async function counts(signal) {
  const since = new Date(Date.now() - HOUR_MS).toISOString();
  const statistics = await api.get('/statistics', { query: { since, step: 'hour' }, signal }).catch(() => null);
  return { open: statistics?.doubtful, running: statistics?.running, queued: statistics?.queued };
}

/** The counts as links to those that are counted. */
export function counters(known) {
  const counter = (name, search, sign) => html`<a class="counter" href="/?${search}" data-counter=${name}>${sign}<strong>${
    number(known[name])}</strong> ${t(`queue.counter_${name}`)}</a>`;
  return html`<div class="counters">
    ${counter('open', 'verdict=yellow&review=open', light('yellow', { spoken: false }))}
    ${counter('running', 'status=running', '')}${counter('queued', 'status=queued', '')}</div>`;
}
