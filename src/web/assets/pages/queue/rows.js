// The table of the queue. However many rows there are, only those in view are in the document; all have one height.
// Places are set by `.style`, which the content security policy allows, unlike a `style` attribute (and lit's styleMap).

import { html, nothing, repeat } from '../../vendor/lit.js';
import { api } from '../../api.js';
import { number, probability, t, time } from '../../texts.js';
import { light, verdict } from '../../parts/verdict.js';
import { failureText, reasonText } from '../../parts/reasons.js';

/** As in pages.css. */
export const ROW_PX = 48;
const BEYOND = 6;
const COLUMNS = ['verdict', 'image', 'score', 'probability', 'reasons', 'camera', 'created', 'review'];

// as much of an id as is another for each: that it begins with is its time
const briefly = (id) => id.slice(0, 13);

/** The name of an orientation's image, or what stands for it. */
export const nameOf = (item) => item.image_name ?? briefly(item.image);

/** The rows in view of a place that is scrolled: the first one and the one after the last. */
export function rangeOf(place, count) {
  const first = Math.max(0, Math.floor(place.scrollTop / ROW_PX) - BEYOND);
  return [first, Math.min(count, first + Math.ceil(place.clientHeight / ROW_PX) + 2 * BEYOND)];
}

// the service's score where there was nothing to judge
const NO_SCORE = -99;

function state(item) {
  if (item.status === 'succeeded') return verdict(item.verdict);
  const stage = item.status === 'running' && item.stage ? t(`stage.${item.stage}`) : t(`status.${item.status}`);
  if (item.status !== 'running') return html`<span class="verdict verdict-none">${light('none', { spoken: false })}<span>${stage}</span></span>`;
  return html`<span class="running"><span>${stage}</span>
    <progress max="1" .value=${item.progress} aria-label=${t('queue.progress', { name: nameOf(item) })}></progress></span>`;
}

function reasons(item) {
  const given = item.error ? [{ text: failureText(item.error), detail: item.error.detail }]
    : (item.diagnosis?.reasons ?? []).map((reason) => ({ text: reasonText(reason), detail: reason.detail }));
  if (!given.length) return nothing;
  const [first, ...rest] = given;
  const more = rest.length ? ` ${t('queue.more_reasons', { count: rest.length })}` : '';
  return html`<span class="two-lines" title=${given.map(({ text, detail }) => `${text}: ${detail}`).join('\n')}>
    <span>${first.text}${more}</span><span class="quiet-text">${first.detail}</span></span>`;
}

function review(item, { mayDecide, decided, isCurrent }) {
  if (item.review) return html`<span class="review review-${item.review}">${t(`review.${item.review}`)}</span>`;
  if (item.status !== 'succeeded') return nothing;
  if (!mayDecide) return html`<span class="quiet-text">${t('review.open')}</span>`;
  const button = (decision, sign) => html`<button type="button" class="quiet sign ${decision}" tabindex=${isCurrent ? 0 : -1}
    aria-label=${t(`queue.${decision}_button`, { name: nameOf(item) })} title=${t(`queue.${decision}_hint`)}
    @click=${() => decided(item, decision)}>${sign}</button>`;
  return html`<span class="row-decide">${button('accepted', '✓')}${button('rejected', '✕')}</span>`;
}

// a picture that was in view once is kept by the browser; while somebody scrolls fast no others are asked for
function thumbnail(item, { pictures, settled }) {
  if (settled) pictures.add(item.image);
  const address = pictures.has(item.image) ? api.address(`/images/${item.image}/thumbnail`) : null;
  return html`<span class="thumbnail">${address
    ? html`<img src=${address} alt="" loading="lazy" decoding="async" @error=${(event) => { event.target.hidden = true; }}
        @load=${(event) => { event.target.hidden = false; }}>` : nothing}</span>`;
}

function row(item, index, view) {
  const isCurrent = item.id === view.current;
  const cell = (name, inside) => html`<div role="gridcell" class="cell cell-${name}">${inside}</div>`;
  const own = { ...view, isCurrent };
  return html`<div role="row" id="row-${item.id}" class="row ${isCurrent ? 'current' : ''}" aria-rowindex=${index + 2}
    aria-selected=${isCurrent ? 'true' : 'false'} .style=${`transform: translateY(${index * ROW_PX}px)`}>
    ${cell('verdict', state(item))}
    ${cell('image', html`${thumbnail(item, view)}<a class="row-link" tabindex=${isCurrent ? 0 : -1} title=${nameOf(item)}
      href="/orientations/${item.id}${view.search}">${nameOf(item)}</a>`)}
    ${cell('score', item.diagnosis ? number(item.diagnosis.score > NO_SCORE ? item.diagnosis.score : null, 1, { exactly: true }) : '')}
    ${cell('probability', item.diagnosis ? probability(item.diagnosis.probability_correct) : '')}
    ${cell('reasons', reasons(item))}
    ${cell('camera', html`<span class="cut" title=${item.camera_name ?? item.camera}>${item.camera_name ?? briefly(item.camera)}</span>`)}
    ${cell('created', html`<time datetime=${item.created_at} title=${time(item.created_at, { dateStyle: 'full', timeStyle: 'medium' })}>${
      time(item.created_at, { dateStyle: 'short', timeStyle: 'short' })}</time>`)}
    ${cell('review', review(item, own))}
  </div>`;
}

/**
 * The table. `view` has the `items`, whether the list is `complete`, the `range` of rows in view, the id of the `current`
 * row, the `search` that goes along with links, `mayDecide` and what happens when it is `decided`, the `pictures` that
 * were shown and whether scrolling has `settled`.
 */
export function rows(view) {
  const [from, to] = view.range;
  const shown = view.items.slice(from, to);
  return html`
    <div role="rowgroup" class="head"><div role="row" class="row" aria-rowindex="1">
      ${COLUMNS.map((name) => html`<div role="columnheader" class="cell cell-${name}">${t(`queue.column_${name}`)}</div>`)}</div></div>
    <div role="rowgroup" class="body" .style=${`height: ${view.items.length * ROW_PX}px`}>
      ${repeat(shown, (item) => item.id, (item, index) => row(item, from + index, view))}</div>`;
}
