// The predicted precision on the ground as a picture: the nine places of the image, each against the tolerance.

import { html, nothing } from '../../vendor/lit.js';
import { number, t } from '../../texts.js';

// a bar reaches to twice the tolerance; its middle is the tolerance
function cell(point, tolerance_m, before, look) {
  const { sigma_planimetric_m: sigma } = point;
  const share = tolerance_m ? sigma / tolerance_m : undefined;
  const over = share > 1;
  const changed = before !== undefined && Math.abs(before - sigma) > 5e-5;
  return html`<button type="button" class="ground-cell ${over ? 'over' : ''}" title=${t('result.ground_look')}
    @click=${() => look(point.image_px)}>
    <span class="ground-value">${over
      ? html`<span aria-hidden="true">▲ </span><span class="unseen">${t('result.ground_over')}</span>`
        : nothing}${number(sigma, 3, { exactly: true })} m</span>
    ${changed ? html`<span class="ground-before">${t('result.ground_before',
      { sigma: number(before, 3, { exactly: true }) })}</span>` : nothing}
    ${share === undefined ? nothing
      : html`<span class="ground-bar" aria-hidden="true"><span class="ground-fill"
        .style=${`width: ${Math.min(100, 50 * share)}%`}></span></span>`}
  </button>`;
}

/** The grid; `before` is that of the orientation while a trial is shown, `look(image_px)` shows a place in the viewer. */
export function groundGrid(points, tolerance_m, before, look) {
  if (!points?.length) return html`<p class="quiet-text">${t('result.no_ground')}</p>`;
  const over = tolerance_m ? points.filter((point) => point.sigma_planimetric_m > tolerance_m).length : 0;
  return html`
    <p class="ground-note">${tolerance_m ? t('result.ground_tolerance', { tolerance: number(tolerance_m, 3, { exactly: true }) })
      : t('result.ground_no_tolerance')}
      ${tolerance_m ? html`<strong class=${over ? 'over-text' : ''}>${over
        ? t('result.ground_over_count', { over: number(over), all: number(points.length) })
          : t('result.ground_all_within')}</strong>` : nothing}</p>
    <div class="ground-grid" role="group" aria-label=${t('result.ground')}>${points.map((point, k) => cell(point, tolerance_m,
      before?.[k]?.sigma_planimetric_m, look))}</div>`;
}
