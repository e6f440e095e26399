// Training a classifier: from the service's own history, or from a labelled set.

import { html, nothing } from '../../vendor/lit.js';
import { api } from '../../api.js';
import { faultOf, faultsOf, inputField } from '../../parts/fields.js';
import { problemText, t } from '../../texts.js';
import { CASES } from './cost.js';

const KINDS = ['paper', 'one_feature', 'evidence_svm', 'evidence_logistic'];
const COSTS = [0, 40, 5, 10];

/** What is kept of the form while the page is there. */
export const newTraining = () => ({ from: 'history', file: undefined, busy: false, error: undefined });

function request(state, form) {
  const name = form.elements.name.value.trim();
  const kinds = KINDS.filter((kind) => form.elements[kind].checked);
  const activate = Boolean(form.elements.activate?.checked);
  if (state.from === 'set') return [state.file,
    { query: { name, kinds: kinds.length === KINDS.length ? undefined : kinds.join(','), activate },
      type: 'application/x-ndjson' }];
  const costs = Object.fromEntries(CASES.map((one) => [one, Number(form.elements[`cost_${one}`].value)]));
  return [{ name, activate, costs, ...(kinds.length === KINDS.length ? {} : { kinds }) }, {}];
}

/** The form; `acts`: `{draw, begun(classifier)}`, `mayActivate` whether the caller may let it decide at once. */
export function training(state, mayActivate, acts) {
  const faults = faultsOf(state.error);
  const submit = async (event) => {
    event.preventDefault();
    const [body, options] = request(state, event.target);
    Object.assign(state, { busy: true, error: undefined });
    acts.draw();
    try {
      const classifier = await api.post('/classifiers', body, options);
      Object.assign(state, newTraining(), { from: state.from });
      event.target.reset();
      acts.begun(classifier);
    } catch (error) {
      Object.assign(state, { busy: false, error });
    }
    acts.draw();
  };
  const from = (name) => html`
    <label class="check"><input type="radio" name="from" value=${name} .checked=${state.from === name}
      @change=${() => { state.from = name; acts.draw(); }}> ${t(`diagnosis.from_${name}`)}</label>`;
  const nameFault = faultOf(faults, '/name') ?? faultOf(faults, '?name');
  return html`<form class="control-form training" @submit=${submit}>
    <fieldset class="field-wide"><legend>${t('diagnosis.from')}</legend>${['history', 'set'].map(from)}</fieldset>
    ${state.from === 'set' ? html`<label class="drop field-wide"><span>${state.file?.name ?? t('diagnosis.set_file')}</span>
      <input type="file" name="set" accept=".ndjson,.jsonl,application/x-ndjson"
        @change=${(event) => { state.file = event.target.files[0]; acts.draw(); }}></label>` : nothing}
    ${inputField(t('diagnosis.name'), 'name', nameFault, { required: true, wide: true })}
    <fieldset class="field-wide">
      <legend>${t('diagnosis.kinds')}</legend>${KINDS.map((kind) => html`
        <label class="check"><input type="checkbox" name=${kind} checked> ${t(`diagnosis.kind_${kind}`)}</label>`)}</fieldset>
    ${state.from === 'history' ? html`<fieldset class="field-wide costs">
      <legend>${t('diagnosis.costs')}</legend>${CASES.map((one, k) => inputField(t(`diagnosis.case_${one}`), `cost_${one}`,
        faultOf(faults, `/costs/${one}`), { type: 'number', step: 'any', value: COSTS[k], required: true }))}</fieldset>` : nothing}
    ${mayActivate ? html`<label class="check field-wide"><input type="checkbox"
      name="activate"> ${t('diagnosis.activate_ready')}</label>` : nothing}
    <div class="field-wide"><button type="submit" class="main" ?disabled=${state.busy
      || (state.from === 'set' && !state.file)}>${t('diagnosis.train')}</button></div>
    ${state.error && !nameFault ? html`<p class="fault field-wide" role="alert">${problemText(state.error)}</p>` : nothing}</form>`;
}
