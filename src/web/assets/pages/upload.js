// Uploading images, with or without a list of their positions, and straight on to what was found.

import { html, nothing, render } from '../vendor/lit.js';
import { problemText, t } from '../texts.js';
import { notify } from '../parts/notices.js';
import { newCamera } from './upload/cameras.js';
import { listLine } from './upload/list.js';
import { settingsForm } from './upload/settings.js';
import { table } from './upload/table.js';
import { ended } from './upload/watch.js';
import { work } from './upload/work.js';

/** Shows the upload in `place`. */
export function show(place, { may, go }) {
  if (!may('operator')) {
    render(html`<section class="page"><h1>${t('upload.title')}</h1><p>${t('upload.not_allowed')}</p></section>`, place);
    return undefined;
  }
  const draw = () => {
    render(page(), place);
    const only = straightOn();
    if (only) { only.shown = true; go(`/orientations/${only.orientation.id}`); }
  };
  const endListening = work.listen(draw);
  // a file that is dropped beside the place for it would be opened by the browser
  const ignore = (event) => event.preventDefault();
  ['dragover', 'drop'].forEach((name) => addEventListener(name, ignore));
  // what had ended before this page was opened is left where it is
  work.entries.filter(({ orientation }) => orientation && ended(orientation)).forEach((entry) => { entry.shown = true; });
  work.loadCameras().catch((error) => notify(problemText(error), 'error'));
  draw();
  return () => {
    endListening();
    ['dragover', 'drop'].forEach((name) => removeEventListener(name, ignore));
  };
}

// one image alone leads straight to its result
function straightOn() {
  const [only] = work.entries;
  return work.entries.length === 1 && only.orientation?.status === 'succeeded' && !only.shown ? only : undefined;
}

function page() {
  const { entries, list } = work;
  const some = entries.length > 0 || list !== null;
  return html`<section class="page upload ${some ? 'with-files' : ''}">
    <h1>${t('upload.title')}</h1>
    <div class="upload-main">${dropZone(some)}
      ${list ? listLine(list, entries, () => work.dropList()) : nothing}
      ${entries.length ? table(work) : nothing}</div>
    <aside class="upload-side"><h2>${t('upload.settings')}</h2>
      ${settingsForm({ settings: work.settings, cameras: work.cameras, errors: work.errors, hasList: list !== null, mayAdd: true,
        change: (changed) => work.change(changed), addCamera })}
      ${some ? start() : nothing}</aside>
  </section>`;
}

function dropZone(some) {
  const over = (event) => { event.preventDefault(); event.currentTarget.classList.add('over'); };
  const out = (event) => event.currentTarget.classList.remove('over');
  const drop = (event) => { out(event); event.preventDefault(); work.add(event.dataTransfer.files); };
  const chosen = (event) => { work.add(event.target.files); event.target.value = ''; };
  return html`<div class="drop-zone" @dragover=${over} @dragleave=${out} @drop=${drop}>
    <label class="drop-label"><span class="drop-button">${t('upload.choose')}</span>
      <input type="file" multiple accept="image/jpeg,image/tiff,image/png,.csv,.tsv,.txt,.geojson,.json" @change=${chosen}></label>
    <span>${t('upload.drop')}</span>
    ${some ? nothing : html`<p class="quiet-text">${t('upload.drop_list')}</p>`}</div>`;
}

function start() {
  const { entries, list, starting } = work;
  const done = entries.filter(({ orientation }) => orientation && ended(orientation)).length;
  const begun = entries.filter(({ orientation }) => orientation).length;
  const lacking = entries.filter((entry) => work.lacks(entry)).length;
  const sendings = entries.filter(({ state }) => ['waiting', 'sending'].includes(state)).length;
  const open = list ? !list.block : entries.some((entry) => !entry.orientation && entry.state !== 'failed') && !(work.started && !lacking && sendings);
  return html`<div class="start">
    <button type="button" class="main" ?disabled=${starting || !open || (!list && lacking === entries.length)} @click=${() => work.start()}>
      ${t(entries.length === 1 && !list ? 'upload.start_one' : 'upload.start')}</button>
    <p role="status">${[
      sendings ? t('upload.still_sending', { count: sendings }) : '',
      lacking ? t('upload.still_lacking', { count: lacking }) : '',
      begun ? t('upload.done', { done, all: begun }) : '',
    ].filter(Boolean).join(' · ')}</p>
    ${done ? html`<button type="button" class="quiet" @click=${() => work.clear()}>${t('upload.clear')}</button>` : nothing}</div>`;
}

async function addCamera() {
  const image = work.entries.find((entry) => entry.image && !work.cameraOf(entry))?.image;
  const camera = await newCamera({ name: image?.camera_model ?? '', size: image ? [image.width_px, image.height_px] : [] });
  if (camera) await work.loadCameras();
}
