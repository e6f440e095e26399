// Decisions at a threshold, and what they cost: counts of what is accepted or rejected (first letter), right or wrong
// in reality (second letter: c is right as accepted, w wrong).

/** The case names in the order of costs and confusions of the API. */
export const CASES = ['cc', 'cw', 'wc', 'ww'];

const least = (point) => point.threshold ?? -Infinity;

/**
 * The point of a cost curve that applies at a threshold: of those kept the nearest one that does not accept more, as the
 * service reckons too.
 */
export function pointAt(curve, threshold) {
  return curve.find((point) => least(point) >= threshold) ?? curve.at(-1);
}

/** The expected cost of an image: `costs` of `[cc, cw, wc, ww]`. */
export function expectedCost(counts, costs) {
  const images = CASES.reduce((sum, name) => sum + counts[name], 0);
  return CASES.reduce((sum, name, k) => sum + counts[name] * costs[k], 0) / Math.max(1, images);
}

/** The cost of rejecting all. */
export function costOfRejecting({ images, right }, costs) {
  return (right * costs[2] + (images - right) * costs[3]) / Math.max(1, images);
}

/** The threshold `steps` points further along a curve. */
export function stepped(curve, threshold, steps) {
  const at = curve.indexOf(pointAt(curve, threshold));
  return least(curve[Math.min(curve.length - 1, Math.max(0, at + steps))]);
}
