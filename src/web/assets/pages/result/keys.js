// The keys of the page, the same as those of the queue.

import { onKeys, showKeys } from '../../parts/keys.js';
import { t } from '../../texts.js';

const entries = () => [
  [['j', 'k'], t('result.keys_step')], [['a'], t('result.accept')], [['r'], t('result.reject')],
  [['Ctrl Z', 'Ctrl Y'], t('result.keys_undo')], [['?'], t('keys.title')],
];

// undoing has its keys even where those of a single letter are turned off
function onUndo(state) {
  const pressed = (event) => {
    const { correcting } = state;
    if (!correcting || event.altKey || !(event.ctrlKey || event.metaKey)) return;
    if (event.target.closest?.('input:not([type="checkbox"], [type="range"]), textarea, dialog')) return;
    const key = event.key.toLowerCase();
    const act = key === 'y' || (key === 'z' && event.shiftKey) ? correcting.redo : key === 'z' ? correcting.undo : undefined;
    if (!act) return;
    event.preventDefault();
    act();
  };
  document.addEventListener('keydown', pressed);
  return () => document.removeEventListener('keydown', pressed);
}

/** Listens to the keys until what it returns is called. */
export function listenToKeys(state, acts) {
  const may = () => state.orientation.result && !state.correcting;
  const ends = [
    onUndo(state),
    onKeys({
      j: () => acts.step(state.way.next), k: () => acts.step(state.way.previous),
      a: () => may() && state.orientation.result.projection_centre && acts.accept(), r: () => may() && acts.reject(),
      '?': () => { showKeys(entries()); },
    }),
  ];
  return () => ends.forEach((end) => end());
}
