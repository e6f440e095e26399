// Short news at the rim of the page: said by screen readers, gone after a while, errors later, or clicked away.

import { html, render } from '../vendor/lit.js';
import { t } from '../texts.js';

export const NOTICES = 'notices';
const SHOWN_MS = 6000;
const ERROR_SHOWN_MS = 20_000;
let notices = [];

function draw() {
  const place = document.getElementById(NOTICES);
  if (!place) return;
  render(notices.map((notice) => html`
    <div class="notice ${notice.kind}"><span>${notice.text}</span>
      <button type="button" class="quiet" aria-label=${t('frame.close')} @click=${() => drop(notice)}>×</button></div>`), place);
}

function drop(notice) {
  notices = notices.filter((other) => other !== notice);
  draw();
}

/** Shows `text`; `kind` is `info`, `done` or `error`. */
export function notify(text, kind = 'info') {
  const notice = { text, kind };
  notices = [...notices.slice(-3), notice];
  draw();
  setTimeout(() => drop(notice), kind === 'error' ? ERROR_SHOWN_MS : SHOWN_MS);
}
