// The control: where points and scenes lie, how sound they are, and how new ones come in.

import { html, nothing, render, repeat } from '../vendor/lit.js';
import { api, pages, Problem } from '../api.js';
import { confirm } from '../parts/dialog.js';
import { notify } from '../parts/notices.js';
import { number, problemText, t } from '../texts.js';
import { CLASSES, classOf, healthSign } from './control/health.js';
import { importing, newImport } from './control/importing.js';
import { controlMap } from './control/map.js';
import { pointPanel, scenePanel } from './control/panel.js';
import { setList } from './control/sets.js';
import { forget, newScene, sceneForm } from './control/scene.js';
import { heading } from './result/figures.js';

const MOST = 2000;
const LISTED = 200;
const WAIT_MS = 250;
const TABS = ['points', 'scenes', 'sets', 'import'];
const CRS = 'EPSG:4979';
const LEGEND = ['good', 'doubtful', 'outdated', 'unseen'];

async function all(path, query, most, signal) {
  const items = [];
  for await (const page of pages(path, query, { most, signal })) items.push(...page);
  return items;
}

const keyOf = ({ properties: { set, name } }) => `${set} ${name}`;
const rank = (feature) => CLASSES.indexOf(classOf(feature.properties.health));
const worstFirst = (a, b) => rank(a) - rank(b) || a.properties.name.localeCompare(b.properties.name, undefined, { numeric: true });

async function extent() {
  try {
    return await api.get('/control-points/extent', { query: { crs: CRS } });
  } catch (error) {
    if (error instanceof Problem && error.status === 404) return {};
    throw error;
  }
}

/** Shows the page. */
export async function show(place, { may }) {
  const state = { tab: 'points', inView: [], scenes: [], search: '', found: undefined, chosen: undefined, health: undefined,
    count: undefined, full: false, sets: [], importing: newImport(), scene: newScene() };
  let running = new AbortController();
  let timer;
  let map;
  const told = (error) => { if (error.name !== 'AbortError') notify(problemText(error), 'error'); };

  // what is in view, as one goes over the map; the view before it is no longer waited for
  function moved(bbox) {
    clearTimeout(timer);
    timer = setTimeout(async () => {
      running.abort();
      running = new AbortController();
      const query = { crs: CRS, bbox: bbox.map((value) => value.toFixed(7)).join(',') };
      try {
        const [points, scenes] = await Promise.all([
          all('/control-points', { ...query, health: true }, MOST, running.signal),
            all('/control-scenes', query, MOST, running.signal)]);
        Object.assign(state, { inView: points, scenes, full: points.length >= MOST });
        map.points(points);
        map.scenes(scenes);
        draw();
      } catch (error) { told(error); }
    }, WAIT_MS);
  }

  let searching = 0;
  async function search(text) {
    state.search = text;
    const mine = ++searching;
    const q = text.trim();
    await new Promise((resolve) => setTimeout(resolve, WAIT_MS));
    if (mine !== searching) return;
    try {
      const found = q ? await all('/control-points', { q, crs: CRS, health: true }, LISTED) : undefined;
      if (mine !== searching) return;
      state.found = found;
      draw();
    } catch (error) { told(error); }
  }

  const known = ({ name, set }) => [...(state.found ?? []), ...state.inView]
    .find(({ properties }) => properties.name === name && properties.set === set);
  async function choose(chosen, { go = false } = {}) {
    state.chosen = chosen;
    state.health = undefined;
    map.choose(chosen);
    if (chosen) state.tab = chosen.kind === 'scene' ? 'scenes' : 'points';
    draw();
    const feature = chosen?.kind === 'point' && known(chosen);
    if (go) {
      const at = feature ? feature.properties.reference
        : state.scenes.find((scene) => scene.name === chosen.name)?.reference.coordinates;
      if (at) map.goTo(at);
    }
    if (!feature) return;
    try {
      const health = await api.get(`/control-points/${encodeURIComponent(chosen.name)}/health`,
        { query: { set: chosen.set } });
      if (state.chosen !== chosen) return;
      state.health = health;
      draw();
    } catch (error) { told(error); }
  }

  async function remove(path, name, query) {
    const sure = await confirm({ title: t('control.delete_title', { name }), text: t('control.delete_text'),
      yes: t('control.delete'), danger: true });
    if (!sure) return;
    try {
      await api.delete(path, { query });
      notify(t('control.deleted', { name }), 'done');
      choose(undefined);
      changed();
    } catch (error) { told(error); }
  }

  async function changed({ fit = false } = {}) {
    const failed = (error) => { told(error); return {}; };
    const [area, sets] = await Promise.all([extent().catch(failed), api.get('/control-sets').catch(failed)]);
    Object.assign(state, { count: area.count, sets: sets.items ?? [] });
    if (fit && area.bbox) map.fit(area.bbox);
    map.reload();
    if (state.search) search(state.search);
    draw();
  }

  const entry = (feature) => {
    const { name, set, health } = feature.properties;
    return html`<li><button type="button" class="control-entry" aria-current=${state.chosen?.name === name ? 'true' : nothing}
      @click=${() => choose({ kind: 'point', name, set }, { go: true })}>
      ${healthSign(classOf(health), { quiet: true })}<span class="entry-name">${name}</span>
      <span class="quiet-text figure">${health?.seen_in ? t('control.found_of',
        { found: number(health.found), seen: number(health.seen_in) }) : ''}</span></button></li>`;
  };

  function list() {
    const rows = [...(state.found ?? state.inView)].sort(worstFirst);
    return html`<p class="quiet-text" role="status">${state.found ? t('control.hits', { count: number(rows.length) })
      : t(state.full ? 'control.in_view_full' : 'control.in_view', { count: number(rows.length) })}
        ${state.count === undefined ? nothing : t('control.of_all', { count: number(state.count) })}</p>
      <ul class="control-list">${repeat(rows.slice(0, LISTED), keyOf, entry)}</ul>
      ${rows.length > LISTED ? html`<p class="quiet-text">${t('control.more', { count: number(rows.length - LISTED) })}</p>`
        : nothing}`;
  }

  function points() {
    const feature = state.chosen?.kind === 'point' && known(state.chosen);
    const { name, set } = state.chosen ?? {};
    if (feature) return pointPanel(feature, state.health, { mayDelete: may('operator'),
      remove: () => remove(`/control-points/${encodeURIComponent(name)}`, name, { set }), close: () => choose(undefined) });
    return html`<label class="field search"><span class="unseen">${t('control.search')}</span>
      <input type="search" placeholder=${t('control.search')} .value=${state.search}
        @input=${(event) => search(event.target.value)}></label>${list()}`;
  }

  function scenes() {
    const scene = state.chosen?.kind === 'scene' && state.scenes.find(({ name }) => name === state.chosen.name);
    if (scene) return scenePanel(scene, { mayDelete: may('operator'),
      remove: () => remove(`/control-scenes/${scene.id}`, scene.name), close: () => choose(undefined) });
    return html`${may('operator') ? html`<details class="new-scene">
      <summary>${t('control.new_scene')}</summary>${sceneForm(state.scene, { draw, done: () => changed() })}</details>` : nothing}
      ${heading(t('control.scenes_in_view', { count: number(state.scenes.length) }))}
      <ul class="control-list">${state.scenes.slice(0, LISTED).map(({ name, gsd_m }) => html`
        <li><button type="button" class="control-entry" @click=${() => choose({ kind: 'scene', name }, { go: true })}>
        <span class="scene-sign" aria-hidden="true"></span><span class="entry-name">${name}</span><span
          class="quiet-text figure">${number(gsd_m, 4)} m</span></button></li>`)}</ul>`;
  }

  const PANELS = {
    points, scenes,
    sets: () => setList(state.sets, { mayDelete: may('operator'),
      remove: ({ name }) => remove(`/control-sets/${encodeURIComponent(name)}`, name) }),
    import: () => (may('operator') ? importing(state.importing, { draw, done: () => changed({ fit: true }) }) : html`<p class="quiet-text">${t('control.only_operators')}</p>`),
  };

  function tabs() {
    const choices = TABS.map((name) => html`<button type="button" role="tab" id="tab-${name}" aria-controls="tab-panel"
      aria-selected=${state.tab === name ? 'true' : 'false'} tabindex=${state.tab === name ? 0 : -1}
      @click=${() => { state.tab = name; draw(); }}>${t(`control.tab_${name}`)}</button>`);
    const keys = (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      event.preventDefault();
      state.tab = TABS[(TABS.indexOf(state.tab) + step + TABS.length) % TABS.length];
      draw();
      document.getElementById(`tab-${state.tab}`).focus();
    };
    return html`<div class="tabs" role="tablist" aria-label=${t('frame.control')} @keydown=${keys}>${choices}</div>`;
  }

  function draw() {
    render(html`<div class="result control" @dragover=${(event) => event.preventDefault()} @drop=${dropped}>
      <h1 class="unseen">${t('frame.control')}</h1>
      <div class="control-left">
        <div class="control-map" tabindex="0" role="application" aria-label=${t('control.map')}></div>
        <ul class="map-legend control-legend">${LEGEND.map((name) => html`<li>${healthSign(name)}</li>`)}
          <li><span class="scene-sign" aria-hidden="true"></span>${t('control.scene')}</li></ul></div>
      <div class="result-side">${tabs()}
        <div class="tab-panel" role="tabpanel" id="tab-panel" tabindex="0"
          aria-labelledby="tab-${state.tab}">${PANELS[state.tab]()}</div></div></div>`, place);
  }

  function dropped(event) {
    event.preventDefault();
    const file = event.dataTransfer.files[0];
    if (!file || !may('operator')) return;
    if (event.target.closest('.control-form') && state.tab === 'scenes') {
      forget(state.scene);
      Object.assign(state.scene, { file, preview: URL.createObjectURL(file) });
    } else {
      state.tab = 'import';
      Object.assign(state.importing, { file, report: undefined, error: undefined });
    }
    draw();
  }

  draw();
  map = controlMap(place.querySelector('.control-map'), { moved, choose });
  changed({ fit: true });
  return () => { clearTimeout(timer); running.abort(); forget(state.scene); map.end(); };
}
