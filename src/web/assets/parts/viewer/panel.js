// What stands over the picture: which layers are shown, with their legend, and how much residuals are magnified.

import { html, svg } from '../../vendor/lit.js';
import { t } from '../../texts.js';
import { LAYERS } from './layers.js';
import { DASHES } from './styles.js';

const KEPT = 'gable.viewer';
const DEFAULTS = { shown: { regions: false, edges: true, segments: true, residuals: true, references: true, names: true },
  magnification: 20, open: true };

/** What the user has chosen in this browser. */
export function kept() {
  try {
    const found = JSON.parse(localStorage.getItem(KEPT)) ?? {};
    return { ...DEFAULTS, ...found, shown: { ...DEFAULTS.shown, ...found.shown } };
  } catch {
    return structuredClone(DEFAULTS);
  }
}

/** Keeps it for the next image. */
export const keep = (chosen) => localStorage.setItem(KEPT, JSON.stringify(chosen));

const stroke = (tone, dash) => svg`<path class="halo" d="M1 7h26"></path>
  <path class="tone ${tone}" d="M1 7h26" stroke-dasharray=${dash?.join(' ') ?? 'none'}></path>`;
const SAMPLES = {
  regions: svg`<ellipse class="tone region" cx="14" cy="7" rx="11" ry="5" stroke-dasharray="5 3"></ellipse>`,
  edges: stroke('matched'),
  segments: stroke('segment'),
  residuals: svg`<path class="halo" d="M3 11 22 4"></path><path class="tone plain" d="M3 11 22 4"></path>
    <circle class="tip" cx="22" cy="4" r="2.5"></circle>`,
  references: svg`<circle class="tone matched" cx="14" cy="7" r="4.5"></circle>`,
  names: svg`<text x="14" y="11" text-anchor="middle">Abc</text>`,
};

const sample = (drawn) => html`<svg class="sample" viewBox="0 0 28 14" aria-hidden="true">${drawn}</svg>`;

/** A piece of line as the edges of control points of this state are drawn. */
export const stateSample = (state) => sample(stroke(state, DASHES[state]));

// the slider is logarithmic: 1 to 200
const STEPS = 100;
const toStep = (magnification) => Math.round(STEPS * Math.log(magnification) / Math.log(200));
const fromStep = (step) => Math.round(200 ** (step / STEPS));

/** The panel; `change(chosen)` takes what is chosen now. */
export function panel(chosen, change) {
  const show = (name) => (event) => change({ ...chosen, shown: { ...chosen.shown, [name]: event.target.checked } });
  const toggled = (event) => { if (event.target.open !== chosen.open) change({ ...chosen, open: event.target.open }); };
  return html`
    <details class="viewer-panel" ?open=${chosen.open} @toggle=${toggled}>
      <summary>${t('viewer.layers')}</summary>
      ${LAYERS.map((name) => html`
        <label class="viewer-layer"><input type="checkbox" name=${name} .checked=${chosen.shown[name]} @change=${show(name)}>
          ${sample(SAMPLES[name])}<span>${t(`viewer.layer_${name}`)}</span></label>
        ${name === 'edges' ? html`<ul class="viewer-states" aria-label=${t('viewer.states')}>
          ${Object.keys(DASHES).map((state) => html`<li>${stateSample(state)}${t(`viewer.state_${state}`)}</li>`)}</ul>` : ''}`)}
      <label class="viewer-slider"><span>${t('viewer.magnification')} <span
        class="viewer-times">×${chosen.magnification}</span></span>
        <input type="range" name="magnification" min="0" max=${STEPS} .value=${String(toStep(chosen.magnification))}
          aria-valuetext=${`×${chosen.magnification}`}
          @input=${(event) => change({ ...chosen, magnification: fromStep(Number(event.target.value)) })}></label>
    </details>`;
}
