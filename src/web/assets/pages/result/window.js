// A control point looked at closely: its window of the image, and beside it what the search for it has seen.

import { html, nothing, render } from '../../vendor/lit.js';
import { api } from '../../api.js';
import { number, problemText, t } from '../../texts.js';
import { colour } from '../../parts/colours.js';
import { DASHES } from '../../parts/viewer/styles.js';
import { cellOfPlace, drawHeat, drawScale, placeOfCell, range } from './heat.js';

const SIDE = 440;

function path(context, points, { tone, width, dash = [] }) {
  const stroke = (style, lineWidth, lineDash) => {
    context.strokeStyle = style;
    context.lineWidth = lineWidth;
    context.setLineDash(lineDash);
    context.beginPath();
    points.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.stroke();
  };
  stroke('rgba(0,0,0,.65)', width + 3, []);
  stroke(tone, width, dash);
}

function drawWindow(canvas, picture, seen, { state, located_px: located }) {
  const [x0, y0, width, height] = seen.window_px;
  const scale = canvas.width / Math.max(width, height);
  const at = ([x, y]) => [(x - x0) * scale, (y - y0) * scale];
  const context = canvas.getContext('2d');
  context.fillStyle = '#1a1b19';
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.imageSmoothingEnabled = scale < 1;
  // the service clips the picture to the image
  if (picture) context.drawImage(picture, Math.max(0, -x0) * scale, Math.max(0, -y0) * scale, picture.width * scale,
    picture.height * scale);
  for (const edge of seen.edges_px) path(context, edge.map(at), { tone: colour(state), width: 2, dash: DASHES[state] });
  for (const segment of seen.segments_px) path(context, segment.map(at), { tone: colour('segment'), width: 1.25 });
  if (seen.predicted_px) {
    const [x, y] = at(seen.predicted_px);
    path(context, [[x - 7, y - 7], [x + 7, y + 7]], { tone: colour('region'), width: 2 });
    path(context, [[x - 7, y + 7], [x + 7, y - 7]], { tone: colour('region'), width: 2 });
  }
  if (located) {
    const [x, y] = at(located);
    path(context, Array.from({ length: 25 }, (_, k) => [x + 7 * Math.cos(k * Math.PI / 12), y + 7 * Math.sin(k * Math.PI / 12)]),
      { tone: colour(state), width: 2 });
  }
}

// by pointer or by arrow keys, to the cell that the figures are of
function cellCursor(canvas, accumulator, moved) {
  let cursor = accumulator.peaks[0] ? cellOfPlace(accumulator, accumulator.peaks[0].at_px).map(Math.round)
    : [accumulator.size / 2, accumulator.size / 2].map(Math.floor);
  const to = (column, row) => {
    cursor = [column, row].map((value) => Math.min(accumulator.size - 1, Math.max(0, value)));
    drawHeat(canvas, accumulator, cursor);
    moved(cursor);
  };
  const cell = (offset) => Math.floor(offset / canvas.clientWidth * accumulator.size);
  canvas.onpointermove = (event) => to(cell(event.offsetX), cell(event.offsetY));
  canvas.onkeydown = (event) => {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!step) return;
    event.preventDefault();
    to(cursor[0] + step[0], cursor[1] + step[1]);
  };
  to(...cursor);
}

function peaks(accumulator) {
  if (!accumulator.peaks.length) return nothing;
  return html`<table class="figure-table peaks"><thead><tr><th scope="col">${t('result.peak')}</th>
    <th scope="col" class="figure">x</th><th scope="col" class="figure">y px</th>
      <th scope="col" class="figure">${t('result.likelihood')}</th></tr></thead>
    <tbody>${accumulator.peaks.slice(0, 5).map((peak, k) => html`<tr><th scope="row">${k + 1}</th>
      <td class="figure">${number(peak.at_px[0], 1, { exactly: true })}</td>
        <td class="figure">${number(peak.at_px[1], 1, { exactly: true })}</td>
          <td class="figure">${number(peak.log_likelihood, 2, { exactly: true })}</td></tr>`)}</tbody></table>`;
}

function template(name, seen) {
  const { accumulator } = seen;
  const [low, high] = accumulator ? range(accumulator.values) : [];
  return html`
    <div class="window-pair">
      <figure><canvas class="window-picture" width=${SIDE} height=${SIDE} role="img"
        aria-label=${t('result.window_of', { name })}></canvas>
        <figcaption>${t('result.window')} <span class="quiet-text">${number(seen.window_px[2], 0)} × ${number(seen.window_px[3],
          0)} px</span></figcaption></figure>
      ${accumulator ? html`<figure><canvas class="window-heat" width=${SIDE} height=${SIDE} tabindex="0" role="application"
        aria-label=${t('result.accumulator_of', { name })}></canvas>
        <figcaption class="heat-scale"><span>${number(low, 1)}</span><canvas width="200" height="10"
          aria-hidden="true"></canvas><span>${number(high, 1)}</span></figcaption></figure>` : nothing}
    </div>
    ${accumulator ? html`<p class="heat-value">${t('result.accumulator')}: <output></output></p>${peaks(accumulator)}`
      : html`<p class="quiet-text">${t('result.no_accumulator')}</p>`}`;
}

/** The part for one control point in `element`: `{id, image}` are those of the orientation, `drawn` is what is drawn of the point. */
export async function showWindow(element, { id, image, name, drawn, signal }) {
  render(html`<p class="quiet-text" role="status">${t('result.loading')}</p>`, element);
  try {
    const seen = await api.get(`/orientations/${id}/control-points/${encodeURIComponent(name)}/window`, { signal });
    const [x, y, width, height] = seen.window_px;
    const picture = new Image();
    picture.src = api.address(`/images/${image}/window`, { x, y, width, height });
    await picture.decode().catch(() => {});
    if (signal.aborted) return;
    render(template(name, seen), element);
    drawWindow(element.querySelector('.window-picture'), picture.naturalWidth ? picture : undefined, seen, drawn);
    if (!seen.accumulator) return;
    drawScale(element.querySelector('.heat-scale canvas'));
    const output = element.querySelector('.heat-value output');
    cellCursor(element.querySelector('.window-heat'), seen.accumulator, ([column, row]) => {
      const place = placeOfCell(seen.accumulator, column, row);
      output.textContent = t('result.heat_at', { x: number(place[0], 1), y: number(place[1], 1),
        value: number(seen.accumulator.values[row * seen.accumulator.size + column], 2, { exactly: true }) });
    });
  } catch (error) {
    if (signal.aborted) return;
    render(html`<p class="quiet-text">${error.status === 404 || error.status === 409 ? t('result.no_window')
      : problemText(error)}</p>`, element);
  }
}
