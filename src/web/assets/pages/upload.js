import { html, render } from '../vendor/lit.js';
import { t } from '../texts.js';

export function show(place) {
  render(html`<section class="page"><h1>${t('frame.upload')}</h1></section>`, place);
}
