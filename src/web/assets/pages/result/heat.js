// The accumulator of a control point as a heat map: viridis, which is even to the eye and to the colour-blind.

const VIRIDIS = ['440154', '482878', '3e4a89', '31688e', '26828e', '1f9e89', '35b779', '6dcd59', 'b4de2c', 'fde725']
  .map((hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16)));

/** Red, green, blue of a share from 0 to 1. */
export function viridis(share) {
  const at = Math.min(1, Math.max(0, share)) * (VIRIDIS.length - 1);
  const low = Math.min(VIRIDIS.length - 2, Math.floor(at));
  return VIRIDIS[low].map((value, k) => Math.round(value + (at - low) * (VIRIDIS[low + 1][k] - value)));
}

/** The least and the largest value that there is. */
export function range(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) if (Number.isFinite(value)) [low, high] = [Math.min(low, value), Math.max(high, value)];
  return low < high ? [low, high] : [low, low + 1];
}

/** The pixel that a cell (column, row) of an accumulator stands for. */
export function placeOfCell({ centre_px, cell_px, size }, column, row) {
  return [centre_px[0] + cell_px * (column - size / 2 + 0.5), centre_px[1] + cell_px * (row - size / 2 + 0.5)];
}

/** The cell, in parts of one, of a pixel. */
export function cellOfPlace({ centre_px, cell_px, size }, [x, y]) {
  return [(x - centre_px[0]) / cell_px + size / 2 - 0.5, (y - centre_px[1]) / cell_px + size / 2 - 0.5];
}

function paint({ size, values }) {
  const [low, high] = range(values);
  const picture = new ImageData(size, size);
  values.forEach((value, k) => picture.data.set([...viridis((value - low) / (high - low)), 255], 4 * k));
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [size, size];
  canvas.getContext('2d').putImageData(picture, 0, 0);
  return canvas;
}

function ring(context, x, y, radius, text) {
  for (const [tone, width] of [['#000', 6], ['#fff', 3]]) {
    context.strokeStyle = tone;
    context.lineWidth = width;
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.stroke();
  }
  context.font = '600 22px system-ui, sans-serif';
  context.lineWidth = 5;
  context.strokeStyle = '#000';
  context.fillStyle = '#fff';
  context.strokeText(text, x + radius + 5, y + 8);
  context.fillText(text, x + radius + 5, y + 8);
}

/** Draws it into a canvas, with its peaks numbered, and `cursor` (column, row) framed. */
export function drawHeat(canvas, accumulator, cursor) {
  const context = canvas.getContext('2d');
  const scale = canvas.width / accumulator.size;
  context.imageSmoothingEnabled = false;
  context.drawImage(paint(accumulator), 0, 0, canvas.width, canvas.height);
  accumulator.peaks.forEach((peak, k) => {
    const [column, row] = cellOfPlace(accumulator, peak.at_px);
    ring(context, (column + 0.5) * scale, (row + 0.5) * scale, 13, String(k + 1));
  });
  if (!cursor) return;
  for (const [tone, grow] of [['#000', 2], ['#fff', 1]]) {
    context.strokeStyle = tone;
    context.lineWidth = 1;
    context.strokeRect(cursor[0] * scale - grow, cursor[1] * scale - grow, scale + 2 * grow, scale + 2 * grow);
  }
}

/** Draws the scale of colours from left to right. */
export function drawScale(canvas) {
  const context = canvas.getContext('2d');
  for (let x = 0; x < canvas.width; x += 1) {
    context.fillStyle = `rgb(${viridis(x / (canvas.width - 1)).join(' ')})`;
    context.fillRect(x, 0, 1, canvas.height);
  }
}
