// The check points: buildings that were not used, and tell how right the result is.

import { html, nothing } from '../../vendor/lit.js';
import { number, t } from '../../texts.js';
import { heading } from './figures.js';

const fixed = (value, digits) => (value === undefined ? '–' : number(value, digits, { exactly: true }));

function judged({ residual_m }, tolerance_m) {
  if (residual_m === undefined) return t('result.check_not_found');
  if (!tolerance_m) return '–';
  return residual_m <= tolerance_m ? t('result.check_within') : html`<span aria-hidden="true">▲ </span>${t('result.check_over')}`;
}

/** The table; nothing without a check point in view. */
export function checksTable({ check_points: points, tolerance_m }) {
  if (!points?.length) return nothing;
  return html`${heading(t('result.checks'))}
    <div class="wide checks" tabindex="0" role="region" aria-label=${t('result.checks')}><table class="figure-table">
      <thead><tr><th scope="col">${t('result.column_name')}</th><th scope="col" class="figure">${t('result.check_m')}</th>
        <th scope="col" class="figure">${t('result.check_px')}</th><th scope="col">${t('result.check_tolerance')}</th></tr></thead>
      <tbody>${points.map((point) => html`<tr><th scope="row">${point.name}</th>
        <td class="figure">${fixed(point.residual_m, 3)}</td><td class="figure">${fixed(point.residual_px, 2)}</td>
        <td class=${point.residual_m > tolerance_m ? 'contradicts' : ''}>${judged(point, tolerance_m)}</td></tr>`)}</tbody>
    </table></div>`;
}
