// The tabs beside the viewer, and what is in each.

import { html, nothing } from '../../vendor/lit.js';
import { t } from '../../texts.js';
import { checksTable } from './checks.js';
import { heading } from './figures.js';
import { groundGrid } from './ground.js';
import { orientationTab } from './orientation.js';
import { pairsTable, pointsTable } from './points.js';
import { rawTab } from './raw.js';
import { decisionButtons, reviewList, verdictTab } from './verdict.js';

/** The tabs in their order; the first is shown where nothing else is asked for. */
export const TABS = ['verdict', 'points', 'orientation', 'ground', 'raw'];

/** The bar of tabs: arrow keys go along it. */
export function tabs(current, choose) {
  const keys = (event) => {
    const at = TABS.indexOf(current);
    const to = { ArrowRight: at + 1, ArrowLeft: at - 1, Home: 0, End: TABS.length - 1 }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    const next = TABS[(to + TABS.length) % TABS.length];
    choose(next);
    document.getElementById(`tab-${next}`)?.focus();
  };
  return html`<div class="tabs" role="tablist" aria-label=${t('result.parts')} @keydown=${keys}>${TABS.map((name) => html`
    <button type="button" role="tab" id="tab-${name}" aria-controls="tab-panel" aria-selected=${name === current ? 'true'
      : 'false'} tabindex=${name === current ? 0 : -1} @click=${() => choose(name)}>${t(`result.tab_${name}`)}</button>`)}</div>`;
}

const PANELS = {
  verdict: (state, shown, { may, acts }) => verdictTab(shown.result, {
    choose: acts.choose,
    decide: decisionButtons({
      mayDecide: may('operator'), mayAccept: Boolean(shown.result.projection_centre), busy: state.busy,
        correcting: Boolean(state.correcting), mayCorrect: Boolean(state.drawing),
    }, { accept: acts.accept, reject: acts.reject, correct: () => acts.correct() }),
    reviews: reviewList(state.reviews, may('operator') ? acts.lookAt : undefined, state.looking),
  }),
  points: (state, shown, { acts }) => html`
    ${pointsTable(shown.result, shown.drawing, { sort: state.sort, selected: state.chosen, hovered: state.hovered,
      off: state.correcting && new Set(state.correcting.now.off) }, acts)}
    ${pairsTable(shown.result.pairs, acts.choose)}
    ${checksTable(shown.result)}
    ${state.chosen !== undefined ? html`${heading(state.chosen)}` : html`
      <p class="quiet-text hint">${t('result.choose_point')}</p>`}
    <div class="point-detail"></div>`,
  orientation: (state, shown) => orientationTab(state, shown.result),
  ground: (state, shown, { acts }) => html`
    ${heading(t('result.ground'))}
    ${groundGrid(shown.result.ground_precision, shown.drawing?.tolerance_m ?? state.drawing?.tolerance_m, state.correcting?.answer
      && state.orientation.result.ground_precision, acts.look)}
    ${shown.map ? html`${heading(t('result.map'))}${mapLegend(shown.map)}
      <div class="result-map" role="region" tabindex="0" aria-label=${t('result.map')}></div>` : nothing}`,
  raw: (state) => rawTab(state.orientation, [['orientation', state.orientation], ['image', state.image], ['camera', state.camera],
    ['drawing', state.drawing], ['map', state.map], ['reviews', state.reviews]]),
};

function mapLegend(map) {
  const roles = new Set(map.features.map((feature) => feature.properties.role));
  const magnification = map.features.find((feature) => feature.properties.role === 'error_ellipse')?.properties.magnification;
  const entries = ['footprint', 'projection_centre', 'error_ellipse', 'approximation', 'control_point',
    'grid_point'].filter((role) => roles.has(role));
  return html`<ul class="map-legend">${entries.map((role) => html`
    <li><span class="map-key key-${role}" aria-hidden="true"></span>${t(`result.map_${role}`, { magnification })}</li>`)}</ul>`;
}

/** What is in the tab that is chosen. */
export function tabPanel(state, shown, more) {
  return html`<div class="tab-panel panel-${state.tab}" role="tabpanel" id="tab-panel" tabindex="0"
    aria-labelledby="tab-${state.tab}">${PANELS[state.tab](state, shown, more)}</div>`;
}
