// The tab with the verdict: what it is, why, and what staff has decided about it.

import { html, nothing, svg } from '../../vendor/lit.js';
import { number, probability, t, time } from '../../texts.js';
import { reasonText } from '../../parts/reasons.js';
import { verdict } from '../../parts/verdict.js';
import { figures, heading } from './figures.js';

// score and threshold on one line: where it is green, and how far away
function scoreLine({ score, threshold }) {
  if (!Number.isFinite(score) || !Number.isFinite(threshold)) return nothing;
  const reach = Math.max(1, Math.abs(score - threshold) * 1.25);
  const at = (value) => 4 + 292 * Math.min(1, Math.max(0, 0.5 + (value - threshold) / (2 * reach)));
  return html`<svg class="score-line" viewBox="0 0 300 26" role="img"
    aria-label=${t('result.score_of', { score: number(score, 2), threshold: number(threshold, 2) })}>
    ${svg`<path class="low" d="M4 13H${at(threshold)}"></path><path class="high" d="M${at(threshold)} 13H296"></path>
      <path class="limit" d="M${at(threshold)} 4V22"></path><path class="score" d="M${at(score)} 6l5 7-5 7-5-7z"></path>`}</svg>`;
}

function reasons(list) {
  return html`<ol class="reasons">${list.map((reason) => html`
    <li><strong>${reasonText(reason)}</strong>${reason.detail && reason.detail !== reasonText(reason)
      ? html`<p class="quiet-text">${reason.detail}</p>` : nothing}</li>`)}</ol>`;
}

function names(label, list, choose) {
  if (!list?.length) return [label, undefined];
  const one = (name) => html`<button type="button" class="link" @click=${() => choose(name)}>${name}</button>`;
  return [label, list.map((name, k) => html`${k ? ', ' : ''}${one(name)}`)];
}

function correctionText({ off = [], moved = [] }) {
  return [...off.map((name) => t('result.was_off', { name })),
    ...moved.map(({ name, at_px }) => t('result.was_moved', { name, x: number(at_px[0], 1), y: number(at_px[1], 1) }))];
}

function review(entry, look, looking) {
  return html`<li>
    <p><strong class="decision ${entry.decision}">${t(`result.decided_${entry.decision}`)}</strong>
      <span class="quiet-text">${entry.who?.replace(/^account:/, '')} · ${time(entry.created_at)}</span></p>
    ${entry.why ? html`<p class="why">${entry.why}</p>` : nothing}
    ${entry.correction ? html`<ul class="plain">${correctionText(entry.correction).map((text) => html`<li>${text}</li>`)}</ul>
      ${look ? html`<button type="button" class="small" aria-pressed=${looking === entry.id ? 'true' : 'false'}
        @click=${() => look(entry)}>
        ${looking === entry.id ? t('result.look_end') : t('result.look')}</button>` : nothing}` : nothing}</li>`;
}

/** The list of what was decided, newest first. */
export function reviewList(reviews, look, looking) {
  if (!reviews) return nothing;
  return html`${heading(t('result.reviews'))}
    ${reviews.length ? html`<ol class="reviews">${reviews.map((entry) => review(entry, look, looking))}</ol>`
      : html`<p class="quiet-text">${t('result.no_reviews')}</p>`}`;
}

/** The buttons by which staff decides. */
export function decisionButtons({ mayDecide, mayAccept, busy, correcting, mayCorrect }, { accept, reject, correct }) {
  if (!mayDecide) return html`<p class="quiet-text">${t('result.only_operators')}</p>`;
  return html`<div class="decide">
    <button type="button" class="main" ?disabled=${busy || correcting || !mayAccept} @click=${accept}>${t('result.accept')} <kbd
      aria-hidden="true">a</kbd></button>
    <button type="button" ?disabled=${busy || correcting} @click=${reject}>${t('result.reject')} <kbd
      aria-hidden="true">r</kbd></button>
    ${mayCorrect ? html`<button type="button" ?disabled=${correcting} @click=${correct}>${t('result.correct')}</button>`
      : nothing}</div>`;
}

/** The tab; `choose(name)` goes to a control point. */
export function verdictTab(result, { choose, decide, reviews }) {
  const { diagnosis } = result;
  const { features } = diagnosis;
  return html`
    <div class="verdict-head">${verdict(diagnosis.verdict)}
      <span class="probability">${diagnosis.probability_correct === undefined || diagnosis.probability_correct === null ? nothing
        : html`<strong>${probability(diagnosis.probability_correct)}</strong> ${t('result.probability')}`}</span></div>
    ${scoreLine(diagnosis)}
    ${figures([[t('result.score'), number(diagnosis.score, 2, { exactly: true })],
      [t('result.threshold'), number(diagnosis.threshold, 2, { exactly: true })]])}
    ${decide}
    ${heading(t('result.reasons'))}${reasons(diagnosis.reasons)}
    ${figures([names(t('result.probably_wrong'), diagnosis.probably_wrong, choose),
      names(t('result.probably_right'), diagnosis.probably_right, choose)])}
    ${reviews}
    ${features ? html`${heading(t('result.features'))}${figures(
      Object.entries(features).map(([name, value]) => [t(`result.feature_${name}`), number(value, 3)]))}` : nothing}`;
}
