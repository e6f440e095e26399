import { html, render } from '../vendor/lit.js';
import { t } from '../texts.js';

export function show(place) {
  render(html`<section class="page"><h1>${t('nowhere.title')}</h1><p>${t('nowhere.text')}</p></section>`, place);
}
