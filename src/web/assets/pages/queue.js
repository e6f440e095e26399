// The queue: all orientations, newest first, to be looked through and decided about, mostly by keyboard.

import { createRef, html, ifDefined, nothing, ref, render } from '../vendor/lit.js';
import { api } from '../api.js';
import { problemText, t } from '../texts.js';
import { onKeys, showKeys } from '../parts/keys.js';
import { decide } from '../parts/reviews.js';
import { counters, counts } from './queue/counters.js';
import { beginnings, failed, nothingFound, nothingYet } from './queue/empty.js';
import { filterBar, filtersOf, isFiltered, queryOf, searchOf } from './queue/filters.js';
import { OrientationList } from './queue/list.js';
import { nameOf, rangeOf, ROW_PX, rows } from './queue/rows.js';

const TYPED_MS = 250;
const SETTLED_MS = 120;
const COUNTED_MS = 15_000;
const AHEAD_ROWS = 100;
// where somebody was who goes to a result and comes back
let left = { search: null };

/** The keys of this page and what they do, for the list of keys. */
export const queueKeys = () => [
  [['j', '↓'], t('queue.key_next')], [['k', '↑'], t('queue.key_previous')], [['Enter'], t('queue.key_open')],
  [['a'], t('queue.key_accept')], [['r'], t('queue.key_reject')], [['u'], t('queue.key_undecided')],
  [['/'], t('queue.key_search')], [['?'], t('queue.key_keys')],
];

/** Shows the queue in `place`. */
export function show(place, { may, go }) {
  const queue = new Queue(place, may('operator'), go);
  queue.begin();
  return () => queue.end();
}

class Queue {
  #filters = filtersOf(location.search);
  #lists = { cameras: [], blocks: [] };
  #counts = {};
  #beginnings = null;
  #current = null;
  #scroller = createRef();
  #pictures = new Set();
  #settled = true;
  #stop = new AbortController();
  #timers = {};

  constructor(place, mayDecide, go) {
    Object.assign(this, { place, mayDecide, go });
  }

  begin() {
    this.#open();
    this.#load('/cameras', 'cameras');
    this.#load('/blocks', 'blocks');
    this.#count();
    this.endKeys = onKeys({
      j: () => this.#step(1), ArrowDown: () => this.#step(1), k: () => this.#step(-1), ArrowUp: () => this.#step(-1),
      Home: () => this.#choose(0), End: () => this.#last(), Enter: (event) => this.#enter(event),
      a: () => this.#decideCurrent('accepted'), r: () => this.#decideCurrent('rejected'), u: () => this.#undecided(),
      '/': () => this.place.querySelector('[data-filter=q]').focus(), '?': () => { showKeys(queueKeys()); },
    });
    addEventListener('resize', this.#draw);
    document.addEventListener('visibilitychange', this.#seen);
  }

  // a window that nobody sees leaves its connection to the others
  #seen = () => {
    if (document.hidden) { this.list.rest(); return; }
    this.list.live();
    this.list.refresh();
  };

  end() {
    left = { search: location.search, current: this.#current, top: this.#scroller.value?.scrollTop, count: this.list.items.length };
    this.#stop.abort();
    this.list.end();
    this.endKeys();
    Object.values(this.#timers).forEach(clearTimeout);
    removeEventListener('resize', this.#draw);
    document.removeEventListener('visibilitychange', this.#seen);
  }

  async #open() {
    this.list?.end();
    const list = new OrientationList(queryOf(this.#filters), (above) => this.#changed(above));
    this.list = list;
    const back = left.search === location.search ? left : {};
    left = { search: null };
    this.#current = null;
    this.#draw();
    list.live();
    do await list.more(); while (list.items.length < back.count && !list.complete && !list.failure);
    if (list !== this.list) return;
    this.#current = back.current ?? null;
    this.#draw();
    if (this.#scroller.value) this.#scroller.value.scrollTop = back.top ?? 0;
    if (!list.items.length && !isFiltered(this.#filters)) this.#beginnings = await beginnings();
    this.#draw();
  }

  async #load(path, name) {
    const page = await api.get(path, { query: { limit: 200 }, signal: this.#stop.signal }).catch(() => null);
    if (page) this.#lists = { ...this.#lists, [name]: page.items };
    this.#draw();
  }

  async #count() {
    this.#counts = await counts(this.#stop.signal);
    if (this.#stop.signal.aborted) return;
    this.#draw();
    this.#after('count', COUNTED_MS, () => this.#count());
  }

  #after(name, ms, task) {
    clearTimeout(this.#timers[name]);
    this.#timers[name] = setTimeout(task, ms);
  }

  // rows that come in above must not push away what somebody is looking at
  #changed(above) {
    const scroller = this.#scroller.value;
    const top = scroller?.scrollTop ?? 0;
    this.#draw();
    if (above && top > 0) { scroller.scrollTop = top + above * ROW_PX; this.#draw(); }
  }

  #filter = (changed, { typing = false } = {}) => {
    this.#filters = Object.fromEntries(Object.entries({ ...this.#filters, ...changed }).filter(([, value]) => value));
    const address = `/${searchOf(this.#filters)}`;
    if (!typing) {
      history.pushState(null, '', address);
      this.#open();
      return;
    }
    this.#after('typed', TYPED_MS, () => { history.replaceState(null, '', address); this.#open(); });
  };

  #clear = () => {
    history.pushState(null, '', '/');
    this.#filters = {};
    this.#open();
    this.place.querySelector('[data-filter=q]').focus();
  };

  #scrolled = () => {
    this.#settled = false;
    this.#draw();
    this.#after('settled', SETTLED_MS, () => { this.#settled = true; this.#draw(); });
  };

  #draw = () => {
    if (this.#stop.signal.aborted) return;
    const { list } = this;
    const scroller = this.#scroller.value;
    const range = scroller ? rangeOf(scroller, list.items.length) : [0, Math.min(30, list.items.length)];
    const [from, to] = range;
    const current = list.indexOf(this.#current);
    const view = {
      items: list.items, range, current: this.#current, search: searchOf(this.#filters), mayDecide: this.mayDecide,
      decided: (item, decision) => this.#decide(item, decision), pictures: this.#pictures, settled: this.#settled,
    };
    render(html`<section class="queue">
      <div class="queue-top"><h1>${t('queue.title')}</h1>${counters(this.#counts)}
        <button type="button" class="quiet" @click=${() => showKeys(queueKeys())}>${t('queue.keys')}</button></div>
      ${filterBar(this.#filters, this.#lists, (changed, how) => (how ? this.#filter(changed, how) : this.#filter(changed)))}
      ${this.#empty() ?? html`<div class="rows" role="grid" tabindex="0" aria-label=${t('queue.title')} aria-busy=${list.complete ? 'false' : 'true'}
        aria-rowcount=${list.complete ? list.items.length + 1 : -1} @scroll=${this.#scrolled} ${ref(this.#scroller)}
        aria-activedescendant=${ifDefined(current >= from && current < to ? `row-${this.#current}` : undefined)}>${rows(view)}</div>`}
      ${list.items.length && list.failure ? html`<p class="list-failure" role="alert"><span class="fault">${problemText(list.failure)}</span>
        <button type="button" @click=${() => list.more()}>${t('queue.again')}</button></p>` : nothing}
    </section>`, this.place);
    if (!scroller && this.#scroller.value) { this.#draw(); return; }
    if (this.#settled) list.complement(list.items.slice(from, to));
    if (to + AHEAD_ROWS >= list.items.length && list.items.length && !list.failure) list.more();
  };

  #empty() {
    if (this.list.items.length) return null;
    if (this.list.failure) return failed(this.list.failure, () => this.#open());
    if (!this.list.complete) return html`<p class="nothing" aria-busy="true">${t('queue.loading')}</p>`;
    return isFiltered(this.#filters) ? nothingFound(this.#clear) : nothingYet(this.#beginnings);
  }

  #choose(index) {
    const { items } = this.list;
    if (!items.length) return;
    const wanted = Math.max(0, Math.min(items.length - 1, index));
    this.#current = items[wanted].id;
    // rows that have just come in must have their room before one can be scrolled to
    this.#draw();
    const scroller = this.#scroller.value;
    const head = scroller.querySelector('.head').offsetHeight;
    const [top, room] = [wanted * ROW_PX, scroller.clientHeight - head];
    if (top < scroller.scrollTop) scroller.scrollTop = top;
    if (top + ROW_PX > scroller.scrollTop + room) scroller.scrollTop = top + ROW_PX - room;
    this.#draw();
    scroller.focus({ preventScroll: true });
  }

  async #step(by) {
    const index = this.list.indexOf(this.#current);
    if (index + by >= this.list.items.length) await this.list.more();
    this.#choose(index < 0 ? 0 : index + by);
  }

  async #last() {
    while (!this.list.complete && !this.list.failure && !this.#stop.signal.aborted) await this.list.more();
    if (!this.#stop.signal.aborted) this.#choose(this.list.items.length - 1);
  }

  // a link or a button that has the focus does what it does by itself
  #enter(event) {
    const item = this.list.items[this.list.indexOf(this.#current)];
    if (!item || event.target.closest('a, button')) return false;
    return this.go(`/orientations/${item.id}${searchOf(this.#filters)}`);
  }

  async #undecided() {
    for (let index = this.list.indexOf(this.#current) + 1; ; index += 1) {
      if (index >= this.list.items.length) await this.list.more();
      const item = this.list.items[index];
      if (!item) return;
      if (item.status === 'succeeded' && item.verdict !== 'green' && !item.review) { this.#choose(index); return; }
    }
  }

  #decideCurrent(decision) {
    const item = this.list.items[this.list.indexOf(this.#current)];
    if (!item || item.status !== 'succeeded' || !this.mayDecide) return false;
    return this.#decide(item, decision);
  }

  async #decide(item, decision) {
    const review = await decide(item.id, nameOf(item), decision);
    if (!review) return;
    this.list.note(item.id, { review: decision });
    this.#count();
  }
}
