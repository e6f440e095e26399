// Which orientations are shown. The choice lives in the query of the address, so that it can be sent to a colleague and
// the back button undoes it.

import { html, live, nothing } from '../../vendor/lit.js';
import { t, time } from '../../texts.js';
import { REASONS, reasonText } from '../../parts/reasons.js';

const OF_API = ['q', 'verdict', 'status', 'review', 'reason', 'camera', 'block', 'since', 'until'];
const ALL = [...OF_API, 'time'];
const HOURS = { '24h': 24, '7d': 7 * 24, '30d': 30 * 24 };
const HOUR_MS = 3_600_000;

/** The filters in the query of an address. */
export function filtersOf(search) {
  const given = new URLSearchParams(search);
  return Object.fromEntries(ALL.map((name) => [name, given.get(name)]).filter(([, value]) => value));
}

/** The query of an address for filters, with its question mark if there is any. */
export function searchOf(filters) {
  const text = new URLSearchParams(ALL.filter((name) => filters[name]).map((name) => [name, filters[name]])).toString();
  return text && `?${text}`;
}

/** The same for the API: a span that counts from now becomes a time. */
export function queryOf(filters) {
  const query = Object.fromEntries(OF_API.map((name) => [name, filters[name]]).filter(([, value]) => value));
  const hours = HOURS[filters.time];
  return hours ? { ...query, since: new Date(Date.now() - hours * HOUR_MS).toISOString() } : query;
}

/** Whether any filter is set. */
export const isFiltered = (filters) => ALL.some((name) => filters[name]);

// options are [value, text]; a value that is none of them is one nevertheless, as it may come with an address
function choice(name, filters, options, change) {
  const value = filters[name] ?? '';
  const all = !value || options.some(([known]) => known === value) ? options : [...options, [value, value]];
  return html`<label class="filter"><span>${t(`queue.${name}`)}</span>
    <select data-filter=${name} class=${value ? 'set' : ''} @change=${(event) => change({ [name]: event.target.value })}>
      <option value="" ?selected=${!value}>${t('queue.any')}</option>
      ${all.map(([key, text]) => html`<option value=${key} ?selected=${key === value}>${text}</option>`)}
    </select></label>`;
}

function timeChoice(filters, change) {
  const exact = filters.since || filters.until;
  const style = { dateStyle: 'short', timeStyle: 'short' };
  const options = Object.keys(HOURS).map((key) => [key, t(`queue.time_${key}`)]);
  if (exact) options.push(['exact', `${filters.since ? time(filters.since, style) : ''} – ${filters.until ? time(filters.until, style) : ''}`]);
  const chosen = (changed) => changed.time !== 'exact' && change({ ...changed, since: '', until: '' });
  return choice('time', exact ? { time: 'exact' } : filters, options, chosen);
}

/** The bar of filters; `change` is given what changes, `lists` has the `cameras` and `blocks` to choose from. */
export function filterBar(filters, lists, change) {
  const named = (items) => items.map(({ id, name }) => [id, name]);
  const words = (names, section) => names.map((name) => [name, t(`${section}.${name}`)]);
  return html`<form class="filters" role="search" aria-label=${t('queue.filters')} @submit=${(event) => event.preventDefault()}>
    <label class="filter filter-text"><span>${t('queue.q')}</span>
      <input type="search" data-filter="q" maxlength="200" placeholder=${t('queue.q_hint')} .value=${live(filters.q ?? '')}
        @input=${(event) => change({ q: event.target.value.trim() }, { typing: true })}></label>
    ${choice('verdict', filters, words(['green', 'yellow', 'red'], 'verdict'), change)}
    ${choice('review', filters, words(['open', 'accepted', 'rejected'], 'review'), change)}
    ${choice('status', filters, words(['queued', 'running', 'succeeded', 'failed', 'cancelled'], 'status'), change)}
    ${choice('reason', filters, REASONS.map((code) => [code, reasonText({ code })]), change)}
    ${choice('camera', filters, named(lists.cameras), change)}
    ${choice('block', filters, named(lists.blocks), change)}
    ${timeChoice(filters, change)}
    ${isFiltered(filters)
      ? html`<button type="button" class="quiet filter-clear" @click=${() => change(Object.fromEntries(ALL.map((name) => [name, ''])))}>${t('queue.clear')}</button>`
      : nothing}
  </form>`;
}
