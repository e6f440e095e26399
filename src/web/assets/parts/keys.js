// Keys of a single character, as in `j` for the next one. They never fire where somebody types, and can be turned off,
// as whoever speaks to the computer types letters without meaning to (WCAG 2.1.4).

import { html } from '../vendor/lit.js';
import { t } from '../texts.js';
import { openDialog } from './dialog.js';

const KEPT = 'gable.single_keys';

/** Whether keys of a single character do something. */
export const singleKeys = () => localStorage.getItem(KEPT) !== 'off';

function choose(on) {
  localStorage.setItem(KEPT, on ? 'on' : 'off');
}

function isTyping(target) {
  return target instanceof Element && target.closest('input, textarea, select, [contenteditable], dialog') !== null;
}

/**
 * Calls `keys[event.key]` when that key is pressed, outside of fields and without Ctrl, Alt or Meta. Returns a function
 * that ends it. One that answers false has not used the key.
 */
export function onKeys(keys) {
  const pressed = (event) => {
    const used = keys[event.key];
    if (!used || event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
    if (isTyping(event.target) || document.querySelector('dialog[open]')) return;
    if (event.key.length === 1 && !singleKeys()) return;
    if (used(event) !== false) event.preventDefault();
  };
  document.addEventListener('keydown', pressed);
  return () => document.removeEventListener('keydown', pressed);
}

/** The keys of a page as a list: `entries` are `[[keys], text]`. */
export function keyList(entries) {
  return html`<dl class="keys">${entries.map(([keys, text]) => html`
    <dt>${keys.map((key) => html`<kbd>${key}</kbd>`)}</dt><dd>${text}</dd>`)}</dl>`;
}

/** Shows the keys of a page, and lets one turn off those of a single character. */
export function showKeys(entries) {
  return openDialog(t('keys.title'), () => html`
    ${keyList(entries)}
    <label class="keys-choice"><input type="checkbox" .checked=${singleKeys()} @change=${(event) => choose(event.target.checked)}>
      ${t('keys.single')}</label>`);
}
