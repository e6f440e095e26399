// The tab with the orientation itself: where the camera stood, how it was turned, how well that is known, and how it was found.

import { html, nothing } from '../../vendor/lit.js';
import { number, seconds, t, time } from '../../texts.js';
import { copyButton, deviations, figures, heading, isGeographic } from './figures.js';

const ANGLES = ['omega', 'phi', 'kappa'];
const fixed = (value, digits) => number(value, digits, { exactly: true });

function rows(result) {
  const sigma = deviations(result) ?? [];
  const { coordinates, crs } = result.projection_centre;
  const degrees = isGeographic(crs);
  const position = coordinates.map((value, k) => ({
    name: t(`result.axis_${degrees ? 'geographic' : 'metric'}_${k}`), sigma: sigma[k],
    value, digits: degrees && k < 2 ? 9 : 3, unit: degrees && k < 2 ? '°' : 'm', sigmaUnit: 'm', sigmaDigits: 3,
  }));
  const angles = ANGLES.map((name, k) => ({
    name: t(`result.${name}`), sigma: sigma[3 + k], value: result.rotation[`${name}_deg`], digits: 5, unit: '°', sigmaUnit: '°',
      sigmaDigits: 5,
  }));
  return [...position, ...angles];
}

function exterior(result) {
  const all = rows(result);
  const text = () => all.map((row) => [row.name, row.value, row.sigma ?? ''].join('\t')).join('\n');
  return html`
    ${heading(t('result.exterior'), copyButton(text))}
    <table class="figure-table exterior">
      <thead><tr><th scope="col"><span class="unseen">${t('result.parameter')}</span></th><th scope="col">${t('result.value')}</th>
        <th scope="col">${t('result.sigma')}</th></tr></thead>
      <tbody>${all.map((row) => html`<tr><th scope="row">${row.name}</th><td>${fixed(row.value, row.digits)} ${row.unit}</td>
        <td>${row.sigma === undefined ? '–' : html`± ${fixed(row.sigma, row.sigmaDigits)} ${row.sigmaUnit}`}</td></tr>`)}</tbody>
    </table>
    ${figures([[t('result.crs'), html`<code>${result.projection_centre.crs}</code>`],
      [t('result.frame'), result.rotation.frame === result.projection_centre.crs ? undefined
        : html`<code>${result.rotation.frame}</code>`]])}
    ${heading(t('result.rotation'), copyButton(() => result.rotation.rotation_matrix.map((row) => row.join('\t')).join('\n')))}
    <table class="figure-table matrix" aria-label=${t('result.rotation')}><tbody>
      ${result.rotation.rotation_matrix.map((row) => html`
        <tr>${row.map((value) => html`<td>${fixed(value, 8)}</td>`)}</tr>`)}</tbody></table>`;
}

function covariance({ order, matrix }) {
  const text = () => [order.join('\t'), ...matrix.map((row) => row.join('\t'))].join('\n');
  return html`<details><summary>${t('result.covariance')}</summary>
    <div class="wide" tabindex="0" role="region" aria-label=${t('result.covariance')}>
      <table class="figure-table matrix small"><thead><tr>
        <td></td>${order.map((name) => html`<th scope="col">${name}</th>`)}</tr></thead>
        <tbody>${matrix.map((row, k) => html`<tr>
          <th scope="row">${order[k]}</th>${row.map((value) => html`
            <td>${value.toExponential(2)}</td>`)}</tr>`)}</tbody></table></div>
    ${copyButton(text)}</details>`;
}

function approximation(used) {
  const origin = (part) => html`<span class="origin">${t(`result.origin_${used.origin[part]}`)}</span>`;
  const degrees = isGeographic(used.position.crs);
  const place = used.position.coordinates.map((value, k) => number(value, degrees && k < 2 ? 7 : 2)).join(' · ');
  return html`${heading(t('result.approximation'))}${figures([
    [t('result.position'), html`${place} ${origin('position')}<br><span
      class="quiet-text">± ${used.sigma_position_m.map((value) => number(value,
        2)).join(' / ')} m · <code>${used.position.crs}</code></span>`],
    [t('result.tilt'), html`ω ${number(used.omega_deg, 2)}°, φ ${number(used.phi_deg, 2)}° ± ${number(used.sigma_tilt_deg,
      2)}° ${origin('tilt')}`],
    [t('result.kappa'), used.kappa_deg === undefined || used.kappa_deg === null
      ? html`${t('result.whole_circle')} ${origin('kappa')}`
      : html`${number(used.kappa_deg, 2)}° ± ${number(used.sigma_kappa_deg, 2)}° ${origin('kappa')}`],
  ])}`;
}

function search(report) {
  return html`${heading(t('result.search'))}${figures([
    [t('result.search_tilt'), `${number(report.tilt_reach_deg, 1)}°`],
    [t('result.search_kappa'), report.kappa_reach_deg === undefined ? t('result.whole_circle')
      : `± ${number(report.kappa_reach_deg, 1)}°`],
    [t('result.search_position'), `± ${report.position_reach_m.map((value) => number(value, 1)).join(' / ')} m`],
    [t('result.search_height'), `${report.flying_height_m.map((value) => number(value, 1)).join(' … ')} m`],
    ...['views', 'windows', 'pairs', 'refined', 'adjusted'].map((name) => [t(`result.search_${name}`), number(report[name], 0)]),
    [t('result.search_points'), number(report.control_points, 0)],
    [t('result.search_pixels'), `${number(report.megapixels_read, 1)} MP`],
  ])}`;
}

function interior(film) {
  const mark = (entry) => html`<tr><th scope="row">${entry.name}</th><td>${entry.used === undefined ? '' : entry.used
    ? t('result.used') : t('result.not_used')}</td>
    <td>${entry.residual_px === undefined ? '–' : fixed(Array.isArray(entry.residual_px) ? Math.hypot(...entry.residual_px)
      : entry.residual_px, 2)} px</td></tr>`;
  return html`${heading(t('result.interior'))}${figures([
    [t('result.interior_verdict'), t(`verdict.${film.diagnosis.verdict}`)],
    [t('result.transformation'), film.transformation?.kind], [t('result.sigma0'), number(film.transformation?.sigma0, 3)],
    [t('result.pixel_size'), `${number(film.pixel_size_um, 3)} µm`], [t('result.polarity'), film.polarity],
  ])}${film.diagnosis.reasons.map((reason) => html`<p class="quiet-text">${reason.detail}</p>`)}
    <table class="figure-table"><tbody>${film.marks.map(mark)}</tbody></table>`;
}

function quality(result, camera) {
  const { consensus, diagnosis } = result;
  const agreed = consensus && t('result.consensus_text',
    { inliers: consensus.inliers, points: consensus.control_points, search: t(`result.consensus_${consensus.search}`) });
  return html`${heading(t('result.quality'))}${figures([
    [t('result.sigma0'), result.sigma0 === undefined ? undefined : fixed(result.sigma0, 3)],
    [t('result.redundancy'), result.redundancy === undefined ? undefined : number(result.redundancy, 0)],
    [t('result.configuration'), result.configuration === undefined ? undefined : number(result.configuration, 1)],
    [t('result.consensus'), agreed],
    [t('result.camera'), camera?.name],
    [t('result.principal_distance'), camera?.principal_distance_px ? `${number(camera.principal_distance_px, 1)} px`
      : camera?.principal_distance_mm ? `${number(camera.principal_distance_mm, 3)} mm` : undefined],
    [t('result.classifier'), html`${diagnosis.classifier.name} <span class="quiet-text">${diagnosis.classifier.kind}</span>`],
  ])}`;
}

function times(orientation) {
  const took = orientation.finished_at && orientation.started_at
    ? (new Date(orientation.finished_at) - new Date(orientation.started_at)) / 1000 : undefined;
  return html`${heading(t('result.times'))}${figures([
    [t('result.asked'), time(orientation.created_at, { dateStyle: 'medium', timeStyle: 'medium' })],
    [t('result.took'), took === undefined ? undefined : seconds(took)],
    [t('result.attempts'), number(orientation.attempts, 0)],
  ])}`;
}

/** The tab; `result` is what is shown: that of the orientation, or of a trial. */
export function orientationTab({ orientation, camera }, result) {
  return html`
    ${result.projection_centre && result.rotation ? exterior(result) : html`<p>${t('result.no_orientation')}</p>`}
    ${result.covariance ? covariance(result.covariance) : nothing}
    ${quality(result, camera)}
    ${result.warnings.length ? html`${heading(t('result.warnings'))}
      <ul class="plain">${result.warnings.map((warning) => html`<li class="warning">${warning.detail}</li>`)}</ul>` : nothing}
    ${result.approximation ? approximation(result.approximation) : nothing}
    ${result.search ? search(result.search) : nothing}
    ${result.interior_orientation ? interior(result.interior_orientation) : nothing}
    ${times(orientation)}`;
}
