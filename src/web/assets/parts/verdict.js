// The traffic light. Each verdict has a shape of its own besides its colour, so that nobody has to tell colours apart.

import { html, nothing, svg } from '../vendor/lit.js';
import { t } from '../texts.js';

// a disc with a tick, a triangle with an exclamation mark, an octagon with a cross, an empty ring
const SHAPES = {
  green: svg`<circle class="light-ground" cx="8" cy="8" r="7"></circle><path class="light-sign" d="M4.6 8.3l2.3 2.4 4.4-5"></path>`,
  yellow: svg`<path class="light-ground" d="M8 .8 15.6 14.4H.4z"></path><path class="light-sign" d="M8 5.4v4.2M8 11.6v.8"></path>`,
  red: svg`<path class="light-ground" d="M5 .8h6L15.2 5v6L11 15.2H5L.8 11V5z"></path><path class="light-sign" d="M5.4 5.4l5.2 5.2M10.6 5.4l-5.2 5.2"></path>`,
  none: svg`<circle class="light-ring" cx="8" cy="8" r="6.2"></circle>`,
};

function known(name) {
  return name in SHAPES ? name : 'none';
}

/** The shape of a verdict alone; `spoken` gives it its word for those who do not see it. */
export function light(name, { spoken = true } = {}) {
  const verdict = known(name);
  return html`<svg class="light light-${verdict}" viewBox="0 0 16 16" role=${spoken ? 'img' : nothing}
    aria-label=${spoken ? t(`verdict.${verdict}`) : nothing} aria-hidden=${spoken ? nothing : 'true'}>${SHAPES[verdict]}</svg>`;
}

/** The shape of a verdict (`green`, `yellow`, `red`, anything else: none yet) and its word. */
export function verdict(name) {
  return html`<span class="verdict verdict-${known(name)}">${light(name, { spoken: false })}<span>${t(`verdict.${known(name)}`)}</span></span>`;
}
