// What is being uploaded and oriented. It goes on while other pages are looked at, and is there again on coming back.

import { api, pages, Problem } from '../../api.js';
import { t } from '../../texts.js';
import { recognised } from './cameras.js';
import { ended, Watch } from './watch.js';
import { listOf, listProblem, postList } from './list.js';
import { parsePosition } from './position.js';
import { Sending } from './sending.js';
import { fresh, orientationRequest } from './settings.js';

const LARGEST_TO_MEASURE_BYTES = 60_000_000;

const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

// `randomUUID` is there only with TLS or on this machine
function newKey() {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, '0')).join('');
}

// the first look at a large image takes seconds: it begins here, while the image is oriented
function stored(image) {
  new Image().src = api.address(`/images/${image}/thumbnail`);
  return api.get(`/images/${image}`);
}

/** All that is known of one image: its file, how much of it is sent, the image, where it was taken, its orientation. */
class Entry {
  state = 'new';
  sent = 0;
  image = null;
  typed = '';
  editing = false;
  orientation = null;
  fault = null;
  problem = null;
  key = null;

  constructor(file) {
    this.file = file;
    this.name = file.name;
  }
}

class Work {
  entries = [];
  list = null;
  settings = fresh();
  cameras = [];
  errors = [];
  problem = null;
  starting = false;
  started = false;
  #heard = new Set();
  #frame = 0;
  #sending = new Sending(() => this.tell());
  #watch = new Watch(() => this.tell());

  /** Calls `heard` when something has changed, at most once in a frame. Returns a function that ends it. */
  listen(heard) {
    this.#heard.add(heard);
    return () => this.#heard.delete(heard);
  }

  tell() {
    this.#frame ||= requestAnimationFrame(() => {
      this.#frame = 0;
      this.#heard.forEach((heard) => heard());
    });
  }

  async loadCameras() {
    const found = [];
    for await (const items of pages('/cameras')) found.push(...items);
    this.cameras = found;
    this.tell();
  }

  change(settings) {
    Object.assign(this.settings, settings);
    this.errors = [];
    // with another request the same key would be refused
    for (const entry of this.entries) Object.assign(entry, { fault: null, key: null });
    this.tell();
  }

  /** Takes files that were chosen or dropped: images, and at most one list. */
  add(files) {
    for (const file of files) {
      if (listOf(file)) this.#takeList(file);
      else if (!this.entries.some(({ file: known }) => known.name === file.name && known.size === file.size)) this.#takeImage(file);
    }
    this.tell();
  }

  #takeImage(file) {
    const entry = new Entry(file);
    this.entries.push(entry);
    if (!this.list) this.#send(entry);
    else if (this.list.block) this.#sendListed(entry);
  }

  // images of a list are sent for its block, which begins with the start
  #takeList(file) {
    this.list = { file, ...listOf(file), block: null, names: null, problem: null };
    this.settings.block ||= file.name.replace(/\.\w+$/, '');
    this.started = false;
    for (const entry of this.entries.filter(({ state }) => ['waiting', 'sending', 'paused'].includes(state))) {
      this.#sending.cancel(entry).then(() => Object.assign(entry, { state: 'new', upload: null }));
    }
  }

  dropList() {
    this.list = null;
    this.entries.filter(({ state }) => state === 'new').forEach((entry) => this.#send(entry));
    this.tell();
  }

  pause(entry) { this.#sending.pause(entry); }

  resume(entry) { this.#sending.resume(entry); }

  async remove(entry) {
    await this.#sending.cancel(entry);
    this.entries = this.entries.filter((other) => other !== entry);
    this.tell();
  }

  /** Lets go of what is done, or of all that no longer moves. */
  clear() {
    const moves = ({ state, orientation }) => ['waiting', 'sending'].includes(state) || (orientation && !ended(orientation));
    this.entries = this.entries.filter(moves);
    if (!this.entries.length) Object.assign(this, { list: null, started: false, problem: null, errors: [] });
    this.tell();
  }

  #send(entry) {
    this.#sending.add(entry, {}, async (image) => {
      entry.image = await stored(image);
      if (this.started) await this.#orient(entry);
    });
  }

  #sendListed(entry) {
    const listed = this.list.names.get(entry.name.toLowerCase());
    if (!listed) { entry.state = 'unlisted'; return; }
    entry.upload = null;
    this.#sending.add(entry, { block: this.list.block.id, filename: listed }, async (image) => {
      entry.image = await stored(image);
      const { items: [orientation] } = await api.get('/orientations', { query: { image, limit: 1 } });
      if (orientation) this.#watch.add(entry, orientation);
    });
  }

  /** The camera of an entry: the chosen one, or that which its image shows. */
  cameraOf({ image }) {
    if (this.settings.camera) return this.cameras.find(({ id }) => id === this.settings.camera);
    return image ? recognised(image, this.cameras) : undefined;
  }

  /** What an entry still lacks: `position`, `camera`, `typed` (a position that is none), or nothing. */
  lacks(entry) {
    if (!entry.image || this.list || entry.orientation) return undefined;
    if (entry.typed.trim() && !parsePosition(entry.typed)) return 'typed';
    if (!entry.typed.trim() && !entry.image.position) return 'position';
    return this.cameraOf(entry) ? undefined : 'camera';
  }

  /** Orients all that is complete, and what becomes complete later. */
  async start() {
    Object.assign(this, { starting: true, problem: null, errors: [] });
    this.tell();
    if (this.list) await this.#startList();
    else {
      this.started = true;
      await Promise.all(this.entries.filter(({ state }) => state === 'sent').map((entry) => this.#orient(entry)));
    }
    this.starting = false;
    this.tell();
  }

  async #startList() {
    try {
      const camera = this.settings.camera || (await this.#cameraOfList())?.id;
      if (!camera) { this.errors = [{ pointer: '/camera', detail: t('upload.camera_missing') }]; return; }
      Object.assign(this.list, await postList(this.list, this.settings, camera));
      this.started = true;
      this.entries.forEach((entry) => this.#sendListed(entry));
    } catch (error) {
      this.list.problem = listProblem(error);
      this.errors = error instanceof Problem ? error.errors : [];
    }
  }

  // the service has not seen an image yet: the browser measures one
  async #cameraOfList() {
    const seen = this.entries.find(({ image }) => image);
    if (seen) return recognised(seen.image, this.cameras);
    const small = this.entries.find(({ file }) => file.size < LARGEST_TO_MEASURE_BYTES);
    const picture = small && await createImageBitmap(small.file, { imageOrientation: 'none' }).catch(() => null);
    return picture ? recognised({ width_px: picture.width, height_px: picture.height }, this.cameras) : undefined;
  }

  async #orient(entry) {
    if (entry.orientation || this.lacks(entry)) return;
    const request = orientationRequest(this.settings, {
      image: entry.image.id, camera: this.cameraOf(entry).id, coordinates: parsePosition(entry.typed),
    });
    entry.key ??= newKey();
    entry.fault = null;
    for (;;) {
      try {
        this.#watch.add(entry, await api.post('/orientations', request, { headers: { 'Idempotency-Key': entry.key } }));
        return;
      } catch (error) {
        if (error instanceof Problem && [429, 503].includes(error.status)) { await pause(1000 * (error.retryAfter_s ?? 5)); continue; }
        entry.fault = error;
        if (error instanceof Problem) { entry.key = null; this.errors = error.errors; }
        return;
      }
    }
  }
}

/** The one work of this window. */
export const work = new Work();
