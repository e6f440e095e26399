// The expected cost over the threshold, with a threshold that can be moved, and what is decided at it.

import { html, nothing, svg } from '../../vendor/lit.js';
import { number, percent, t } from '../../texts.js';
import { axis, FRAME, grid, marks, ticks } from './axes.js';
import { CASES, costOfRejecting, expectedCost, pointAt, stepped } from './cost.js';

const KEYS = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10, Home: -Infinity, End: Infinity };

function shapes({ evaluation, costs, shipped }) {
  const points = evaluation.curve.filter((point) => point.threshold !== undefined).map((point) => [point.threshold,
    expectedCost(point, costs)]);
  const all = expectedCost(evaluation.curve[0], costs);
  const [low, high] = [Math.min(points[0]?.[0] ?? 0, shipped ?? Infinity), Math.max(points.at(-1)?.[0] ?? 1, shipped ?? -Infinity)];
  const most = 1.05 * Math.max(all, costOfRejecting(evaluation, costs), ...points.map(([, cost]) => cost));
  return { points, x: axis(low, high, 'across'), y: axis(0, most || 1, 'up'), low, high, most: most || 1 };
}

function drag(event, x, move) {
  const picture = event.currentTarget.ownerSVGElement ?? event.currentTarget;
  const to = ({ clientX }) => {
    const box = picture.getBoundingClientRect();
    move(x.back((clientX - box.left) / box.width * FRAME.width));
  };
  event.preventDefault();
  picture.querySelector('[role=slider]').focus();
  to(event);
  const up = () => {
    removeEventListener('pointermove', to);
    removeEventListener('pointerup', up);
    removeEventListener('pointercancel', up);
  };
  addEventListener('pointermove', to);
  addEventListener('pointerup', up);
  addEventListener('pointercancel', up);
}

function handle(model, { x, y, low, high }, threshold, move) {
  const cost = expectedCost(pointAt(model.evaluation.curve, threshold), model.costs);
  const at = x(threshold);
  const keys = (event) => {
    const steps = KEYS[event.key];
    if (steps === undefined) return;
    event.preventDefault();
    move(Math.max(low, stepped(model.evaluation.curve, threshold, steps)));
  };
  return svg`<g class="threshold" role="slider" tabindex="0" aria-label=${t('diagnosis.threshold')} aria-valuemin=${low}
    aria-valuemax=${high} aria-valuenow=${threshold}
      aria-valuetext=${t('diagnosis.threshold_text', { threshold: number(threshold, 3), cost: number(cost, 3) })} @keydown=${keys}>
    <rect class="grip" x=${at - 12} y=${FRAME.top} width="24" height=${FRAME.height - FRAME.bottom - FRAME.top}></rect>
    <path d="M${at} ${FRAME.top}V${FRAME.height - FRAME.bottom}"></path><circle cx=${at} cy=${y(cost)} r="6"></circle></g>`;
}

/** The curve of a model (`{evaluation, costs, shipped}`) with the threshold as it is now; `move(threshold)` moves it. */
export function costCurve(model, threshold, move) {
  const shape = shapes(model);
  const { points, x, y, low, high, most } = shape;
  const rejecting = costOfRejecting(model.evaluation, model.costs);
  return html`<svg class="plot cost-curve" viewBox="0 0 ${FRAME.width} ${FRAME.height}" role="group"
    aria-label=${t('diagnosis.curve')} @pointerdown=${(event) => drag(event, x, move)}>
    ${grid(marks(ticks(low, high, 7), x, 2), marks(ticks(0, most), y, 2), t('diagnosis.threshold'), t('diagnosis.cost'))}
    ${svg`<path class="rejecting" d="M${FRAME.left} ${y(rejecting)}H${FRAME.width - FRAME.right}"></path>
      <text class="note" x=${FRAME.left + 5} y=${y(rejecting) + 14}>${t('diagnosis.rejecting_all')}</text>
      <polyline class="curve" points=${points.map(([score, cost]) => `${x(score).toFixed(1)},${y(cost).toFixed(1)}`).join(' ')}></polyline>
      ${model.shipped === undefined ? nothing : svg`
        <path class="shipped" d="M${x(model.shipped)} ${FRAME.top}V${FRAME.height - FRAME.bottom}"></path>
        <text class="note" x=${x(model.shipped) + 9} y=${FRAME.height - FRAME.bottom - 8}>${t('diagnosis.shipped',
          { threshold: number(model.shipped, 2) })}</text>`}`}
    ${handle(model, shape, threshold, move)}</svg>`;
}

/** What is decided at a threshold: the counts, and the expected cost. */
export function confusionTable(model, threshold) {
  const counts = pointAt(model.evaluation.curve, threshold);
  const images = counts.cc + counts.cw + counts.wc + counts.ww;
  const cell = (name) => html`
    <td class="figure" data-case=${name}><strong>${number(counts[name], 0)}</strong> <span
      class="quiet-text">${percent(counts[name] / Math.max(1, images), 1)}</span></td>`;
  return html`<table class="figure-table confusion"><caption class="unseen">${t('diagnosis.confusion')}</caption>
    <thead><tr><td></td><th scope="col" class="figure">${t('diagnosis.right')}</th>
      <th scope="col" class="figure">${t('diagnosis.wrong')}</th></tr></thead>
    <tbody><tr><th scope="row">${t('diagnosis.accepted')}</th>${cell('cc')}${cell('cw')}</tr><tr>
      <th scope="row">${t('diagnosis.rejected')}</th>${cell('wc')}${cell('ww')}</tr></tbody></table>
    <p class="cost-line">${t('diagnosis.cost_at', { threshold: number(threshold, 3, { exactly: true }) })} <strong
      data-cost>${number(expectedCost(counts, model.costs), 4, { exactly: true })}</strong>
      <span class="quiet-text">${t('diagnosis.cost_rejecting',
        { cost: number(costOfRejecting(model.evaluation, model.costs), 3) })}</span></p>`;
}

/** All points of the curve as a table; a click takes its threshold. */
export function curveTable(model, threshold, move) {
  const now = pointAt(model.evaluation.curve, threshold);
  return html`<details><summary>${t('diagnosis.all_thresholds')}</summary>
    <div class="wide curve-table" tabindex="0" role="region" aria-label=${t('diagnosis.all_thresholds')}>
    <table class="figure-table"><thead><tr>
      <th scope="col" class="figure">${t('diagnosis.threshold')}</th>
      ${CASES.map((name) => html`<th scope="col" class="figure">${t(`diagnosis.case_${name}`)}</th>`)}
      <th scope="col" class="figure">${t('diagnosis.cost')}</th></tr></thead>
      <tbody>${model.evaluation.curve.map((point) => html`
        <tr class=${point === now ? 'selected' : ''} aria-current=${point === now ? 'true' : nothing}>
        <th scope="row" class="figure">${point.threshold === undefined ? t('diagnosis.accept_all')
          : html`<button type="button" class="link" @click=${() => move(point.threshold)}>${number(point.threshold, 3,
            { exactly: true })}</button>`}</th>
        ${CASES.map((name) => html`<td class="figure">${number(point[name], 0)}</td>`)}
          <td class="figure">${number(expectedCost(point, model.costs), 4,
            { exactly: true })}</td></tr>`)}</tbody></table></div></details>`;
}
