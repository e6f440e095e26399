// The map of an orientation: what the image covers, where the camera stood, where the control lies. There is no
// background, as these pages work without any network: a graticule and a scale stand for it.

import {
  CircleStyle, controls, Fill, GeoJSON, interactions, Map as OlMap, RegularShape, ScaleLine, Stroke, Style,
  VectorLayer, VectorSource, View, isEmpty,
} from '../../vendor/ol.js';
import { colour, onTheme } from '../../parts/colours.js';
import { graticule } from '../../parts/graticule.js';
import { way } from '../../parts/motion.js';
import { DASHES } from '../../parts/viewer/styles.js';
import { t } from '../../texts.js';

const GEOJSON = new GeoJSON({ featureProjection: 'EPSG:3857' });
const ROLES = ['footprint', 'control_point', 'grid_point', 'error_ellipse', 'approximation', 'projection_centre'];

const MAKE = {
  footprint: () => new Style({ stroke: new Stroke({ color: colour('accent'), width: 1.5 }),
    fill: new Fill({ color: `${colour('accent')}18` }) }),
  control_point: ({ state, selected }) => [
    new Style({ stroke: new Stroke({ color: selected ? colour('focus') : colour('ink'), width: selected ? 7 : 4.5 }) }),
    new Style({ stroke: new Stroke({ color: colour(state), width: 2.5, lineDash: DASHES[state] }),
      image: new RegularShape({ points: 4, angle: Math.PI / 4, radius: 7, fill: new Fill({ color: colour(state) }),
        stroke: new Stroke({ color: colour(selected ? 'focus' : 'ink'), width: 1.5 }) }) }),
  ],
  grid_point: ({ over }) => new Style({
    image: over ? new RegularShape({ points: 3, radius: 6, fill: new Fill({ color: colour('red') }),
      stroke: new Stroke({ color: colour('surface'), width: 1 }) })
      : new CircleStyle({ radius: 3.5, fill: new Fill({ color: colour('green') }),
        stroke: new Stroke({ color: colour('surface'), width: 1 }) }),
  }),
  error_ellipse: () => new Style({ stroke: new Stroke({ color: colour('ink'), width: 1.5, lineDash: [4, 3] }) }),
  approximation: () => new Style({ image: new RegularShape({ points: 4, radius: 8, radius2: 0, angle: Math.PI / 4,
    stroke: new Stroke({ color: colour('ink-quiet'), width: 2.5 }) }) }),
  projection_centre: () => new Style({ image: new RegularShape({ points: 3, radius: 8, fill: new Fill({ color: colour('ink') }),
    stroke: new Stroke({ color: colour('surface'), width: 1.5 }) }) }),
};

function styleOf(made, selected) {
  return (feature) => {
    const { role, state, name, sigma_planimetric_m, tolerance_m } = feature.getProperties();
    const look = { state, selected: name !== undefined && name === selected(), over: sigma_planimetric_m > tolerance_m };
    const key = JSON.stringify([role, look]);
    if (!made.has(key)) {
      const style = [MAKE[role]?.(look) ?? []].flat();
      style.forEach((part) => part.setZIndex(ROLES.indexOf(role)));
      made.set(key, style);
    }
    return made.get(key);
  };
}

/** A map in `target`; `choose(name)` is called for a click on a control point. */
export function groundMap(target, choose) {
  const made = new Map();
  let selected;
  const source = new VectorSource();
  const layer = new VectorLayer({ source, style: styleOf(made, () => selected), zIndex: 1 });
  const map = new OlMap({
    target, view: new View({ center: [0, 0], zoom: 2, maxZoom: 26 }), layers: [graticule(), layer],
    interactions: interactions({ zoomDuration: way(150) }),
      controls: controls({ attribution: false, rotate: false, zoomOptions: { zoomInTipLabel: t('viewer.nearer'),
        zoomOutTipLabel: t('viewer.farther') } }).extend([new ScaleLine()]),
  });
  const stopTheme = onTheme(() => {
    made.clear();
    map.getLayers().setAt(0, graticule());
    layer.changed();
  });
  map.on('singleclick', ({ pixel }) => {
    const name = map.forEachFeatureAtPixel(pixel, (feature) => feature.get('name'), { hitTolerance: 6 });
    if (name !== undefined) choose(name);
  });
  const fit = () => { if (!isEmpty(source.getExtent())) map.getView().fit(source.getExtent(),
    { padding: [30, 30, 30, 30], maxZoom: 25 }); };
  map.once('change:size', fit);
  return {
    /** Shows a GeoJSON collection; the first one is brought into view. */
    draw: (collection) => {
      const first = source.isEmpty();
      source.clear(true);
      if (collection) source.addFeatures(GEOJSON.readFeatures(collection));
      if (first) fit();
    },
    select: (name) => { selected = name; layer.changed(); },
    end: () => { stopTheme(); map.setTarget(undefined); },
  };
}
