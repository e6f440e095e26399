// Questions that must be answered before the page goes on, on the browser's own <dialog>: it keeps the focus inside,
// gives it back, and closes by Escape.

import { html, nothing, render } from '../vendor/lit.js';
import { t } from '../texts.js';

/**
 * Opens a dialog with `title`; `content(close)` gives its inside. Resolves with what `close` was called with, or
 * undefined if the user has turned away.
 */
export function openDialog(title, content) {
  const dialog = document.createElement('dialog');
  dialog.className = 'dialog';
  dialog.setAttribute('aria-labelledby', 'dialog-title');
  document.body.append(dialog);
  return new Promise((resolve) => {
    let answer;
    const close = (value) => { answer = value; dialog.close(); };
    render(html`<h2 id="dialog-title">${title}</h2>
      <button type="button" class="quiet dialog-close" aria-label=${t('dialog.close')} @click=${() => close()}>×</button>
      ${content(close)}`, dialog);
    dialog.addEventListener('close', () => { dialog.remove(); resolve(answer); }, { once: true });
    // a page that is left takes its question along
    addEventListener('popstate', () => dialog.open && dialog.close(), { once: true });
    dialog.showModal();
    dialog.querySelector('[autofocus]')?.focus();
  });
}

function buttons(yes, close, danger) {
  return html`<div class="dialog-buttons">
    <button type="button" @click=${() => close()}>${t('dialog.cancel')}</button>
    <button type="submit" class=${danger ? 'danger' : 'main'}>${yes}</button></div>`;
}

/** Asks whether to do something, named by `yes`; resolves with true or undefined. `danger` for what cannot be undone. */
export function confirm({ title, text, yes, danger = false }) {
  return openDialog(title, (close) => html`
    <form @submit=${(event) => { event.preventDefault(); close(true); }}>
      ${text ? html`<p>${text}</p>` : nothing}${buttons(yes, close, danger)}
    </form>`);
}

/** Asks for a text, at most `most` characters; resolves with it (trimmed) or undefined. */
export function askText({ title, text, label, yes, required = true, danger = false, most = 2000 }) {
  const submit = (close) => (event) => {
    event.preventDefault();
    const given = event.target.elements.answer.value.trim();
    if (given || !required) close(given);
    else event.target.elements.answer.focus();
  };
  // Ctrl+Enter sends, as Enter alone begins a new line
  const keys = (event) => { if (event.key === 'Enter' && (event.ctrlKey || event.metaKey)) event.target.form.requestSubmit(); };
  return openDialog(title, (close) => html`
    <form @submit=${submit(close)}>
      ${text ? html`<p>${text}</p>` : nothing}
      <label class="field"><span>${label}</span>
        <textarea name="answer" rows="3" maxlength=${most} ?required=${required} autofocus @keydown=${keys}></textarea></label>
      ${buttons(yes, close, danger)}
    </form>`);
}
