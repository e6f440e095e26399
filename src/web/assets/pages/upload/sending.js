// Sends files by tus: a few at a time, each of which can pause, and go on where it was, also after the page was closed.

import { Upload } from '../../vendor/tus.js';
import { api, Problem } from '../../api.js';

const ENDPOINT = '/api/v1/uploads';
const AT_ONCE = 3;
const AGAIN_AFTER_MS = [0, 1000, 3000, 5000, 10_000, 20_000];
// what goes away by itself: a server that is busy or being renewed, another request that still writes
const PASSES = [409, 423, 429];

// the same file for the same block is the same upload
const fingerprint = (file, { metadata }) => Promise.resolve(
  ['gable', file.name, file.type, file.size, file.lastModified, metadata.block ?? ''].join('|'));

function mayPass(error) {
  const status = error.originalResponse?.getStatus() ?? 0;
  return status < 400 || status >= 500 || PASSES.includes(status);
}

// the service answers with problem+json also where tus asks
function problemOf(error) {
  const response = error.originalResponse;
  if (!response) return error;
  try {
    return new Problem(response.getStatus(), JSON.parse(response.getBody()));
  } catch {
    return new Problem(response.getStatus(), { detail: error.message });
  }
}

async function imageOf(upload, response) {
  const id = response?.getHeader('Gable-Image');
  if (id) return id;
  const answer = await api.get(upload.url.slice(upload.url.indexOf('/uploads/')));
  return answer.image;
}

/** The files that are being sent. `entry` has `file`, `state`, `sent` and, in the end, `image` or `problem`. */
export class Sending {
  #waiting = [];
  #running = new Set();

  constructor(changed) {
    this.changed = changed;
  }

  /** Sends the file of `entry` with this metadata; `done(image id)` is called when the service has the image. */
  add(entry, metadata, done) {
    Object.assign(entry, { state: 'waiting', sent: 0, problem: null, metadata, done });
    this.#waiting.push(entry);
    this.#next();
  }

  /** Stops for a while; what was sent stays. */
  async pause(entry) {
    entry.state = 'paused';
    this.#waiting = this.#waiting.filter((other) => other !== entry);
    await entry.upload?.abort();
    this.#free(entry);
  }

  /** Goes on, or tries once more. */
  resume(entry) {
    Object.assign(entry, { state: 'waiting', problem: null });
    this.#waiting.push(entry);
    this.#next();
  }

  /** Gives up; the service forgets what was sent. */
  async cancel(entry) {
    const { upload, state } = entry;
    entry.state = 'cancelled';
    this.#waiting = this.#waiting.filter((other) => other !== entry);
    // what has become an image stays one
    if (state !== 'sent') await upload?.abort(Boolean(upload.url)).catch(() => {});
    this.#free(entry);
  }

  #free(entry) {
    this.#running.delete(entry);
    this.changed();
    this.#next();
  }

  #next() {
    while (this.#running.size < AT_ONCE && this.#waiting.length) {
      const entry = this.#waiting.shift();
      entry.state = 'sending';
      this.#running.add(entry);
      this.#start(entry);
    }
    this.changed();
  }

  async #start(entry) {
    entry.upload ??= this.#uploadOf(entry);
    const [previous] = await entry.upload.findPreviousUploads().catch(() => []);
    if (entry.state !== 'sending') return;
    if (previous && !entry.upload.url) {
      entry.resumed = true;
      entry.upload.resumeFromPreviousUpload(previous);
    }
    entry.upload.start();
  }

  #uploadOf(entry) {
    const { file, metadata } = entry;
    return new Upload(file, {
      endpoint: ENDPOINT, fingerprint, retryDelays: AGAIN_AFTER_MS, removeFingerprintOnSuccess: true,
      metadata: { filename: file.name, ...(file.type ? { filetype: file.type } : {}), ...metadata },
      onShouldRetry: mayPass,
      onProgress: (sent) => { entry.sent = sent; this.changed(); },
      onSuccess: ({ lastResponse }) => this.#succeeded(entry, lastResponse),
      onError: (error) => {
        Object.assign(entry, { state: 'failed', problem: problemOf(error), upload: null });
        this.#free(entry);
      },
    });
  }

  async #succeeded(entry, response) {
    try {
      const image = await imageOf(entry.upload, response);
      Object.assign(entry, { state: 'sent', sent: entry.file.size });
      await entry.done(image);
    } catch (problem) {
      Object.assign(entry, { state: 'failed', problem });
    }
    entry.upload = null;
    this.#free(entry);
  }
}
