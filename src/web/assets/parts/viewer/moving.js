// Drags the reference point of a control point to where it is; its edges move along meanwhile.

import { Pointer } from '../../vendor/ol.js';
import { flip } from './geometry.js';

/**
 * The interaction. `layers` are those of the viewer; `moved(name, at_px)` is called once, at the end of a drag, and not
 * for a click that moves nothing.
 */
export function moving(layers, moved) {
  let drag = null;
  const handleAt = ({ map, pixel }) => map.forEachFeatureAtPixel(pixel, (feature) => feature, {
    hitTolerance: 8, layerFilter: (layer) => layer === layers.handles,
  });
  const travel = (by) => {
    for (const feature of drag.along) {
      feature.getGeometry().translate(...by);
      feature.get('predicted')?.translate(...by);
    }
  };
  return new Pointer({
    handleDownEvent: (event) => {
      const handle = handleAt(event);
      if (!handle) return false;
      const name = handle.get('name');
      const along = ['handles', 'edges', 'references', 'names'].flatMap((layer) => layers[layer].getSource().getFeatures())
        .filter((feature) => feature.get('name') === name);
      drag = { handle, name, along, last: event.coordinate, far: false, start: event.pixel };
      // residuals say nothing while it moves
      layers.residuals.getSource().getFeatures().filter((feature) => feature.get('name') === name)
        .forEach((feature) => layers.residuals.getSource().removeFeature(feature));
      return true;
    },
    handleDragEvent: (event) => {
      drag.far ||= Math.hypot(event.pixel[0] - drag.start[0], event.pixel[1] - drag.start[1]) > 3;
      travel([event.coordinate[0] - drag.last[0], event.coordinate[1] - drag.last[1]]);
      drag.last = event.coordinate;
    },
    handleUpEvent: () => {
      const { handle, name, far } = drag;
      drag = null;
      moved(name, far ? flip(handle.getGeometry().getCoordinates()) : undefined);
      return false;
    },
  });
}
