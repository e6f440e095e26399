// One classifier with all that is known of it.

import { html, nothing } from '../../vendor/lit.js';
import { api } from '../../api.js';
import { has, number, t, time } from '../../texts.js';
import { figures, heading } from '../result/figures.js';
import { calibration } from './calibration.js';
import { CASES, expectedCost } from './cost.js';
import { confusionTable, costCurve, curveTable } from './curve.js';

const DRIFTED = 0.25;

// what a feature means, in words; its name where that is not known
const featureText = (name) => (has(`feature.${name}`) ? t(`feature.${name}`) : name);

const kindText = (kind) => (has(`diagnosis.kind_${kind}`) ? t(`diagnosis.kind_${kind}`) : kind);

// the parts of a classifier that its thresholds are about; undefined while it is not trained
function modelOf({ evaluation, provenance, threshold }) {
  return evaluation && { evaluation, costs: provenance?.costs ?? [0, 40, 5, 10], shipped: threshold };
}

function decisions(classifier, model, threshold, move) {
  return html`${heading(t('diagnosis.curve'), model.shipped === undefined ? nothing
    : html`<button type="button" class="small" ?disabled=${threshold === model.shipped}
      @click=${() => move(model.shipped)}>${t('diagnosis.back_to_shipped')}</button>`)}
    <p class="quiet-text">${t('diagnosis.curve_text', { images: number(model.evaluation.images, 0),
      right: number(model.evaluation.right, 0),
        costs: CASES.map((name, k) => `${t(`diagnosis.case_${name}`)} ${number(model.costs[k])}`).join(', ') })}</p>
    ${costCurve(model, threshold, move)}
    ${confusionTable(model, threshold)}
    ${curveTable(model, threshold, move)}`;
}

function driftBar({ index, drifted }) {
  return html`<span class="drift-bar" aria-hidden="true"><span class=${drifted ? 'over' : ''}
    .style=${`width: ${Math.min(100, 50 * index / DRIFTED)}%`}></span></span>
    ${drifted ? html`<strong class="fault">▲ ${t('diagnosis.drifted')}</strong>` : nothing}`;
}

function features(classifier) {
  const drift = new Map((classifier.drift ?? []).map((entry) => [entry.feature, entry]));
  return html`${heading(t('diagnosis.features'))}
    <p class="quiet-text">${drift.size ? t('diagnosis.drift_text') : t('diagnosis.no_drift')}</p>
    <table class="figure-table feature-table"><thead><tr><th scope="col">${t('diagnosis.feature')}</th>${drift.size
      ? html`<th scope="col" class="figure">${t('diagnosis.drift')}</th>
        <th scope="col"><span class="unseen">${t('diagnosis.drift')}</span></th>` : nothing}</tr></thead>
      <tbody>${classifier.features.map((name) => html`<tr>
        <th scope="row">${featureText(name)} <code class="quiet-text">${name}</code></th>
        ${drift.size ? html`<td class="figure">${number(drift.get(name)?.index, 3)}</td>
          <td class="drift">${drift.has(name) ? driftBar(drift.get(name)) : nothing}</td>` : nothing}</tr>`)}</tbody></table>`;
}

function compared(kinds, costs, kept) {
  const areas = [...new Set(kinds.flatMap((kind) => kind.areas_not_trained_on.map(({ area }) => area)))];
  const counts = ({ confusion }) => Object.fromEntries(CASES.map((name, k) => [name, confusion[k]]));
  const cell = (kind, area) => {
    const entry = kind.areas_not_trained_on.find((other) => other.area === area);
    if (!entry) return html`<td class="figure">–</td>`;
    const words = CASES.map((name, k) => `${t(`diagnosis.case_${name}`)} ${number(entry.confusion[k], 0)}`).join(', ');
    return html`<td class="figure" title=${words}>${number(entry.cost ?? expectedCost(counts(entry), costs), 3,
      { exactly: true })}</td>`;
  };
  return html`<div class="wide" tabindex="0" role="region" aria-label=${t('diagnosis.compared')}><table class="figure-table">
    <thead><tr><th scope="col">${t('diagnosis.kind')}</th>
      <th scope="col" class="figure">${t('diagnosis.cross_validated')}</th>${areas.map((area) => html`
        <th scope="col" class="figure">${area}</th>`)}<th scope="col" class="figure">${t('diagnosis.caution')}</th></tr></thead>
    <tbody>${kinds.map((kind) => html`<tr class=${kind.kind === kept ? 'selected' : ''}>
      <th scope="row">${kindText(kind.kind)}${kind.kind === kept ? html` <span class="quiet-text">${t('diagnosis.kept')}</span>`
        : nothing}</th>
      <td class="figure">${number(kind.cost_cross_validated, 3, { exactly: true })}</td>${areas.map((area) => cell(kind, area))}
        <td class="figure">${number(kind.caution, 1)}</td></tr>`)}</tbody></table></div>`;
}

function provenance(classifier) {
  const { provenance: from } = classifier;
  const set = ({ name, images, sha256 }) => html`
    <div>${name} <span class="quiet-text">${t('diagnosis.set_images', { images: number(images, 0) })} · <code>${sha256?.slice(0,
      12)}</code></span></div>`;
  return html`${heading(t('diagnosis.provenance'))}${figures([
    [t('diagnosis.sets'), from.sets?.length ? from.sets.map(set) : undefined],
    [t('diagnosis.sets_not'), from.sets_not_trained_on?.length ? from.sets_not_trained_on.map(set) : undefined],
    [t('diagnosis.areas'), from.areas
      && Object.entries(from.areas).map(([area, images]) => `${area} ${number(images, 0)}`).join(', ')],
    [t('diagnosis.samples'), from.samples === undefined ? undefined : t('diagnosis.samples_used',
      { used: number(from.samples_used, 0), all: number(from.samples, 0) })],
    [t('diagnosis.folds'), number(from.folds, 0)], [t('diagnosis.support_vectors'), number(from.support_vectors, 0)],
      [t('diagnosis.seed'), String(from.seed ?? '')], [t('diagnosis.program'), from.program],
  ])}
    ${from.compared?.length ? html`${heading(t('diagnosis.compared'))}
      <p class="quiet-text">${t('diagnosis.compared_text')}</p>${compared(from.compared, from.costs, classifier.kind)}` : nothing}`;
}

function files({ id, files: names }) {
  return html`${heading(t('diagnosis.files'))}
    <ul class="plain files">${names.map((name) => html`
      <li><a href=${api.address(`/classifiers/${encodeURIComponent(id)}/${name}`)} download=${name}>${name}</a></li>`)}</ul>`;
}

/** The sections of a classifier; `threshold` as it is moved to, `acts`: `{move, activate}`, the latter only where one may. */
export function detail(classifier, threshold, { move, activate, link }) {
  const model = modelOf(classifier);
  return html`<article class="classifier">
    <h2 class="classifier-name">${link ? html`<a href="/diagnosis/${encodeURIComponent(classifier.id)}">${classifier.name}</a>`
      : classifier.name}
      ${classifier.active ? html`<span class="active-mark">✓ ${t('diagnosis.active')}</span>` : activate
        && classifier.status === 'ready'
          ? html`<button type="button" class="small" @click=${() => activate(classifier)}>${t('diagnosis.activate')}</button>`
            : nothing}</h2>
    <div class="classifier-parts"><div>
    ${classifier.error ? html`<p class="fault" role="alert">${classifier.error}</p>` : nothing}
    ${figures([[t('diagnosis.status'), t(`diagnosis.status_${classifier.status}`)],
      [t('diagnosis.kind'), classifier.kind && kindText(classifier.kind)],
      [t('diagnosis.shipped_threshold'), classifier.threshold === undefined ? (model ? t('diagnosis.never') : undefined)
        : number(classifier.threshold, 4)], [t('diagnosis.caution'), classifier.caution === undefined ? undefined
          : number(classifier.caution, 2)],
      [t('diagnosis.finished'), classifier.finished_at ? time(classifier.finished_at) : undefined],
        ['SHA-256', classifier.sha256 && html`<code>${classifier.sha256}</code>`]])}
    ${model ? decisions(classifier, model, threshold ?? model.shipped ?? model.evaluation.curve.at(-1).threshold ?? 0, move)
      : nothing}
    ${classifier.files?.length ? files(classifier) : nothing}</div><div>
    ${model ? html`${heading(t('diagnosis.calibration'))}${calibration(classifier.evaluation)}` : nothing}
    ${classifier.provenance ? provenance(classifier) : nothing}
    ${classifier.features?.length ? features(classifier) : nothing}</div></div></article>`;
}
