// What the lights mean and what to do with them.

import { html, render } from '../vendor/lit.js';
import { t } from '../texts.js';
import { keyList } from '../parts/keys.js';
import { verdict } from '../parts/verdict.js';
import { queueKeys } from './queue.js';

/** Shows the help in `place`. */
export function show(place) {
  render(html`<section class="page help"><h1>${t('help.title')}</h1>
    <h2>${t('help.lights')}</h2>
    <dl class="lights">${['green', 'yellow', 'red', 'none'].map((name) => html`<dt>${verdict(name)}</dt><dd>${t(`help.${name}`)}</dd>`)}</dl>
    <p>${t('help.score')}</p>
    <h2>${t('help.yellow_title')}</h2>
    <ol>${[1, 2, 3, 4, 5].map((step) => html`<li>${t(`help.yellow_${step}`)}</li>`)}</ol>
    <h2>${t('help.keys')}</h2>
    ${keyList(queueKeys())}
    <h2>${t('help.api')}</h2>
    <p>${t('help.api_text')} <a href="/docs">${t('help.api_link')}</a></p>
  </section>`, place);
}
