// What becomes of the orientations that were begun here: by the events of the service, and now and then by asking, as
// events may be missed.

import { api, follow } from '../../api.js';

const ASKED_EVERY_MS = 4000;
const ASKED_AT_ONCE = 10;

/** Whether an orientation has come to its end. */
export const ended = ({ status }) => ['succeeded', 'failed', 'cancelled'].includes(status);

/** Keeps the `orientation` of entries up to date until they have ended. */
export class Watch {
  #open = new Map();
  #unfollow = null;
  #timer = 0;

  constructor(changed) {
    this.changed = changed;
  }

  add(entry, orientation) {
    entry.orientation = orientation;
    this.changed();
    if (ended(orientation)) return;
    this.#open.set(orientation.id, entry);
    this.#unfollow ??= follow('/orientations/events', { change: (event) => this.#heard(event), missed: () => this.#ask() });
    this.#timer ||= setTimeout(() => this.#ask(), ASKED_EVERY_MS);
  }

  #heard(event) {
    const entry = this.#open.get(event.id);
    if (!entry) return;
    Object.assign(entry.orientation, event);
    this.changed();
    if (ended(event)) this.#read(event.id);
  }

  // the whole answer, as the event has neither reasons nor an error
  async #read(id) {
    const entry = this.#open.get(id);
    const answer = await api.get(`/orientations/${id}`).catch(() => null);
    if (!answer || !entry) return;
    entry.orientation = answer;
    if (ended(answer)) this.#open.delete(id);
    this.changed();
    if (!this.#open.size) this.#rest();
  }

  async #ask() {
    clearTimeout(this.#timer);
    this.#timer = 0;
    await Promise.all([...this.#open.keys()].slice(0, ASKED_AT_ONCE).map((id) => this.#read(id)));
    if (this.#open.size) this.#timer ||= setTimeout(() => this.#ask(), ASKED_EVERY_MS);
  }

  #rest() {
    this.#unfollow?.();
    this.#unfollow = null;
    clearTimeout(this.#timer);
    this.#timer = 0;
  }
}
