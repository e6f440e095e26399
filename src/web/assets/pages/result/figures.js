// Numbers of an orientation that are computed from those of the API, and lists of names with values.

import { html, nothing } from '../../vendor/lit.js';
import { notify } from '../../parts/notices.js';
import { t } from '../../texts.js';

const METRES_A_DEGREE = 111_320;

/** Whether coordinates of a CRS are degrees. */
export const isGeographic = (crs) => /^EPSG:(4979|4326|4258|4937|4269|6318|9000|7912)\b/.test(crs)
  || /\+proj=(longlat|latlong)\b/.test(crs);

/** Standard deviations of the six parameters: three in metres, three in degrees; undefined without a covariance. */
export function deviations(result) {
  const matrix = result?.covariance?.matrix;
  return matrix && matrix.map((row, k) => Math.sqrt(row[k]) * (k < 3 ? 1 : 180 / Math.PI));
}

/** The largest predicted standard deviation on the ground; undefined without any. */
export function largestSigma(result) {
  const all = (result?.ground_precision ?? []).map((point) => point.sigma_planimetric_m);
  return all.length ? Math.max(...all) : undefined;
}

/** How far apart two places (longitude, latitude, height) are, in metres: they are near one another. */
export function distance_m(one, other) {
  const east = (one[0] - other[0]) * METRES_A_DEGREE * Math.cos(one[1] * Math.PI / 180);
  const north = (one[1] - other[1]) * METRES_A_DEGREE;
  return Math.hypot(east, north, (one[2] ?? 0) - (other[2] ?? 0));
}

/** The projection centre in a map of `/orientations/{id}/map`: longitude, latitude, height. */
export const centreOf = (map) => map?.features.find((feature) => feature.properties.role === 'projection_centre')?.geometry.coordinates;

/** What became of a control point: as the drawing says, and without one whether it was used. */
export function stateOf(point, drawing) {
  return drawing?.control_points.find((drawn) => drawn.name === point.name)?.state ?? (point.used ? 'matched' : 'unmatched');
}

/** A list of names and values; entries without a value are left out. */
export function figures(entries) {
  const there = entries.filter(([, value]) => value !== undefined && value !== null && value !== '');
  return html`<dl class="figures">${there.map(([name, value]) => html`<div><dt>${name}</dt><dd>${value}</dd></div>`)}</dl>`;
}

/** A button that copies a text. */
export function copyButton(text) {
  const copy = async () => {
    try {
      await navigator.clipboard.writeText(text());
      notify(t('result.copied'), 'done');
    } catch {
      notify(t('result.not_copied'), 'error');
    }
  };
  return html`<button type="button" class="quiet small" @click=${copy}>${t('result.copy')}</button>`;
}

/** A heading, with something at its end. */
export const heading = (text, end = nothing) => html`<h2 class="section-head"><span>${text}</span>${end}</h2>`;
