// The classifiers of the self-diagnosis: which one decides, how well each does, and how new ones come about.

import { html, nothing, render } from '../vendor/lit.js';
import { api, pages } from '../api.js';
import { confirm } from '../parts/dialog.js';
import { notify } from '../parts/notices.js';
import { percent, problemText, t, time } from '../texts.js';
import { detail } from './diagnosis/detail.js';
import { newTraining, training } from './diagnosis/training.js';

const POLL_MS = 1500;
const MOST = 500;
const COLUMNS = ['name', 'decides', 'status', 'created', 'finished'];

const isUnderway = ({ status }) => status === 'queued' || status === 'training';
const path = (id) => `/classifiers/${encodeURIComponent(id)}`;

/** Shows the list, or the classifier `id`, beside the one that `?with=` names. */
export async function show(place, { id, may, go }) {
  const state = { list: [], shown: [], thresholds: new Map(), training: newTraining(), compare: new Set() };
  const other = new URLSearchParams(location.search).get('with');
  const stopped = new AbortController();
  let timer;

  async function load() {
    const list = [];
    for await (const page of pages('/classifiers', {}, { most: MOST, signal: stopped.signal })) list.push(...page);
    state.list = list;
    if (id) state.shown = await Promise.all([id, other].filter(Boolean).map((one) => api.get(path(one),
      { signal: stopped.signal })));
    draw();
    clearTimeout(timer);
    if (list.some(isUnderway)) timer = setTimeout(() => load().catch(told), POLL_MS);
  }

  function told(error) {
    if (error.name !== 'AbortError') notify(problemText(error), 'error');
  }

  async function act(question, work) {
    if (!await confirm(question)) return;
    try {
      const { active } = await work();
      notify(t('diagnosis.activated', { name: active.name }), 'done');
      await load();
    } catch (error) { told(error); }
  }

  const activate = ({ id: one, name }) => act(
    { title: t('diagnosis.activate_title', { name }), text: t('diagnosis.activate_text'), yes: t('diagnosis.activate') },
    () => api.post(`${path(one)}/activate`),
  );
  const rollBack = () => act(
    { title: t('diagnosis.roll_back'), text: t('diagnosis.roll_back_text'), yes: t('diagnosis.roll_back') },
    () => api.post('/classifiers/rollback'),
  );

  function row(classifier) {
    const { id: one, name, status, progress, active, created_at, finished_at, error } = classifier;
    const chosen = (event) => { state.compare[event.target.checked ? 'add' : 'delete'](one); draw(); };
    return html`<tr>
      <td><input type="checkbox" aria-label=${t('diagnosis.compare_one', { name })} .checked=${state.compare.has(one)}
        ?disabled=${status !== 'ready' || (!state.compare.has(one) && state.compare.size === 2)} @change=${chosen}></td>
      <th scope="row"><a href="/diagnosis/${encodeURIComponent(one)}">${name}</a></th>
      <td>${active ? html`<span class="active-mark">✓ ${t('diagnosis.active')}</span>` : nothing}</td>
      <td class="training-state">${isUnderway(classifier) ? html`
        <progress max="1" .value=${progress} aria-label=${t('diagnosis.progress_of',
          { name })}></progress> <span>${t(`diagnosis.status_${status}`)} ${percent(progress)}</span>`
            : t(`diagnosis.status_${status}`)}
        ${error ? html`<p class="fault">${error}</p>` : nothing}</td>
      <td>${created_at ? time(created_at) : '–'}</td><td>${finished_at ? time(finished_at) : '–'}</td>
      <td>${may('admin') && !active && status === 'ready'
        ? html`<button type="button" class="small" @click=${() => activate(classifier)}>${t('diagnosis.activate')}</button>`
          : nothing}</td></tr>`;
  }

  function overview() {
    const [first, second] = [...state.compare];
    return html`<section class="page diagnosis">
      <div class="page-head"><h1>${t('diagnosis.title')}</h1>
        <button type="button" ?disabled=${state.compare.size !== 2}
          @click=${() => go(`/diagnosis/${encodeURIComponent(first)}?with=${encodeURIComponent(second)}`)}>${t('diagnosis.compare')}</button>
        ${may('admin') ? html`<button type="button" @click=${rollBack}>${t('diagnosis.roll_back')}</button>` : nothing}</div>
      <div class="wide" tabindex="0" role="region" aria-label=${t('diagnosis.title')}>
        <table class="figure-table classifiers" aria-live="polite">
        <thead><tr><th scope="col"><span class="unseen">${t('diagnosis.compare')}</span></th>
          ${COLUMNS.map((name) => html`<th scope="col">${t(`diagnosis.${name}`)}</th>`)}
          <th scope="col"><span class="unseen">${t('diagnosis.activate')}</span></th></tr></thead>
        <tbody>${state.list.map(row)}</tbody></table></div>
      ${may('operator') ? html`
        <h2>${t('diagnosis.train_title')}</h2>${training(state.training, may('admin'), { draw, begun: () => load().catch(told) })}`
          : nothing}</section>`;
  }

  const move = (classifier) => (threshold) => {
    state.thresholds.set(classifier.id, threshold);
    draw();
  };

  function one() {
    const others = state.list.filter((classifier) => classifier.id !== id && classifier.status === 'ready');
    const query = (value) => (value ? `?with=${encodeURIComponent(value)}` : '');
    const beside = (event) => go(`/diagnosis/${encodeURIComponent(id)}${query(event.target.value)}`);
    return html`<section class="page diagnosis">
      <div class="page-head"><a href="/diagnosis">${t('diagnosis.title')}</a><h1 class="unseen">${state.shown[0]?.name}</h1>
        ${others.length ? html`<label class="inline-field">${t('diagnosis.beside')} <select @change=${beside}>
          <option value="">–</option>${others.map((classifier) => html`
            <option value=${classifier.id} ?selected=${classifier.id === other}>${classifier.name}</option>`)}</select></label>`
              : nothing}</div>
      <div class="classifiers-beside ${state.shown.length > 1 ? 'two' : ''}">${state.shown.map((classifier) => (isUnderway(classifier)
        ? html`<article class="classifier"><h2>${classifier.name}</h2>
          <progress max="1" .value=${classifier.progress} aria-label=${t('diagnosis.progress_of',
            { name: classifier.name })}></progress>
              <p role="status">${t(`diagnosis.status_${classifier.status}`)} ${percent(classifier.progress)}</p></article>`
        : detail(classifier, state.thresholds.get(classifier.id), { move: move(classifier), activate: may('admin') ? activate
          : undefined, link: state.shown.length > 1 })))}</div></section>`;
  }

  function draw() {
    if (!stopped.signal.aborted) render(id ? one() : overview(), place);
  }

  await load();
  return () => { stopped.abort(); clearTimeout(timer); };
}
