import { html, render } from '../vendor/lit.js';
import { t } from '../texts.js';

export function show(place) {
  render(html`<section class="page"><h1>${t('frame.queue')}</h1></section>`, place);
}
