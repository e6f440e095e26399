// The sets that control points belong to.

import { html, nothing } from '../../vendor/lit.js';
import { number, t, time } from '../../texts.js';
import { figures, heading } from '../result/figures.js';

/** All sets, each with what is known of it; `remove(set)`. */
export function setList(sets, { mayDelete, remove }) {
  return sets.map((set) => html`<section>${heading(set.name, mayDelete
    ? html`<button type="button" class="danger small" aria-label=${t('control.delete_set', { name: set.name })}
        @click=${() => remove(set)}>${t('control.delete')}</button>` : nothing)}
    ${set.description ? html`<p class="quiet-text">${set.description}</p>` : nothing}
    ${figures([
      [t('control.set_points'), number(set.control_points, 0)],
      [t('control.survey_year'), set.survey_year === undefined ? undefined : String(set.survey_year)],
      [t('control.set_created'), time(set.created_at)],
    ])}</section>`);
}
