// An orientation: the image with all that was found in it, and beside it the verdict, the figures, the decision.

import { html, nothing, render } from '../vendor/lit.js';
import { api } from '../api.js';
import { askText } from '../parts/dialog.js';
import { notify } from '../parts/notices.js';
import { decide } from '../parts/reviews.js';
import { verdict } from '../parts/verdict.js';
import { viewer } from '../parts/viewer.js';
import { edgesOf, placeOf } from '../parts/viewer/geometry.js';
import { problemText, t } from '../texts.js';
import { correctingBar, pointEditor } from './result/correcting.js';
import { correction } from './result/correction.js';
import { listenToKeys } from './result/keys.js';
import { followOrientation, isUnderway, nothingCame, underway } from './result/live.js';
import { load } from './result/load.js';
import { filterOf, neighbours } from './result/neighbours.js';
import { parts } from './result/parts.js';
import { tabPanel, tabs, TABS } from './result/tabs.js';

function address(id, state) {
  const query = new URLSearchParams(state.filter);
  if (state.tab !== TABS[0]) query.set('tab', state.tab);
  return `/orientations/${id}${query.size ? `?${query}` : ''}`;
}

function begin(id, search) {
  const query = new URLSearchParams(search);
  const tab = query.get('tab');
  return {
    id, filter: filterOf(search), tab: TABS.includes(tab) ? tab : TABS[0], chosen: query.get('point') ?? undefined,
    sort: { by: 'name', down: false }, way: {}, busy: false,
  };
}

/** Shows the orientation `id`. */
export async function show(place, { id, session, may, go }) {
  const state = begin(id, location.search);
  const stopped = new AbortController();
  const ends = [() => stopped.abort()];
  let view;
  let moveBeside;
  const beside = document.createElement('div');
  const held = parts({ choose: (name) => acts.choose(name), stopped: stopped.signal });

  const who = session.who.replace(/^account:/, '');
  const title = () => state.image?.name ?? t('result.title', { id: id.slice(0, 8) });
  const shown = () => state.correcting?.answer ?? { result: state.orientation.result, drawing: state.drawing, map: state.map };

  const acts = {
    draw: () => draw(),
    tab: (tab) => { state.tab = tab; history.replaceState(null, '', address(id, state)); draw(); },
    resort: (sort) => { state.sort = sort; draw(); },
    point: (name) => { view?.hover(name); hovered(name); },
    choose: (name, { zoom = true } = {}) => {
      state.chosen = name;
      view?.select(name);
      if (name !== undefined && zoom) view?.zoomTo(name);
      draw();
    },
    look: (image_px) => view?.centreOn(image_px),
    step: (to) => { if (to) go(address(to, state)); },
    accept: () => note(() => decide(id, title(), 'accepted')),
    reject: () => note(() => decide(id, title(), 'rejected')),
    correct: (first) => startCorrecting(first),
    stop: () => stopCorrecting(),
    save: () => note(save),
    lookAt: (review) => (state.looking === review.id ? stopCorrecting() : startCorrecting(review.correction, review.id)),
    toggle: (name, on) => state.correcting.toggle(name, on),
  };

  async function note(decided) {
    if (state.busy || !may('operator')) return;
    state.busy = true;
    draw();
    if (await decided()) state.reviews = (await api.get(`/orientations/${id}/reviews`,
      { query: { limit: 200 } }).catch(() => ({ items: state.reviews }))).items;
    state.busy = false;
    draw();
  }

  async function save() {
    const correcting = state.correcting.now;
    const title = t('result.save');
    const why = await askText({ title, text: t('result.save_as', { who }), label: t('result.why'), yes: title });
    if (why === undefined) return false;
    try {
      await api.post(`/orientations/${id}/reviews`, { decision: 'accepted', why, correction: correcting });
    } catch (error) {
      notify(problemText(error), 'error');
      return false;
    }
    notify(t('result.saved'), 'done');
    stopCorrecting();
    return true;
  }

  function startCorrecting(first, looking) {
    state.correcting?.end();
    state.looking = looking;
    state.correcting = correction(id, first, () => { drawTrial(); draw(); });
    view?.correct((name, at_px) => { acts.choose(name, { zoom: false }); if (at_px) state.correcting.move(name, at_px); });
    draw();
  }

  function stopCorrecting() {
    state.correcting?.end();
    state.correcting = undefined;
    state.looking = undefined;
    view?.correct(null);
    drawTrial();
    draw();
  }

  // what the viewer shows changes with each answer, and only then
  let drawn;
  function drawTrial() {
    const { drawing } = shown();
    if (drawn === drawing && !state.correcting?.error) return;
    drawn = drawing;
    view?.draw(drawing);
  }

  function drawBeside() {
    const { drawing } = shown();
    const index = drawing?.control_points.findIndex((point) => point.name === state.chosen) ?? -1;
    const editing = state.correcting && index >= 0;
    const at = editing ? placeOf(drawing.control_points[index], edgesOf(drawing, index)) : undefined;
    beside.className = editing ? 'beside' : '';
    render(editing ? pointEditor(state.chosen, at, state.correcting, () => acts.choose(undefined)) : nothing, beside);
    moveBeside?.(at);
  }

  function side() {
    const { orientation } = state;
    if (isUnderway(orientation)) return underway(orientation, may('operator'));
    if (!orientation.result) return nothingCame(orientation);
    return html`${tabs(state.tab, acts.tab)}${tabPanel(state, shown(), { may, acts })}`;
  }

  function draw() {
    const { orientation } = state;
    const { result } = shown();
    render(html`<div class="result">
      <div class="result-head">
        <a class="back" href=${`/${Object.keys(state.filter).length ? `?${new URLSearchParams(state.filter)}`
          : ''}`}>${t('frame.queue')}</a>
        <h1>${title()}</h1>
        ${orientation.status === 'succeeded' ? verdict(result?.diagnosis.verdict)
          : html`<span class="quiet-text">${t(`status.${orientation.status}`)}</span>`}
        ${state.reviews?.[0] ? html`<span
          class="decision ${state.reviews[0].decision}">${t(`result.decided_${state.reviews[0].decision}`)}</span>` : nothing}
        <span class="result-way">
          <button type="button" class="quiet" ?disabled=${!state.way.previous} title="k"
            @click=${() => acts.step(state.way.previous)}>‹ ${t('result.previous')}</button>
          <button type="button" class="quiet" ?disabled=${!state.way.next} title="j"
            @click=${() => acts.step(state.way.next)}>${t('result.next')} ›</button></span>
      </div>
      <div class="result-left">
        ${state.correcting ? correctingBar(state.correcting, { result: orientation.result, map: state.map }, who, acts) : nothing}
        <div class="result-viewer"></div></div>
      <div class="result-side">${side()}</div></div>`, place);
    drawBeside();
    held.attach(place, state, shown());
  }

  function hovered(name) {
    state.hovered = name;
    if (state.tab === 'points') draw();
  }

  function showViewer() {
    const target = place.querySelector('.result-viewer');
    if (view || !state.image || !target) return;
    view = viewer(target, {
      image: state.image, select: (name) => acts.choose(name, { zoom: false }),
      hover: hovered,
    });
    moveBeside = view.beside(beside);
    drawTrial();
    if (state.chosen !== undefined) acts.choose(state.chosen);
  }

  async function reload() {
    Object.assign(state, await load(id, stopped.signal));
    if (stopped.signal.aborted) return;
    draw();
    showViewer();
    drawTrial();
  }

  await reload();
  if (isUnderway(state.orientation)) {
    ends.push(followOrientation(id, {
      progress: (news) => { Object.assign(state.orientation, news); draw(); },
      ended: () => reload().catch((error) => notify(problemText(error), 'error')),
    }));
  }
  neighbours(id, state.filter, stopped.signal).then((way) => { if (!stopped.signal.aborted) { state.way = way; draw(); } });
  ends.push(listenToKeys(state, acts), () => state.correcting?.end(), () => view?.end(), () => held.end());
  return () => ends.forEach((end) => end());
}
