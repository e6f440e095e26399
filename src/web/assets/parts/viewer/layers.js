// The layers over the picture: one feature for each control point and kind, so that thousands of lines are few features.

import { Feature, LineString, MultiLineString, MultiPoint, Point, Polygon, VectorLayer, VectorSource } from '../../vendor/ol.js';
import { edgesOf, ellipse, flip, placeOf, residuals } from './geometry.js';

/** The layers from the lowest to the highest, as they may be switched on and off. */
export const LAYERS = ['regions', 'edges', 'segments', 'residuals', 'references', 'names'];

const lines = (pairs) => new MultiLineString(pairs.map((pair) => pair.map(flip)));

function feature(role, point, geometry, more = {}) {
  return new Feature({ geometry, role, name: point.name, state: point.state, ...more });
}

const MAKE = {
  regions: (point) => {
    const at = point.predicted_px ?? point.search_region?.centre_px;
    if (!at) return undefined;
    const outline = point.search_region ? new Polygon([ellipse(point.search_region).map(flip)])
      : new LineString([flip(at), flip(at)]);
    return feature('regions', point, outline, { predicted: new Point(flip(at)) });
  },
  edges: (point, edges) => edges.length ? feature('edges', point, lines(edges.map((edge) => edge.projected_px))) : undefined,
  segments: (point, edges) => {
    const segments = edges.flatMap((edge) => edge.matched_px);
    return segments.length ? feature('segments', point, lines(segments)) : undefined;
  },
  residuals: (point, edges, magnification) => {
    const vectors = residuals(point, edges, magnification);
    if (!vectors.length) return undefined;
    return feature('residuals', point, lines(vectors), { tips: new MultiPoint(vectors.map(([, to]) => flip(to))) });
  },
  references: (point) => {
    const at = point.located_px ?? point.projected_px ?? point.predicted_px;
    return at ? feature('references', point, new Point(flip(at))) : undefined;
  },
  names: (point, edges) => {
    const at = placeOf(point, edges);
    return at ? feature('names', point, new Point(flip(at))) : undefined;
  },
};

/** Vector layers by their names, all empty, drawn by `style`. */
export function vectorLayers(style) {
  return Object.fromEntries([...LAYERS, 'handles'].map((name, level) => [name, new VectorLayer({
    source: new VectorSource(), style, zIndex: level + 1, declutter: name === 'names',
    // what is under the pointer must follow it at once
    updateWhileInteracting: true,
  })]));
}

/** Fills one layer from a drawing. */
export function fill(layer, name, drawing, magnification) {
  const source = layer.getSource();
  source.clear(true);
  if (!drawing) return;
  const features = drawing.control_points.map((point, index) => MAKE[name](point, edgesOf(drawing, index), magnification));
  source.addFeatures(features.filter(Boolean));
}

/** Fills the layer of the handles by which reference points are moved. */
export function fillHandles(layer, drawing) {
  const source = layer.getSource();
  source.clear(true);
  const features = (drawing?.control_points ?? []).map((point, index) => {
    const at = placeOf(point, edgesOf(drawing, index));
    return at && feature('handles', point, new Point(flip(at)));
  });
  source.addFeatures(features.filter(Boolean));
}
