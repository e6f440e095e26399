// How sound a control point is, by what accepted images say of it: a word, a colour and a shape for each.

import { CircleStyle, Fill, RegularShape, Stroke } from '../../vendor/ol.js';
import { html, svg } from '../../vendor/lit.js';
import { colour } from '../../parts/colours.js';
import { t } from '../../texts.js';

/** The classes, the worst first. */
export const CLASSES = ['outdated', 'doubtful', 'unseen', 'good'];

/** The class of what the API says of a control point's health. */
export function classOf(health) {
  if (!health || !health.seen_in) return 'unseen';
  if (health.outdated) return 'outdated';
  return health.missed > 0 || health.contradicts > 0 ? 'doubtful' : 'good';
}

const SHAPES = {
  good: svg`<circle class="light-ground" cx="8" cy="8" r="5.5"></circle>`,
  doubtful: svg`<path class="light-ground" d="M8 1.5 15 14H1z"></path>`,
  outdated: svg`<path class="light-ground" d="M5 1h6l4 4v6l-4 4H5l-4-4V5z"></path>
    <path class="light-sign" d="M5.4 5.4l5.2 5.2M10.6 5.4l-5.2 5.2"></path>`,
  unseen: svg`<circle class="light-ring" cx="8" cy="8" r="5"></circle>`,
};
const LIGHTS = { good: 'green', doubtful: 'yellow', outdated: 'red', unseen: 'none' };

/** The shape of a class with its word, which only screen readers get if `quiet`. */
export function healthSign(name, { quiet = false } = {}) {
  return html`<svg class="light light-${LIGHTS[name]}" viewBox="0 0 16 16" aria-hidden="true">${SHAPES[name]}</svg><span
    class=${quiet ? 'unseen' : ''}>${t(`control.health_${name}`)}</span>`;
}

const fill = (name) => new Fill({ color: colour(name) });
const rim = (width = 1.5) => new Stroke({ color: colour('surface'), width });

/** The same shapes on the map. */
export const SYMBOLS = {
  good: (grow) => new CircleStyle({ radius: 5.5 + grow, fill: fill('green'), stroke: rim() }),
  doubtful: (grow) => new RegularShape({ points: 3, radius: 8.5 + grow, fill: fill('yellow'), stroke: rim() }),
  outdated: (grow) => new RegularShape({ points: 8, angle: Math.PI / 8, radius: 7.5 + grow, fill: fill('red'), stroke: rim() }),
  unseen: (grow) => new CircleStyle({ radius: 5 + grow, fill: fill('surface'),
    stroke: new Stroke({ color: colour('line-strong'), width: 2 }) }),
};
