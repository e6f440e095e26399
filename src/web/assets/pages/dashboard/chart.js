// Verdicts over time as stacked bars. Besides its colour each part has its place in the stack and a hatching.

import { html, nothing, svg } from '../../vendor/lit.js';
import { number, t, time } from '../../texts.js';
import { verdict } from '../../parts/verdict.js';

/** The parts of a bar, from below. */
export const PARTS = ['green', 'yellow', 'red', 'failed'];
const [HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [240, 44, 8, 10, 26];
const LEAST_LABEL_PX = 92;

/** A step of the scale of which four or five make `most`: 1, 2 or 5 times a power of ten. */
export function tick(most) {
  const rough = Math.max(1, most) / 4;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((one) => one >= rough);
  return Math.max(1, step);
}

/** How the begin of a step is written. */
export function stepText(at, step) {
  // days are those of UTC, as the service counts them
  return time(at, step === 'hour' ? { day: 'numeric', month: 'short', hour: '2-digit', minute: '2-digit' }
    : { day: 'numeric', month: 'short', timeZone: 'UTC' });
}

const nameOf = (column) => t(['green', 'yellow', 'red'].includes(column) ? `verdict.${column}` : `dashboard.${column}`);
const sum = (step) => PARTS.reduce((count, part) => count + step[part], 0);

function bar(step, x, width, y) {
  let below = 0;
  return PARTS.filter((part) => step[part]).map((part) => {
    const from = below;
    below += step[part];
    return svg`<rect class="bar bar-${part}" x=${x} width=${width} y=${y(below)} height=${Math.max(0, y(from) - y(below))}></rect>`;
  });
}

/** The chart, `width` pixels wide, of `steps` of the statistics. */
export function chart({ steps, step, since, until }, width) {
  const most = Math.max(1, ...steps.map(sum));
  const each = tick(most);
  const top = Math.ceil(most / each) * each;
  const y = (count) => HEIGHT - BOTTOM - (count / top) * (HEIGHT - TOP - BOTTOM);
  const pitch = (width - LEFT - RIGHT) / steps.length;
  const gap = pitch > 6 ? Math.min(6, pitch * 0.25) : pitch > 2 ? 1 : 0;
  const every = Math.ceil(LEAST_LABEL_PX / pitch);
  const lines = Array.from({ length: Math.round(top / each) + 1 }, (_, index) => index * each);
  const told = (one) => `${stepText(one.at, step)}: ${PARTS.map((part) => `${nameOf(part)} ${number(one[part])}`).join(', ')}`;
  const label = t('dashboard.chart', { step: t(`dashboard.step_${step}`), from: time(since), until: time(until) });
  return html`<svg class="chart" role="img" aria-label=${label} viewBox="0 0 ${width} ${HEIGHT}" width=${width} height=${HEIGHT}>
    <defs>${hatching('yellow', 45)}${hatching('red', -45)}</defs>
    ${lines.map((count) => svg`<line class="grid" x1=${LEFT} x2=${width - RIGHT} y1=${y(count)} y2=${y(count)}></line>
      <text class="scale" x=${LEFT - 8} y=${y(count) + 4} text-anchor="end">${number(count)}</text>`)}
    ${steps.map((one, index) => {
      const x = LEFT + index * pitch;
      return svg`<g><title>${told(one)}</title><rect class="bar-room" x=${x} y=${TOP} width=${pitch} height=${HEIGHT - TOP - BOTTOM}></rect>
        ${bar(one, x + gap / 2, pitch - gap, y)}</g>
        ${index % every || x + LEAST_LABEL_PX - 12 > width ? nothing : svg`<text class="scale" x=${x + gap / 2} y=${HEIGHT - 8}>${stepText(one.at, step)}</text>`}`;
    })}</svg>`;
}

function hatching(name, angle) {
  return svg`<pattern id="hatch-${name}" width="5" height="5" patternUnits="userSpaceOnUse" patternTransform="rotate(${angle})">
    <rect class="hatch-ground-${name}" width="5" height="5"></rect><line class="hatch-line" x1="0" x2="0" y1="0" y2="5"></line></pattern>`;
}

/** What the parts of the bars are. */
export function legend() {
  return html`<ul class="legend">${PARTS.map((part) => html`<li>
    <svg class="swatch" viewBox="0 0 14 14" aria-hidden="true"><rect class="bar bar-${part}" width="14" height="14"></rect></svg>
    ${part === 'failed' ? t('dashboard.failed') : verdict(part)}</li>`)}</ul>`;
}

/** The same as a table, with all that the service counts. */
export function stepTable({ steps, step }) {
  const columns = ['submitted', ...PARTS, 'cancelled', 'accepted', 'rejected'];
  return html`<details class="as-table"><summary>${t('dashboard.as_table')}</summary>
    <div class="scrolled" tabindex="0" role="region" aria-label=${t('dashboard.verdicts')}><table class="plain-table">
    <thead><tr><th scope="col">${t('dashboard.at')}</th>
      ${columns.map((column) => html`<th scope="col" class="figure">${nameOf(column)}</th>`)}</tr></thead>
    <tbody>${steps.toReversed().map((one) => html`<tr><th scope="row">${stepText(one.at, step)}</th>
      ${columns.map((column) => html`<td class="figure">${number(one[column])}</td>`)}</tr>`)}</tbody></table></div></details>`;
}
