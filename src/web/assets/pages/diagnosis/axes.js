// Axes of small pictures, drawn with figures as they are written in the user's language.

import { svg } from '../../vendor/lit.js';
import { number } from '../../texts.js';

/** The size of a picture and its margins, in units of the drawing. */
export const FRAME = { width: 560, height: 300, left: 52, right: 14, top: 14, bottom: 40 };

/** From values to the drawing: `across` or `up`. */
export function axis(low, high, way) {
  const [from, to] = way === 'across' ? [FRAME.left, FRAME.width - FRAME.right] : [FRAME.height - FRAME.bottom, FRAME.top];
  const span = high > low ? high - low : 1;
  const at = (value) => from + (Math.min(high, Math.max(low, value)) - low) / span * (to - from);
  at.back = (place) => low + Math.min(1, Math.max(0, (place - from) / (to - from))) * span;
  return at;
}

/** Round values between two, about `count` of them. */
export function ticks(low, high, count = 5) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((candidate) => candidate >= rough);
  const all = [];
  for (let value = Math.ceil(low / step) * step; value <= high + 1e-9; value += step) all.push(Number(value.toPrecision(10)));
  return all;
}

/** Hairlines with figures: `marks` are `[place, text]`. */
export function grid(xMarks, yMarks, xLabel, yLabel) {
  const { width, height, left, right, top, bottom } = FRAME;
  return svg`<g class="axes" aria-hidden="true">
    ${xMarks.map(([x, text]) => svg`<path d="M${x} ${top}V${height - bottom}"></path>
      <text x=${x} y=${height - bottom + 15} text-anchor="middle">${text}</text>`)}
    ${yMarks.map(([y, text]) => svg`<path d="M${left} ${y}H${width - right}"></path>
      <text x=${left - 6} y=${y + 4} text-anchor="end">${text}</text>`)}
    <text x=${(left + width - right) / 2} y=${height - 6} text-anchor="middle">${xLabel}</text>
    <text transform="translate(13 ${(top + height - bottom) / 2}) rotate(-90)" text-anchor="middle">${yLabel}</text></g>`;
}

/** Marks of values on an axis. */
export const marks = (values, at, digits) => values.map((value) => [at(value), number(value, digits)]);
