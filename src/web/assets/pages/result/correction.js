// Correcting by hand: which control points take part, and where their references are. Each change is tried by the
// service at once; nothing is kept until it is saved.

import { api } from '../../api.js';

const WAIT_MS = 120;
const AGAIN_MS = 1000;
const TRIES = 3;
const NOTHING = { off: [], moved: [] };

/** Whether nothing is corrected. */
export const isNothing = ({ off = [], moved = [] }) => !off.length && !moved.length;

/** A correction of orientation `id`, beginning with `first`; `changed()` is called when there is anything new to show. */
export function correction(id, first, changed) {
  let steps = [{ ...NOTHING, ...first }];
  let at = 0;
  let timer;
  let running = new AbortController();
  const self = {
    /** What is corrected now: `{off, moved}`. */
    get now() { return steps[at]; },
    /** The last answer: `{result, drawing, map, seconds}`. */
    answer: undefined,
    /** `first` while the first answer is awaited, which takes long; `again` for those after it. */
    busy: undefined,
    error: undefined,
    get mayUndo() { return at > 0; },
    get mayRedo() { return at < steps.length - 1; },
    toggle: (name, on) => next({ ...steps[at], off: on ? steps[at].off.filter((other) => other !== name)
      : [...steps[at].off, name] }),
    move: (name, at_px) => next({ ...steps[at], moved: [...steps[at].moved.filter((other) => other.name !== name),
      { name, at_px }] }),
    putBack: (name) => next({ ...steps[at], moved: steps[at].moved.filter((other) => other.name !== name) }),
    undo: () => go(Math.max(0, at - 1)),
    redo: () => go(Math.min(steps.length - 1, at + 1)),
    reset: () => { if (!isNothing(steps[at])) next(NOTHING); },
    end: () => { clearTimeout(timer); running.abort(); },
  };

  function next(step) {
    steps = [...steps.slice(0, at + 1), step];
    go(at + 1);
  }

  function go(place) {
    if (place === at) return;
    at = place;
    ask();
  }

  // the latest wins: an answer to what is no longer wanted is never shown
  function ask() {
    clearTimeout(timer);
    running.abort();
    running = new AbortController();
    self.busy = self.answer ? 'again' : 'first';
    timer = setTimeout(send, self.answer ? WAIT_MS : 0, running.signal);
    changed();
  }

  async function send(signal, tries = TRIES) {
    try {
      const answer = await api.post(`/orientations/${id}/trials`, steps[at], { signal });
      if (signal.aborted) return;
      self.answer = answer;
      self.error = undefined;
    } catch (error) {
      if (signal.aborted) return;
      // what it has prepared was cleared away meanwhile: it prepares it again
      if (error.status === 503 && tries > 1) {
        timer = setTimeout(send, AGAIN_MS, signal, tries - 1);
        return;
      }
      self.error = error;
    }
    self.busy = undefined;
    changed();
  }

  ask();
  return self;
}
