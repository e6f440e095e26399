// The image viewer: an aerial image of any size, and over it what was projected into it and found in it.

import { html, render } from '../vendor/lit.js';
import { boundingExtent, buffer, interactions, Map as OlMap, Overlay, View } from '../vendor/ol.js';
import { number, percent, t } from '../texts.js';
import { way } from './motion.js';
import { barLength, edgesOf, extentOf, flip } from './viewer/geometry.js';
import { fill, fillHandles, LAYERS, vectorLayers } from './viewer/layers.js';
import { moving } from './viewer/moving.js';
import { keep, kept, panel } from './viewer/panel.js';
import { styles } from './viewer/styles.js';
import { highestLevel, plane, tileLayer } from './viewer/tiles.js';

const NEAREST = 1 / 32;

function skeleton(place) {
  render(html`
    <div class="viewer">
      <div class="viewer-map" tabindex="0" role="application" aria-label=${t('viewer.label')} aria-describedby="viewer-keys"></div>
      <p class="unseen" id="viewer-keys">${t('viewer.keys')}</p>
      <div class="viewer-over"></div>
      <div class="viewer-foot"></div>
    </div>`, place);
  return ['.viewer-map', '.viewer-over', '.viewer-foot'].map((part) => place.querySelector(part));
}

function viewOf(image, projection) {
  const extent = projection.getExtent();
  return new View({
    projection, center: [image.width_px / 2, -image.height_px / 2], showFullExtent: true,
    // control points that were predicted outside of it can be looked at too
    extent: buffer(extent, Math.max(image.width_px, image.height_px)), constrainOnlyCenter: true,
    maxResolution: 2 ** (highestLevel(image) + 1.5), minResolution: NEAREST,
  });
}

/**
 * Shows `image` (`{id, width_px, height_px}`) in `place`. `select(name)` is called for a click on a control point, or
 * beside all with undefined; `hover(name)` when the pointer comes to one. What it returns draws, zooms and ends it.
 */
export function viewer(place, { image, select = () => {}, hover = () => {} }) {
  const [target, over, foot] = skeleton(place);
  const projection = plane(image);
  const view = viewOf(image, projection);
  const marked = { selected: undefined, hovered: undefined };
  const emphasisOf = (name) => (name === undefined ? 'none' : name === marked.selected ? 'selected' : name === marked.hovered
    ? 'hovered' : 'none');
  const layers = vectorLayers(styles(emphasisOf));
  const map = new OlMap({ target, view, controls: [], interactions: interactions({ zoomDuration: way(150) }),
    layers: [tileLayer(image, projection), ...Object.values(layers)] });
  let chosen = kept();
  let drawing;
  let pointer;
  let mover = null;

  const fit = () => view.fit(projection.getExtent(), { padding: [12, 12, 12, 12] });
  const refresh = () => Object.values(layers).forEach((layer) => layer.changed());
  const show = () => LAYERS.forEach((name) => layers[name].setVisible(chosen.shown[name]));
  const choose = (next) => {
    const magnified = next.magnification !== chosen.magnification;
    chosen = next;
    keep(chosen);
    show();
    if (magnified) fill(layers.residuals, 'residuals', drawing, chosen.magnification);
    render(panel(chosen, choose), over);
  };
  const zoomBy = (factor) => view.animate({ resolution: view.getResolution() / factor, duration: way(150) });
  const readOut = () => {
    const [x, y] = flip(pointer ?? view.getCenter());
    const resolution = view.getResolution() ?? 1;
    const length = barLength(resolution);
    render(html`
      <button type="button" aria-label=${t('viewer.nearer')} title=${t('viewer.nearer')} @click=${() => zoomBy(2)}>+</button>
      <button type="button" aria-label=${t('viewer.farther')} title=${t('viewer.farther')} @click=${() => zoomBy(0.5)}>−</button>
      <button type="button" title=${t('viewer.whole_title')} @click=${fit}>${t('viewer.whole')}</button>
      <button type="button" title=${t('viewer.one_title')}
        @click=${() => view.animate({ resolution: 1, duration: way(150) })}>1:1</button>
      <span class="viewer-read"><span class="quiet-text">${t(pointer ? 'viewer.pointer' : 'viewer.centre')}</span>
        <span class="viewer-x" data-x=${x.toFixed(3)}>x ${number(x, 1, { exactly: true })}</span>
        <span class="viewer-y" data-y=${y.toFixed(3)}>y ${number(y, 1, { exactly: true })} px</span></span>
      <span class="viewer-zoom">${percent(1 / resolution, resolution > 4 ? 1 : 0)}</span>
      <span class="viewer-bar" role="img" aria-label=${t('viewer.bar',
        { length: number(length) })}><span></span>${number(length)} px</span>`, foot);
    foot.querySelector('.viewer-bar span').style.width = `${length / resolution}px`;
  };

  const nameAt = (pixel) => map.forEachFeatureAtPixel(pixel, (feature) => feature.get('name'), {
    hitTolerance: 6, layerFilter: (layer) => layer !== layers.regions && layer !== layers.residuals,
  });
  const mark = (which, name) => {
    if (marked[which] === name) return;
    marked[which] = name;
    refresh();
  };
  map.on('pointermove', (event) => {
    pointer = event.coordinate;
    readOut();
    if (event.dragging) return;
    const name = nameAt(event.pixel);
    target.classList.toggle('on-point', name !== undefined);
    if (name !== marked.hovered) { mark('hovered', name); hover(name); }
  });
  map.on('singleclick', (event) => select(nameAt(event.pixel)));
  const out = () => {
    pointer = undefined;
    readOut();
    if (marked.hovered === undefined) return;
    mark('hovered', undefined);
    hover(undefined);
  };
  target.addEventListener('pointerleave', out);
  target.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const act = { 0: fit, 1: () => view.setResolution(1), Escape: () => select(undefined) }[event.key];
    if (act) { event.preventDefault(); act(); }
  });
  view.on('change', readOut);
  render(panel(chosen, choose), over);
  show();
  // the first size is there only after the page's layout
  map.once('change:size', fit);
  fit();
  readOut();

  const draw = (next) => {
    drawing = next;
    for (const name of LAYERS) fill(layers[name], name, drawing, chosen.magnification);
    fillHandles(layers.handles, mover ? drawing : undefined);
  };
  return {
    /** Draws `drawing`, as `/orientations/{id}/drawing` gives it. */
    draw,
    fit,
    /** Marks a control point as chosen. */
    select: (name) => mark('selected', name),
    /** Marks a control point as pointed to. */
    hover: (name) => mark('hovered', name),
    /** Shows a control point large. */
    zoomTo: (name) => {
      const index = drawing?.control_points.findIndex((point) => point.name === name) ?? -1;
      const extent = index >= 0 && extentOf(drawing.control_points[index], edgesOf(drawing, index));
      if (!extent) return;
      const box = boundingExtent([flip([extent[0], extent[1]]), flip([extent[2], extent[3]])]);
      view.fit(buffer(box, 60), { padding: [60, 60, 60, 60], duration: way(250), minResolution: 0.25 });
    },
    /** Shows the surroundings of a pixel. */
    centreOn: (at_px, resolution = 1) => view.animate({ center: flip(at_px),
      resolution: Math.min(resolution, view.getResolution()), duration: way(250) }),
    /** Lets reference points be dragged: `moved(name, at_px)`; null ends that. */
    correct: (moved) => {
      if (mover) map.removeInteraction(mover);
      mover = moved && moving(layers, moved);
      if (mover) map.addInteraction(mover);
      fillHandles(layers.handles, mover ? drawing : undefined);
    },
    /** Puts an element beside a pixel; returns what moves it, or with undefined hides it. */
    beside: (element) => {
      const overlay = new Overlay({ element, offset: [14, 14], stopEvent: true });
      map.addOverlay(overlay);
      return (at_px) => overlay.setPosition(at_px && flip(at_px));
    },
    end: () => map.setTarget(undefined),
  };
}
