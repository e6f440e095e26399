// The tab with everything as the API gives it.

import { html } from '../../vendor/lit.js';
import { api } from '../../api.js';
import { t } from '../../texts.js';
import { copyButton, heading } from './figures.js';

const json = (value) => JSON.stringify(value, null, 2);

// written when it is looked at: a drawing of thousands of lines is long
const fill = (value) => ({ target }) => { if (target.open) target.querySelector('pre').textContent = json(value); };

// products and their words in the API; a product is called the same in every language
const EXPORTS = [
  ['Manifest (JSON)', 'manifest'], ['OPK (CSV)', 'opk_csv'], ['PATB', 'patb'], ['Inpho', 'inpho'], ['BINGO', 'bingo'],
  ['Applanix', 'applanix'], ['orthority', 'orthority'], ['OpenSfM', 'opensfm'], ['OpenDroneMap', 'odm'], ['Pix4D', 'pix4d'],
  ['COLMAP', 'colmap'], ['MicMac', 'micmac'], ['ArcGIS', 'esri'], ['RPC', 'rpc'], ['Footprint (GeoJSON)', 'footprints'],
];

/** The tab; `parts` are names and what the API answered under them. */
export function rawTab({ id, image, result }, parts) {
  return html`
    ${heading(t('result.files'))}
    <ul class="plain">
      <li><a href=${api.address(`/orientations/${id}/overlay`, { width: 4000 })}
        download="${id}.jpg">${t('result.overlay')}</a></li>
      <li><a href=${api.address(`/orientations/${id}`)} download="${id}.json">${t('result.json')}</a></li>
      <li><a href=${api.address(`/orientations/${id}/map`)} download="${id}.geojson">${t('result.geojson')}</a></li>
      <li><a href=${api.address(`/images/${image}`)} target="_blank">${t('result.image_json')}</a></li>
    </ul>
    ${result?.projection_centre ? html`${heading(t('result.exports'))}
    <p>${t('result.exports_why')}</p>
    <ul class="plain">${EXPORTS.map(([product, format]) => html`
      <li><a href=${api.address(`/orientations/${id}/export`, { format })} download>${product}</a></li>`)}</ul>` : ''}
    ${parts.filter(([, value]) => value).map(([name, value], k) => html`
      <details class="raw" ?open=${k === 0} @toggle=${fill(value)}><summary>${name}</summary>
      ${copyButton(() => json(value))}<pre tabindex="0" role="region" aria-label=${name}></pre></details>`)}`;
}
