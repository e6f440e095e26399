// The map of the control: points by their health, their lines where one is near, scenes, and clusters where one is far.

import {
  boundingExtent, CircleStyle, Cluster, controls, Feature, Fill, fromLonLat, GeoJSON, interactions, Map as OlMap,
  Point, RegularShape, ScaleLine, Stroke, Style, Text, transformExtent, VectorLayer, VectorSource, View,
} from '../../vendor/ol.js';
import { colour, onTheme } from '../../parts/colours.js';
import { graticule } from '../../parts/graticule.js';
import { way } from '../../parts/motion.js';
import { t } from '../../texts.js';
import { CLASSES, classOf, SYMBOLS } from './health.js';

const GEOJSON = new GeoJSON({ featureProjection: 'EPSG:3857' });
// metres of the map a pixel, below which the lines themselves are seen
const LINES_BELOW = 1.5;
const CLUSTER_PX = 30;

function symbol(name, chosen) {
  const style = new Style({ image: SYMBOLS[name](chosen ? 2.5 : 0), zIndex: chosen ? 5 : 0 });
  if (!chosen) return style;
  return [new Style({ image: new CircleStyle({ radius: 15, stroke: new Stroke({ color: colour('focus'), width: 3 }) }),
    zIndex: 5 }), style];
}

// a cluster is coloured by the worst that is in it
function cluster(worst, count) {
  const tone = { outdated: 'red', doubtful: 'yellow', unseen: 'line-strong', good: 'green' }[worst];
  return new Style({
    image: new CircleStyle({ radius: 11 + Math.min(8, Math.log2(count)), fill: new Fill({ color: colour('surface') }),
      stroke: new Stroke({ color: colour(tone), width: 3 }) }),
    text: new Text({ text: String(count), font: '600 12px system-ui, sans-serif', fill: new Fill({ color: colour('ink') }) }),
  });
}

const MAKE = {
  lines: () => [new Style({ stroke: new Stroke({ color: colour('ink'), width: 4 }) }),
    new Style({ stroke: new Stroke({ color: colour('matched'), width: 2 }) })],
  scene: (key, chosen) => new Style({ image: new RegularShape({ points: 4, angle: Math.PI / 4, radius: chosen ? 12 : 9,
    fill: new Fill({ color: colour('surface') }),
      stroke: new Stroke({ color: colour(chosen ? 'focus' : 'region'), width: 3 }) }) }),
};

/** A map in `target`: `moved(bbox)` with west, south, east, north in degrees, `choose({kind, name, set})` for a click. */
export function controlMap(target, { moved, choose }) {
  let made = new Map();
  let chosen;
  const cached = (key, make) => { if (!made.has(key)) made.set(key, make()); return made.get(key); };
  const isChosen = (kind, name) => chosen?.kind === kind && chosen.name === name;

  const points = new VectorSource();
  const lines = new VectorSource();
  const scenes = new VectorSource();
  const clustered = new Cluster({ source: points, distance: CLUSTER_PX });
  const pointStyle = (feature) => {
    const inside = feature.get('features');
    const worst = CLASSES.find((name) => inside.some((point) => point.get('health') === name));
    if (inside.length > 1) return cached(`cluster ${worst} ${inside.length}`, () => cluster(worst, inside.length));
    const marked = isChosen('point', inside[0].get('name'));
    return cached(`point ${worst} ${marked}`, () => symbol(worst, marked));
  };
  const layers = {
    lines: new VectorLayer({ source: lines, maxResolution: LINES_BELOW, style: () => cached('lines', MAKE.lines), zIndex: 1 }),
    points: new VectorLayer({ source: clustered, style: pointStyle, zIndex: 3 }),
    scenes: new VectorLayer({ source: scenes, zIndex: 2,
      style: (feature) => { const marked = isChosen('scene', feature.get('name')); return cached(`scene ${marked}`,
        () => MAKE.scene('', marked)); } }),
  };
  const map = new OlMap({
    target, layers: [graticule(), ...Object.values(layers)], view: new View({ center: [0, 0], zoom: 2, maxZoom: 25 }),
    interactions: interactions({ zoomDuration: way(150) }),
    controls: controls({ attribution: false, rotate: false, zoomOptions: { zoomInTipLabel: t('viewer.nearer'),
      zoomOutTipLabel: t('viewer.farther') } }).extend([new ScaleLine()]),
  });
  const view = map.getView();
  const bbox = () => transformExtent(view.calculateExtent(map.getSize()), 'EPSG:3857', 'EPSG:4326')
    .map((value, k) => Math.min(k % 2 ? 89.9 : 180, Math.max(k % 2 ? -89.9 : -180, value)));
  map.on('moveend', () => { if (map.getSize()?.every(Boolean)) moved(bbox()); });
  map.on('singleclick', ({ pixel }) => {
    const hit = map.forEachFeatureAtPixel(pixel, (feature) => feature, { hitTolerance: 5 });
    const inside = hit?.get('features');
    if (inside?.length > 1) {
      view.fit(boundingExtent(inside.map((point) => point.getGeometry().getCoordinates())),
        { padding: [80, 80, 80, 80], duration: way(250), minResolution: 0.05 });
      return;
    }
    const feature = inside?.[0] ?? hit;
    choose(feature ? { kind: feature.get('kind'), name: feature.get('name'), set: feature.get('set') } : undefined);
  });
  const stopTheme = onTheme(() => {
    made = new Map();
    map.getLayers().setAt(0, graticule());
    Object.values(layers).forEach((layer) => layer.changed());
  });

  return {
    /** Shows GeoJSON features of control points, each with its health. */
    points: (features) => {
      points.clear(true);
      lines.clear(true);
      points.addFeatures(features.map(({ properties }) => new Feature({
        geometry: new Point(fromLonLat(properties.reference)), kind: 'point', name: properties.name,
          set: properties.set, health: classOf(properties.health),
      })));
      lines.addFeatures(features.map((feature) => {
        const read = new Feature({ geometry: GEOJSON.readGeometry(feature.geometry), kind: 'point',
          name: feature.properties.name, set: feature.properties.set });
        return read;
      }));
    },
    /** Shows control scenes, as the API lists them in EPSG:4979. */
    scenes: (list) => {
      scenes.clear(true);
      scenes.addFeatures(list.map((scene) => new Feature({ geometry: new Point(fromLonLat(scene.reference.coordinates)),
        kind: 'scene', name: scene.name })));
    },
    choose: (next) => {
      chosen = next;
      Object.values(layers).forEach((layer) => layer.changed());
    },
    /** Brings a rectangle (west, south, east, north) into view. */
    fit: (box) => view.fit(transformExtent(box, 'EPSG:4326', 'EPSG:3857'), { padding: [40, 40, 40, 40], minResolution: 0.02 }),
    /** Brings a place (longitude, latitude) into view, near. */
    goTo: (place) => view.animate({ center: fromLonLat(place), resolution: Math.min(view.getResolution(), 0.12),
      duration: way(300) }),
    reload: () => moved(bbox()),
    end: () => { stopTheme(); map.setTarget(undefined); },
  };
}
