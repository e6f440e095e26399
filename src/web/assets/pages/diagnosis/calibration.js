// Whether the probabilities are honest: the share that is right over the probability that was given.

import { html, svg } from '../../vendor/lit.js';
import { number, percent, t } from '../../texts.js';
import { axis, FRAME, grid } from './axes.js';

const ENDS = 8;
const SHARES = [0.001, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999];
const logOdds = (share) => Math.min(ENDS, Math.max(-ENDS, Math.log(share / (1 - share))));

const isHonest = ({ observed, interval: [low, high] }) => observed >= low && observed <= high;

/** The plot and its table, of an evaluation. */
export function calibration({ bins, calibration_error: error }) {
  const [x, y] = [axis(-ENDS, ENDS, 'across'), axis(-ENDS, ENDS, 'up')];
  const written = (at) => SHARES.map((share) => [at(logOdds(share)), percent(share, 1)]);
  const bin = (entry) => {
    const at = x(logOdds(entry.predicted));
    const [low, high] = entry.interval.map((share) => y(logOdds(share)));
    const place = y(logOdds(entry.observed));
    const mark = isHonest(entry) ? svg`<circle cx=${at} cy=${place} r="4.5"></circle>`
      : svg`<path class="cross" d="M${at - 5} ${place - 5}l10 10M${at + 5} ${place - 5}l-10 10"></path>`;
    return svg`<g class=${isHonest(entry) ? 'honest' : 'dishonest'}>
      <path d="M${at} ${low}V${high}M${at - 4} ${low}h8M${at - 4} ${high}h8"></path>${mark}</g>`;
  };
  return html`<svg class="plot calibration" viewBox="0 0 ${FRAME.width} ${FRAME.height}" role="img"
    aria-label=${t('diagnosis.calibration')}>
      ${grid(written(x), written(y), t('diagnosis.predicted'), t('diagnosis.observed'))}
      ${svg`<path class="diagonal" d="M${x(-ENDS)} ${y(-ENDS)}L${x(ENDS)} ${y(ENDS)}"></path>${bins.map(bin)}`}</svg>
    <p class="quiet-text">${t('diagnosis.calibration_error', { error: number(error, 4) })} ${t('diagnosis.honest_key')}</p>
    <details><summary>${t('diagnosis.as_table')}</summary><table class="figure-table"><thead><tr>
      <th scope="col" class="figure">${t('diagnosis.predicted')}</th><th scope="col" class="figure">${t('diagnosis.observed')}</th>
        <th scope="col" class="figure">${t('diagnosis.interval')}</th>
          <th scope="col" class="figure">${t('diagnosis.images')}</th></tr></thead>
      <tbody>${bins.map((entry) => html`<tr><td class="figure">${percent(entry.predicted, 2)}</td>
        <td class="figure">${percent(entry.observed, 2)}${isHonest(entry) ? ''
          : html` <strong class="fault">▲<span class="unseen">${t('diagnosis.dishonest')}</span></strong>`}</td>
            <td class="figure">${entry.interval.map((share) => percent(share, 1)).join(' … ')}</td>
              <td class="figure">${number(entry.images, 0)}</td></tr>`)}</tbody></table></details>`;
}
