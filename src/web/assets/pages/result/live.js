// While an orientation is waited for, and when it has come to no result.

import { html, nothing } from '../../vendor/lit.js';
import { api, follow } from '../../api.js';
import { notify } from '../../parts/notices.js';
import { failureText } from '../../parts/reasons.js';
import { confirm } from '../../parts/dialog.js';
import { percent, problemText, t } from '../../texts.js';

const STAGES = ['predict', 'extract', 'locate', 'resect', 'adjust', 'diagnose'];

/** Whether something is still to be expected. */
export const isUnderway = ({ status }) => status === 'queued' || status === 'running';

/** Follows an orientation: `progress(news)` with status, stage and progress, `ended()` at last. Returns what stops it. */
export function followOrientation(id, { progress, ended }) {
  const stop = follow(`/orientations/${id}/events`, {
    progress,
    end: () => { stop(); ended(); },
  });
  return stop;
}

async function cancel(id) {
  const question = { title: t('result.cancel'), text: t('result.cancel_text'), yes: t('result.cancel_yes'), danger: true };
  if (!await confirm(question)) return;
  await api.delete(`/orientations/${id}`).catch((error) => notify(problemText(error), 'error'));
}

/** What is going on; `may` is whether the caller may cancel it. */
export function underway({ id, status, stage, progress }, may) {
  const reached = STAGES.indexOf(stage);
  return html`<div class="underway" aria-live="polite">
    <h2>${t(`status.${status}`)}</h2>
    <progress max="1" .value=${progress ?? 0} aria-label=${t('result.progress')}></progress>
    <p>${percent(progress ?? 0)}${stage ? html` · ${t(`stage.${stage}`)}` : nothing}</p>
    <ol class="stages">${STAGES.map((name, k) => html`
      <li class=${k < reached ? 'past' : k === reached ? 'now' : ''} aria-current=${k === reached ? 'step'
        : nothing}>${t(`stage.${name}`)}</li>`)}</ol>
    ${may ? html`<button type="button" @click=${() => cancel(id)}>${t('result.cancel')}</button>` : nothing}</div>`;
}

/** Why there is no result. */
export function nothingCame({ status, error }) {
  return html`<div class="underway"><h2>${t(`status.${status}`)}</h2>
    ${status === 'cancelled' ? html`<p>${t('result.was_cancelled')}</p>` : nothing}
    ${error ? html`<p><strong>${failureText(error)}</strong></p><p class="quiet-text">${error.detail}</p>
      <p class="quiet-text"><code>${error.code}</code></p>` : nothing}
    <p><a href="/upload">${t('result.again')}</a></p></div>`;
}
