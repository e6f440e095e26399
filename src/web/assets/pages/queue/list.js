// The orientations that are known to the page, newest first, as the service gives them page by page and as its events
// change them.

import { api, follow, Problem } from '../../api.js';

const PAGE = 200;
const AGAIN_MS = 5000;
const LEAST_BETWEEN_MS = 1000;
const AT_ONCE = 4;
const ENDED = ['succeeded', 'failed', 'cancelled'];

const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

// as the list has it, out of the answer for a single one
function withDiagnosis(answer) {
  const found = answer.result?.diagnosis;
  return { ...answer, result: undefined, review: answer.review?.decision ?? answer.review, ...(found ? { diagnosis: found } : {}) };
}

/**
 * A list for one query of the API. `changed(count)` is called, at most once in a frame, when something is another than
 * before; `count` are the rows that were put in above all that were there.
 */
export class OrientationList {
  items = [];
  complete = false;
  failure = null;
  #byId = new Map();
  #cursor;
  #loading = null;
  #query;
  #changed;
  #events = new Map();
  #frame = 0;
  #above = 0;
  #refreshed = 0;
  #refreshing = null;
  #asked = 0;
  #stop = new AbortController();
  #unfollow = () => {};
  #timers = new Set();

  constructor(query, changed) {
    this.#query = query;
    this.#changed = changed;
  }

  /** Begins to listen to what happens in the service. */
  live() {
    this.#unfollow();
    this.#unfollow = follow('/orientations/events', {
      change: (event) => this.#heard(event),
      missed: () => this.refresh(),
      // closed for good, as the session has ended or the service is being renewed: later again
      error: (_, source) => source.readyState === EventSource.CLOSED && this.#later(() => { this.live(); this.refresh(); }, AGAIN_MS),
    });
  }

  /** Listens no more, until `live`: a browser has few connections to a service for all its windows together. */
  rest() {
    this.#unfollow();
    this.#timers.forEach(clearTimeout);
    this.#timers.clear();
    this.#refreshing = null;
  }

  end() {
    this.#stop.abort();
    this.#unfollow();
    this.#timers.forEach(clearTimeout);
    cancelAnimationFrame(this.#frame);
  }

  /** Loads the next page, once however often it is asked for. */
  more() {
    if (this.complete || this.#stop.signal.aborted) return Promise.resolve();
    this.#loading ??= this.#next().finally(() => { this.#loading = null; this.#tell(); });
    return this.#loading;
  }

  /** The place of an orientation, or -1. */
  indexOf(id) {
    const item = this.#byId.get(id);
    return item ? this.items.indexOf(item) : -1;
  }

  /** Something has become known of one, as a review. */
  note(id, known) {
    const item = this.#byId.get(id);
    if (item) Object.assign(item, known);
    this.#tell();
  }

  /** Asks for the newest ones again, soon, and not more often than once a second. */
  refresh() {
    this.#refreshing ??= this.#later(() => this.#newest(), Math.max(0, this.#refreshed + LEAST_BETWEEN_MS - Date.now()));
  }

  /** Brings those up to date of which an event said that they have ended, if they are among `items`: those in view. */
  complement(items) {
    for (const item of items.filter((one) => one.stale && this.#asked < AT_ONCE)) {
      item.stale = false;
      this.#asked += 1;
      this.#get(`/orientations/${item.id}`)
        .then((answer) => this.note(item.id, withDiagnosis(answer)), () => {})
        .finally(() => { this.#asked -= 1; });
    }
  }

  async #get(path, query) {
    for (;;) {
      try {
        return await api.get(path, { query, signal: this.#stop.signal });
      } catch (error) {
        if (!(error instanceof Problem) || ![429, 503].includes(error.status)) throw error;
        await pause(1000 * (error.retryAfter_s ?? 1));
      }
    }
  }

  async #next() {
    try {
      const page = await this.#get('/orientations', { ...this.#query, limit: PAGE, cursor: this.#cursor });
      this.failure = null;
      this.#cursor = page.next_cursor ?? undefined;
      this.complete = !this.#cursor;
      for (const item of page.items.filter(({ id }) => !this.#byId.has(id))) {
        this.items.push(item);
        this.#byId.set(item.id, item);
      }
    } catch (error) {
      if (error.name !== 'AbortError') this.failure = error;
    }
  }

  async #newest() {
    this.#refreshing = null;
    this.#refreshed = Date.now();
    try {
      const page = await this.#get('/orientations', { ...this.#query, limit: PAGE });
      const first = this.items[0]?.id ?? '';
      for (const item of page.items) this.#put(item, first);
      // a list that was empty, or failed, has no place yet from where to go on
      if (this.items.length <= page.items.length) { this.#cursor = page.next_cursor ?? undefined; this.complete = !this.#cursor; }
      this.failure = null;
    } catch (error) {
      if (error.name !== 'AbortError' && !this.items.length) this.failure = error;
    }
    this.#tell();
  }

  #put(item, first) {
    const known = this.#byId.get(item.id);
    if (known) { Object.assign(known, item); return; }
    // ids are made in the order of time
    const before = this.items.findIndex(({ id }) => id < item.id);
    this.items.splice(before < 0 ? this.items.length : before, 0, item);
    this.#byId.set(item.id, item);
    if (item.id > first && first) this.#above += 1;
  }

  #heard(event) {
    this.#events.set(event.id, { ...this.#events.get(event.id), ...event });
    this.#tell();
  }

  #take() {
    for (const [id, event] of this.#events) {
      const item = this.#byId.get(id);
      if (item) Object.assign(item, event, { stale: ENDED.includes(event.status) });
      else this.refresh();
    }
    this.#events.clear();
  }

  #tell() {
    this.#frame ||= requestAnimationFrame(() => {
      this.#frame = 0;
      this.#take();
      const above = this.#above;
      this.#above = 0;
      this.#changed(above);
    });
  }

  #later(task, ms) {
    const timer = setTimeout(() => { this.#timers.delete(timer); task(); }, ms);
    this.#timers.add(timer);
    return timer;
  }
}
