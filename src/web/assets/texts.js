// What the pages say, in the language of whoever looks, with numbers and dates as they are written there.
// The texts themselves are in `texts/`, a file a language, all with the same keys.

import { Problem } from './api.js';
import de from './texts/de.js';
import en from './texts/en.js';

const LANGUAGES = { en, de };
const KEPT = 'gable.language';

function chosen() {
  const wanted = [localStorage.getItem(KEPT), ...navigator.languages].filter(Boolean).map((tag) => tag.slice(0, 2));
  return wanted.find((tag) => tag in LANGUAGES) ?? 'en';
}

/** The language that is spoken: a key of `texts/`. */
export let language = chosen();
// where the browser knows a region of the language (de-AT, en-GB), its numbers and dates are those of the region
let locale = navigator.languages.find((tag) => tag.startsWith(language)) ?? language;
document.documentElement.lang = language;

/** Speaks another language from now on; what is shown must be drawn anew. */
export function speak(tag) {
  language = tag;
  locale = navigator.languages.find((known) => known.startsWith(tag)) ?? tag;
  localStorage.setItem(KEPT, tag);
  document.documentElement.lang = tag;
}

export const languages = Object.keys(LANGUAGES);

function found(key) {
  return key.split('.').reduce((texts, part) => texts?.[part], LANGUAGES[language]);
}

/** Whether there is a text. */
export const has = (key) => typeof found(key) === 'string';

/** The text of a key such as `queue.title`, with `{name}` replaced by `values.name`. A missing one shows its key. */
export function t(key, values = {}) {
  const text = found(key);
  if (typeof text !== 'string') return key;
  return text.replace(/\{(\w+)\}/g, (whole, name) => values[name] ?? whole);
}

/** A number with at most (or, `exactly`, just) so many digits after the point. */
export function number(value, digits = 2, { exactly = false } = {}) {
  if (value === undefined || value === null || !Number.isFinite(value)) return '–';
  return new Intl.NumberFormat(locale, {
    maximumFractionDigits: digits, minimumFractionDigits: exactly ? digits : 0,
  }).format(value);
}

/** A share (0 to 1) in per cent. */
export function percent(share, digits = 0) {
  if (share === undefined || share === null || !Number.isFinite(share)) return '–';
  return new Intl.NumberFormat(locale, { style: 'percent', maximumFractionDigits: digits }).format(share);
}

/** A probability, never as if it were certain. */
export function probability(share) {
  if (share > 0.999) return `> ${percent(0.999, 1)}`;
  return share < 0.001 ? `< ${percent(0.001, 1)}` : percent(share, share > 0.99 || share < 0.01 ? 1 : 0);
}

/** A time (RFC 3339) as date and time of the day. */
export function time(text, style = { dateStyle: 'medium', timeStyle: 'short' }) {
  return text ? new Intl.DateTimeFormat(locale, style).format(new Date(text)) : '–';
}

/** A number of bytes. */
export function bytes(count) {
  const units = ['byte', 'kilobyte', 'megabyte', 'gigabyte', 'terabyte'];
  const step = Math.min(units.length - 1, Math.max(0, Math.floor(Math.log10(Math.max(count, 1)) / 3)));
  const digits = step === 0 ? 0 : 1;
  return new Intl.NumberFormat(locale, {
    style: 'unit', unit: units[step], unitDisplay: 'short', maximumFractionDigits: digits,
  }).format(count / 1000 ** step);
}

/** A number of seconds, shortly. */
export function seconds(count) {
  if (count < 90) return `${number(count, count < 10 ? 1 : 0)} s`;
  if (count < 5400) return `${number(count / 60, 0)} min`;
  return `${number(count / 3600, 1)} h`;
}

/** An error in words: what the service said, and which fields are at fault. */
export function problemText(error) {
  if (!(error instanceof Problem)) return t('frame.unreachable', { detail: error.message });
  const fields = error.errors.map(({ pointer, detail }) => `${pointer}: ${detail}`);
  return fields.length ? `${error.title ?? ''} ${fields.join('; ')}`.trim() : error.message;
}
