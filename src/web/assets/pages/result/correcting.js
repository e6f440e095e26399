// What is shown while correcting: the difference that the correction makes, and the point that is being corrected.

import { html, nothing } from '../../vendor/lit.js';
import { number, problemText, seconds, t } from '../../texts.js';
import { verdict } from '../../parts/verdict.js';
import { centreOf, distance_m, largestSigma } from './figures.js';
import { isNothing } from './correction.js';

function change(label, before, after) {
  return html`<div class="change"><dt>${label}</dt><dd>${before === undefined ? nothing
    : html`${before} <span aria-hidden="true">→</span><span
      class="unseen">${t('result.becomes')}</span> `}<strong>${after}</strong></dd></div>`;
}

function difference(before, answer) {
  const { result, map } = answer;
  const [old, fresh] = [centreOf(before.map), centreOf(map)];
  const [oldSigma, sigma] = [largestSigma(before.result), largestSigma(result)];
  const metres = (value) => (value === undefined ? '–' : `${number(value, 3, { exactly: true })} m`);
  return html`<dl class="changes" aria-live="polite">
    ${change(t('result.verdict'), verdict(before.result.diagnosis.verdict), verdict(result.diagnosis.verdict))}
    ${change(t('result.score'), number(before.result.diagnosis.score, 2, { exactly: true }),
      number(result.diagnosis.score, 2, { exactly: true }))}
    ${change(t('result.centre_moved'), undefined, old && fresh ? metres(distance_m(old, fresh)) : '–')}
    ${change(t('result.largest_sigma'), metres(oldSigma), metres(sigma))}</dl>`;
}

function state(correcting) {
  if (correcting.error) return html`<span class="fault" role="alert">${problemText(correcting.error)}</span>`;
  if (correcting.busy === 'first') return html`<span role="status"><span class="busy"
    aria-hidden="true"></span>${t('result.trial_first')}</span>`;
  if (correcting.busy) return html`<span role="status"><span class="busy"
    aria-hidden="true"></span>${t('result.trial_busy')}</span>`;
  const { off, moved } = correcting.now;
  return html`<span class="quiet-text" role="status">${isNothing(correcting.now) ? t('result.trial_none')
    : t('result.trial_done', { off: number(off.length), moved: number(moved.length),
      seconds: seconds(correcting.answer.seconds) })}</span>`;
}

/** The bar over the viewer; `before` is what the orientation was: `{result, map}`. `acts`: `{save, stop}`. */
export function correctingBar(correcting, before, who, acts) {
  const nothingYet = isNothing(correcting.now);
  return html`<section class="correcting" aria-label=${t('result.correcting')}>
    <div class="correcting-head"><strong>${t('result.correcting')}</strong>${state(correcting)}
      <span class="correcting-acts">
        <button type="button" class="small" ?disabled=${!correcting.mayUndo} title="Ctrl+Z"
          @click=${correcting.undo}>${t('result.undo')}</button>
        <button type="button" class="small" ?disabled=${!correcting.mayRedo} title="Ctrl+Y"
          @click=${correcting.redo}>${t('result.redo')}</button>
        <button type="button" class="small" ?disabled=${nothingYet} @click=${correcting.reset}>${t('result.reset')}</button>
        <button type="button" class="small" @click=${acts.stop}>${t('result.stop')}</button>
        <button type="button" class="small main" ?disabled=${nothingYet || correcting.busy || correcting.error}
          title=${t('result.save_as', { who })} @click=${acts.save}>${t('result.save')}</button>
      </span></div>
    ${correcting.answer ? difference(before, correcting.answer) : nothing}</section>`;
}

/** What stands beside a chosen point in the viewer: switch it off, type where it is, put it back. */
export function pointEditor(name, at_px, correcting, close) {
  const off = correcting.now.off.includes(name);
  const moved = correcting.now.moved.some((entry) => entry.name === name);
  const put = (event) => {
    event.preventDefault();
    const place = ['x', 'y'].map((axis) => Number(event.target.elements[axis].value));
    if (place.every(Number.isFinite)) correcting.move(name, place);
  };
  const field = (axis, k) => html`<label>${axis} <input name=${axis} type="number" step="0.1" required .value=${at_px
    ? at_px[k].toFixed(1) : ''}></label>`;
  return html`<div class="beside-head"><strong>${name}</strong><button type="button" class="quiet small"
    aria-label=${t('frame.close')} @click=${close}>×</button></div>
    <label class="check"><input type="checkbox" .checked=${!off} @change=${(event) => correcting.toggle(name,
      event.target.checked)}> ${t('result.takes_part_short')}</label>
    <form class="beside-place" @submit=${put}>${['x', 'y'].map(field)}<button type="submit"
      class="small">${t('result.put')}</button></form>
    <p class="quiet-text">${t('result.drag_hint')}</p>
    ${moved ? html`<button type="button" class="small" @click=${() => correcting.putBack(name)}>${t('result.put_back')}</button>`
      : nothing}`;
}
