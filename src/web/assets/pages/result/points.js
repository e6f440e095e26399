// The tab with the control points: what became of each, how the result depends on it, and on pairs of them.

import { html, nothing, repeat } from '../../vendor/lit.js';
import { number, t } from '../../texts.js';
import { stateSample } from '../../parts/viewer/panel.js';
import { stateOf } from './figures.js';

const fixed = (value, digits) => (value === undefined || value === null ? '–' : number(value, digits, { exactly: true }));
const ORDER = ['matched', 'rejected', 'unmatched'];

/** The columns: what is sorted by, and how it is written. */
const COLUMNS = [
  { key: 'residual', of: (row) => row.residual_px, digits: 2 },
  { key: 'segments', of: (row) => row.segments_matched, digits: 0 },
  { key: 'discrepancy', of: (row) => row.sensitivity && Math.hypot(...row.sensitivity.discrepancy_px), digits: 2 },
  { key: 'test', of: (row) => row.sensitivity?.test, digits: 2, mark: (row) => row.sensitivity?.contradicts },
  { key: 'change', of: (row) => row.sensitivity?.change_m, digits: 3 },
  { key: 'empirical', of: (row) => row.sensitivity?.empirical_m, digits: 3 },
  { key: 'theoretical', of: (row) => row.sensitivity?.theoretical_m, digits: 3 },
];
const SORTS = { name: (row) => row.name, state: (row) => ORDER.indexOf(row.state),
  ...Object.fromEntries(COLUMNS.map(({ key, of }) => [key, of])) };

function sorted(rows, { by, down }) {
  const of = SORTS[by];
  const sign = down ? -1 : 1;
  // what is unknown stands at the end, whichever way it is sorted
  return [...rows].sort((a, b) => {
    const [x, y] = [of(a), of(b)];
    if (x === undefined || x === null) return y === undefined || y === null ? 0 : 1;
    if (y === undefined || y === null) return -1;
    return sign * (typeof x === 'string' ? x.localeCompare(y, undefined, { numeric: true }) : x - y);
  });
}

function head(key, sort, resort) {
  const active = sort.by === key;
  return html`<th scope="col" aria-sort=${active ? (sort.down ? 'descending' : 'ascending') : nothing} class=${key === 'name'
    || key === 'state' ? '' : 'figure'}>
    <button type="button" class="sort" title=${t(`result.column_${key}_long`)}
      @click=${() => resort({ by: key, down: active ? !sort.down : key !== 'name' && key !== 'state' })}>
      ${t(`result.column_${key}`)}<span aria-hidden="true">${active ? (sort.down ? ' ▾' : ' ▴') : ''}</span></button></th>`;
}

// up and down go through the rows, as in every list
function arrows(event) {
  const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (!step || !event.target.matches('.point-name')) return;
  const all = [...event.currentTarget.querySelectorAll('.point-name')];
  const next = all[all.indexOf(event.target) + step];
  if (!next) return;
  event.preventDefault();
  next.focus();
  next.click();
}

function row(entry, { selected, hovered, off, toggle, choose, point }) {
  const classes = [entry.name === selected ? 'selected' : '', entry.name === hovered ? 'hovered' : '', off?.has(entry.name) ? 'off'
    : ''].join(' ');
  return html`<tr class=${classes} @pointerenter=${() => point(entry.name)} @pointerleave=${() => point(undefined)}
    @click=${() => choose(entry.name)}>
    ${off ? html`<td><input type="checkbox" aria-label=${t('result.takes_part', { name: entry.name })}
      .checked=${!off.has(entry.name)}
      @click=${(event) => event.stopPropagation()} @change=${(event) => toggle(entry.name, event.target.checked)}></td>` : nothing}
    <th scope="row"><button type="button" class="point-name" aria-pressed=${entry.name === selected ? 'true' : 'false'}
      @click=${(event) => { event.stopPropagation(); choose(entry.name); }}>${entry.name}</button></th>
    <td class="state">${stateSample(entry.state)}<span>${t(`viewer.state_${entry.state}`)}</span></td>
    ${COLUMNS.map(({ of, digits, mark }) => html`<td class="figure ${mark?.(entry) ? 'contradicts' : ''}">${mark?.(entry)
      ? html`<span title=${t('result.contradicts')}>▲<span class="unseen">${t('result.contradicts')}</span></span> `
        : ''}${fixed(of(entry), digits)}</td>`)}</tr>`;
}

/**
 * The table. `view` holds `{sort, selected, hovered, off}` (`off`, a set, only while correcting), `acts` are
 * `{resort, choose(name), point(name), toggle(name, on)}`.
 */
export function pointsTable(result, drawing, view, acts) {
  const rows = result.control_points.map((entry) => ({ ...entry, state: stateOf(entry, drawing) }));
  if (!rows.length) return html`<p class="quiet-text">${t('result.no_points')}</p>`;
  return html`<div class="wide points" tabindex="0" role="region" aria-label=${t('result.points')}>
    <table class="figure-table" @keydown=${arrows}>
      <thead><tr>${view.off ? html`<td></td>` : nothing}${['name', 'state',
        ...COLUMNS.map(({ key }) => key)].map((key) => head(key, view.sort, acts.resort))}</tr></thead>
      <tbody>${repeat(sorted(rows, view.sort), (entry) => entry.name, (entry) => row(entry, { ...view, ...acts }))}</tbody>
    </table></div>`;
}

/** The pairs that matter most. */
export function pairsTable(pairs, choose) {
  if (!pairs?.length) return nothing;
  const name = (of) => html`<button type="button" class="link" @click=${() => choose(of)}>${of}</button>`;
  const columns = ['test', 'change', 'empirical', 'theoretical'];
  return html`<details class="pairs">
    <summary>${t('result.pairs')} <span class="quiet-text">${number(pairs.length, 0)}</span></summary>
    <div class="wide" tabindex="0" role="region" aria-label=${t('result.pairs')}><table class="figure-table">
      <thead><tr><th scope="col">${t('result.pair')}</th>${columns.map((key) => html`
        <th scope="col" class="figure" title=${t(`result.column_${key}_long`)}>${t(`result.column_${key}`)}</th>`)}</tr></thead>
      <tbody>${pairs.map((pair) => html`<tr><th scope="row">${name(pair.control_points[0])} · ${name(pair.control_points[1])}</th>
        <td class="figure">${fixed(pair.test, 2)}</td><td class="figure">${fixed(pair.change_m, 3)}</td>
          <td class="figure">${fixed(pair.empirical_m, 3)}</td>
            <td class="figure">${fixed(pair.theoretical_m, 3)}</td></tr>`)}</tbody>
    </table></div></details>`;
}

