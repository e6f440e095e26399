// How the service does: what waits, what came out, and why not more.

import { html, nothing, render } from '../vendor/lit.js';
import { api, Problem } from '../api.js';
import { number, problemText, seconds, t, time } from '../texts.js';
import { failureText, reasonText } from '../parts/reasons.js';
import { light } from '../parts/verdict.js';
import { chart, legend, stepTable } from './dashboard/chart.js';

const HOUR_MS = 3_600_000;
const HOURS = { '24h': 24, '7d': 7 * 24, '30d': 30 * 24, '90d': 90 * 24 };
const MOST_STEPS = 1000;
const AGAIN_MS = 15_000;
const NARROWEST_PX = 320;

function chosenOf(search) {
  const given = new URLSearchParams(search);
  const span = given.get('span') in HOURS ? given.get('span') : '7d';
  const wanted = given.get('step') ?? (span === '24h' ? 'hour' : 'day');
  return { span, step: wanted === 'hour' && HOURS[span] < MOST_STEPS ? 'hour' : 'day' };
}

/** Shows the dashboard in `place`. */
export function show(place) {
  const stop = new AbortController();
  let chosen = chosenOf(location.search);
  let known = null;
  let timer;
  const draw = () => render(page(chosen, known, choose, Math.max(NARROWEST_PX, (place.clientWidth || innerWidth) - 40)), place);
  const load = async () => {
    clearTimeout(timer);
    const asked = chosen;
    const found = await read(chosen, stop.signal);
    if (stop.signal.aborted || asked !== chosen) return;
    known = found;
    draw();
    timer = setTimeout(load, AGAIN_MS);
  };
  const choose = (changed) => {
    const query = new URLSearchParams({ ...chosen, ...changed });
    chosen = chosenOf(`?${query}`);
    history.pushState(null, '', `/dashboard?${new URLSearchParams(chosen)}`);
    draw();
    load();
  };
  draw();
  load();
  addEventListener('resize', draw);
  return () => { stop.abort(); clearTimeout(timer); removeEventListener('resize', draw); };
}

async function read({ span, step }, signal) {
  const since = new Date(Date.now() - HOURS[span] * HOUR_MS).toISOString();
  const [statistics, health] = await Promise.all([
    api.get('/statistics', { query: { since, step }, signal }).catch((problem) => ({ problem })),
    fetch('/health/ready', { signal }).then((answer) => answer.json()).catch(() => ({ status: 'not ready', not_ready: {} })),
  ]);
  return { statistics, health, at: new Date().toISOString() };
}

function page(chosen, known, choose, width) {
  const select = (name, values) => html`<label class="choice"><span>${t(`dashboard.${name}`)}</span>
    <select name=${name} @change=${(event) => choose({ [name]: event.target.value })}>
      ${values.map((value) => html`<option value=${value} ?selected=${value === chosen[name]}>${t(`dashboard.${name}_${value}`)}</option>`)}</select></label>`;
  const steps = HOURS[chosen.span] < MOST_STEPS ? ['hour', 'day'] : ['day'];
  return html`<section class="page dashboard">
    <div class="dashboard-top"><h1>${t('dashboard.title')}</h1>${select('span', Object.keys(HOURS))}${select('step', steps)}
      <span class="quiet-text">${known ? t('dashboard.updated', { time: time(known.at, { timeStyle: 'medium' }) }) : nothing}</span></div>
    ${known ? html`${health(known.health)}${counted(known.statistics, width)}` : nothing}</section>`;
}

function health({ status, not_ready: parts = {} }) {
  const ready = status === 'ready';
  return html`<p class="readiness">${light(ready ? 'green' : 'red', { spoken: false })} ${t(ready ? 'dashboard.ready' : 'dashboard.not_ready')}
    ${Object.entries(parts).map(([part, why]) => html`<span class="fault">${part}: ${String(why)}</span>`)}</p>`;
}

function counted(statistics, width) {
  const { problem } = statistics;
  if (problem) {
    const missing = problem instanceof Problem && problem.status === 404;
    return html`<p role="alert">${missing ? t('dashboard.missing') : problemText(problem)}</p>`;
  }
  const all = (name) => statistics.steps.reduce((count, step) => count + step[name], 0);
  const hours = (new Date(statistics.until) - new Date(statistics.since)) / HOUR_MS;
  const oldest = statistics.oldest_queued_at;
  const figure = (value, text, address) => html`<div class="figure-of">
    <dt>${address ? html`<a href=${address}>${text}</a>` : text}</dt><dd>${value}</dd></div>`;
  const { since } = statistics;
  const counts = (name, items, text, address) => html`<section><h2>${t(`dashboard.${name}`)}</h2>${countTable(name, items, text, address)}</section>`;
  return html`
    <dl class="figures-of">
      ${figure(number(statistics.queued), t('dashboard.queued'), '/?status=queued')}
      ${figure(number(statistics.running), t('dashboard.running'), '/?status=running')}
      ${figure(oldest ? seconds((Date.now() - new Date(oldest)) / 1000) : '–', t('dashboard.oldest'))}
      ${figure(number(all('succeeded')), t('dashboard.oriented'))}
      ${figure(number(all('succeeded') / hours, 1), t('dashboard.per_hour'))}
      ${figure(statistics.seconds ? seconds(statistics.seconds.median) : '–', t('dashboard.median'))}
      ${figure(statistics.seconds ? seconds(statistics.seconds.p95) : '–', t('dashboard.p95'))}
    </dl>
    <h2>${t('dashboard.verdicts')}</h2>${legend()}${chart(statistics, width)}${stepTable(statistics)}
    <div class="by-count">
      ${counts('reasons', statistics.reasons, reasonText, (code) => `/?reason=${encodeURIComponent(code)}&since=${since}`)}
      ${counts('failures', statistics.failures, failureText, () => `/?status=failed&since=${since}`)}
      ${counts('decisions', ['accepted', 'rejected'].map((code) => ({ code, count: all(code) })),
        ({ code }) => t(`review.${code}`), (code) => `/?review=${code}&since=${since}`)}
    </div>`;
}

function countTable(name, items, text, address) {
  if (!items.some(({ count }) => count)) return html`<p class="quiet-text">${t('dashboard.none')}</p>`;
  const most = Math.max(...items.map(({ count }) => count));
  return html`<table class="count-table"><caption class="unseen">${t(`dashboard.${name}`)}</caption><tbody>${items.map((item) => html`<tr>
    <th scope="row"><a href=${address(item.code)}>${text(item)}</a></th>
    <td class="figure">${number(item.count)}</td>
    <td class="share"><svg viewBox="0 0 100 8" preserveAspectRatio="none" aria-hidden="true"><rect width=${(100 * item.count) / most} height="8"></rect></svg></td></tr>`)}</tbody></table>`;
}
