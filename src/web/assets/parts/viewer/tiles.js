// The picture itself: tiles of 512 px from the level that fits one tile down to the pixels of the file.

import { Projection, TileGrid, TileImage, TileLayer } from '../../vendor/ol.js';
import { api } from '../../api.js';

const TILE_PX = 512;

/** The highest level of reduction: the first at which the longer side fits one tile. */
export const highestLevel = ({ width_px, height_px }) => Math.max(0, Math.ceil(Math.log2(Math.max(width_px, height_px) / TILE_PX)));

/** The plane of an image: pixels, y upwards from 0 at the upper rim. */
export function plane({ width_px, height_px }) {
  return new Projection({ code: 'gable-image', units: 'pixels', extent: [0, -height_px, width_px, 0] });
}

// tiles at the right and the lower rim are smaller: as they are they would be drawn as wide as the others
function load(tile, address) {
  const picture = new Image();
  picture.onload = () => {
    const canvas = document.createElement('canvas');
    canvas.width = TILE_PX;
    canvas.height = TILE_PX;
    canvas.getContext('2d').drawImage(picture, 0, 0);
    tile.setImage(canvas);
  };
  picture.onerror = () => tile.setState(3);
  picture.src = address;
}

/** The layer of an image's tiles. */
export function tileLayer(image, projection) {
  const highest = highestLevel(image);
  const extent = projection.getExtent();
  const tileGrid = new TileGrid({
    extent, origin: [0, 0], tileSize: TILE_PX,
    resolutions: Array.from({ length: highest + 1 }, (_, z) => 2 ** (highest - z)),
  });
  const source = new TileImage({
    projection, tileGrid, transition: 0, tileLoadFunction: load,
    tileUrlFunction: ([z, column, row]) => api.address(`/images/${image.id}/tiles/${highest - z}/${column}/${row}`),
  });
  const layer = new TileLayer({ source, extent, zIndex: 0 });
  // beyond 1:1 pixels are squares, which one can count; below it they are averaged
  layer.on('prerender', ({ context, frameState }) => { context.imageSmoothingEnabled = frameState.viewState.resolution >= 1; });
  layer.on('postrender', ({ context }) => { context.imageSmoothingEnabled = true; });
  return layer;
}
