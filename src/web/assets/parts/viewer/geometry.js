// From pixels of the file (x right, y down) to the plane of the viewer (y up), and what is computed of a drawing.

/** A pixel in the plane of the viewer; its own inverse. */
export const flip = ([x, y]) => [x, -y];

const middle = ([a, b]) => [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];

/** The outline of a search region as pixels; the angle of its first axis is from x towards y (down). */
export function ellipse({ centre_px: [x, y], semi_axes_px: [a, b], angle_deg }) {
  const [cos, sin] = [Math.cos(angle_deg * Math.PI / 180), Math.sin(angle_deg * Math.PI / 180)];
  return Array.from({ length: 73 }, (_, k) => {
    const [u, v] = [a * Math.cos(k * Math.PI / 36), b * Math.sin(k * Math.PI / 36)];
    return [x + u * cos - v * sin, y + u * sin + v * cos];
  });
}

/** The edges of control point `index`. */
export const edgesOf = (drawing, index) => drawing.edges.filter((edge) => edge.control_point === index);

/** Where a control point stands in the image: found, else projected, else the middle of its edges, else predicted. */
export function placeOf(point, edges) {
  const ends = edges.flatMap((edge) => edge.projected_px);
  const mean = ends.length
    ? [0, 1].map((axis) => ends.reduce((sum, end) => sum + end[axis], 0) / ends.length) : undefined;
  return point.located_px ?? point.projected_px ?? mean ?? point.predicted_px;
}

/** The rectangle `[x0, y0, x1, y1]` of all that is drawn of a control point; undefined for nothing. */
export function extentOf(point, edges) {
  const all = [...edges.flatMap((edge) => [...edge.projected_px, ...edge.matched_px.flat()]),
    ...[point.located_px, point.projected_px].filter(Boolean)];
  if (!all.length) all.push(...[point.predicted_px].filter(Boolean));
  if (!all.length) return undefined;
  const [xs, ys] = [all.map(([x]) => x), all.map(([, y]) => y)];
  return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
}

/**
 * Residuals of a control point, `[from, to]` in pixels, `magnification` times as long as they are: at the ends and the
 * middle of each matched segment from the foot on the projected edge, and from the projected reference to the located one.
 */
export function residuals(point, edges, magnification) {
  const vectors = edges.flatMap(({ projected_px: [from, to], matched_px }) => {
    const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
    if (!length) return [];
    const along = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
    return matched_px.flatMap((segment) => [segment[0], middle(segment), segment[1]].map((at) => {
      const way = (at[0] - from[0]) * along[0] + (at[1] - from[1]) * along[1];
      return [[from[0] + way * along[0], from[1] + way * along[1]], at];
    }));
  });
  if (point.projected_px && point.located_px) vectors.push([point.projected_px, point.located_px]);
  return vectors.map(([foot, at]) => [foot, foot.map((value, axis) => value + magnification * (at[axis] - value))]);
}

/** A round number of pixels whose bar is between 50 and 125 units of the screen long, at so many pixels a unit. */
export function barLength(resolution) {
  const most = 125 * resolution;
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].map((step) => step * power).find((length) => length <= most);
}
