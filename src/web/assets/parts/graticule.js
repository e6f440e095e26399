// What stands for a background on maps, as the pages work without any network.

import { Fill, Graticule, Stroke, Text } from '../vendor/ol.js';
import { colour } from './colours.js';

const INTERVALS_DEG = [45, 30, 20, 10, 5, 2, 1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002, 0.0001,
  0.00005, 0.00002, 0.00001];

function label(textAlign) {
  return new Text({
    font: '11px system-ui, sans-serif', textBaseline: 'bottom', textAlign,
    fill: new Fill({ color: colour('ink-quiet') }), stroke: new Stroke({ color: colour('ground'), width: 3 }),
  });
}

const written = (degrees) => `${Number(degrees.toFixed(5))}°`;

/** A layer of longitudes and latitudes in the colours of the theme as it is now. */
export function graticule() {
  return new Graticule({
    strokeStyle: new Stroke({ color: colour('line'), width: 1 }), showLabels: true, wrapX: false, targetSize: 110,
      intervals: INTERVALS_DEG,
    lonLabelStyle: label('start'), latLabelStyle: label('end'), lonLabelFormatter: written, latLabelFormatter: written,
  });
}
