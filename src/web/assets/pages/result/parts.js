// What draws itself into elements of the page: the map, and the window of the chosen control point.

import { nothing, render } from '../../vendor/lit.js';
import { groundMap } from './map.js';
import { stateOf } from './figures.js';
import { showWindow } from './window.js';

/** Keeps these parts; `choose(name)` goes to a control point. */
export function parts({ choose, stopped }) {
  const map = { element: undefined, drawn: undefined, of: undefined };
  const detail = { element: undefined, key: undefined, running: new AbortController() };

  function attachMap(element, shown, chosen) {
    if (element !== map.element) {
      map.drawn?.end();
      Object.assign(map, { element, drawn: element && groundMap(element, choose), of: undefined });
    }
    if (!map.drawn) return;
    if (map.of !== shown.map) {
      map.of = shown.map;
      map.drawn.draw(shown.map);
    }
    map.drawn.select(chosen);
  }

  function attachDetail(element, { id, orientation, chosen }, shown) {
    const key = element && chosen !== undefined ? chosen : undefined;
    if (element === detail.element && key === detail.key) return;
    detail.running.abort();
    Object.assign(detail, { element, key, running: new AbortController() });
    if (!element) return;
    const point = key === undefined ? undefined : shown.result.control_points.find((entry) => entry.name === key);
    if (!point) { render(nothing, element); return; }
    const drawn = { located_px: point.located_px, state: stateOf(point, shown.drawing) };
    showWindow(element, { id, image: orientation.image, name: key, drawn,
      signal: AbortSignal.any([stopped, detail.running.signal]) });
  }

  return {
    /** To be called after each drawing of the page. */
    attach: (place, state, shown) => {
      attachMap(place.querySelector('.result-map') ?? undefined, shown, state.chosen);
      attachDetail(place.querySelector('.point-detail') ?? undefined, state, shown);
    },
    end: () => { map.drawn?.end(); detail.running.abort(); },
  };
}
