// How things look in the viewer: each kind by colour and by dash pattern, with a dark halo, so that it shows on any
// ground and to the colour-blind. Every style is made once.

import { CircleStyle, Fill, RegularShape, Stroke, Style, Text } from '../../vendor/ol.js';
import { colour } from '../colours.js';

/** Dash patterns in px, by the state of a control point. */
export const DASHES = { matched: undefined, rejected: [10, 6], unmatched: [2, 6] };
const HALO = 'rgba(0,0,0,0.65)';
const EMPHASIS = { none: 0, hovered: 1, selected: 2 };

function strokes(tone, { width, dash, halo = HALO, zIndex = 0 }) {
  return [
    new Style({ stroke: new Stroke({ color: halo, width: width + 3 }), zIndex }),
    new Style({ stroke: new Stroke({ color: tone, width, lineDash: dash, lineCap: dash ? 'butt' : 'round' }),
      zIndex: zIndex + 0.5 }),
  ];
}

const MAKE = {
  edges: (state, emphasis) => [
    // what is chosen glows, whatever its colour
    ...(emphasis ? [new Style({ stroke: new Stroke({ color: 'rgba(255,255,255,0.85)', width: 5 + 1.5 * emphasis }),
      zIndex: 10 * emphasis })] : []),
    ...strokes(colour(state), { width: 2 + emphasis / 2, dash: DASHES[state], zIndex: 10 * emphasis }),
  ],
  segments: () => strokes(colour('segment'), { width: 1.5 }),
  residuals: () => [
    ...strokes('#fff', { width: 1.25 }),
    new Style({ geometry: (feature) => feature.get('tips'),
      image: new CircleStyle({ radius: 2.5, fill: new Fill({ color: '#fff' }),
        stroke: new Stroke({ color: '#000', width: 1 }) }) }),
  ],
  regions: (state, emphasis) => [
    ...strokes(colour('region'), { width: 1.25 + emphasis, dash: [6, 4] }),
    new Style({ geometry: (feature) => feature.get('predicted'), image: cross(colour('region'), 5) }),
  ],
  references: (state, emphasis) => [new Style({
    image: new CircleStyle({ radius: 5 + emphasis, fill: new Fill({ color: 'rgba(0,0,0,0.35)' }),
      stroke: new Stroke({ color: colour(state), width: 2 }) }),
    zIndex: emphasis,
  })],
  handles: (state, emphasis) => [new Style({
    image: new RegularShape({ points: 4, radius: 9 + emphasis, fill: new Fill({ color: 'rgba(0,0,0,0.45)' }),
      stroke: new Stroke({ color: colour('corrected'), width: 2.5 }) }),
    zIndex: emphasis,
  })],
};

function cross(tone, radius) {
  return new RegularShape({ points: 4, radius, radius2: 0, angle: Math.PI / 4, stroke: new Stroke({ color: tone, width: 2 }) });
}

function nameStyle(name, emphasis) {
  return new Style({
    text: new Text({
      text: name, font: `${emphasis ? 600 : 400} 13px system-ui, sans-serif`, offsetY: -16, overflow: true,
      fill: new Fill({ color: '#fff' }), stroke: new Stroke({ color: 'rgba(0,0,0,0.85)', width: 3.5 }),
    }),
    zIndex: emphasis,
  });
}

/** The style function of all layers; `emphasisOf(name)` is `none`, `hovered` or `selected`. */
export function styles(emphasisOf) {
  const made = new Map();
  return (feature) => {
    const { role, state, name } = feature.getProperties();
    const emphasis = EMPHASIS[emphasisOf(name)];
    const key = role === 'names' ? `names ${emphasis} ${name}` : `${role} ${state} ${emphasis}`;
    if (!made.has(key)) made.set(key, role === 'names' ? nameStyle(name, emphasis) : MAKE[role](state, emphasis));
    return made.get(key);
  };
}
