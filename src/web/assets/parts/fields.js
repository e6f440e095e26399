// Fields of forms, with what the service says is wrong with each.

import { html, nothing } from '../vendor/lit.js';
import { Problem } from '../api.js';

/** What the service says of fields, by their pointers (`/gsd_m`, `?crs`); empty for other errors. */
export function faultsOf(error) {
  return new Map(error instanceof Problem ? error.errors.map(({ pointer, detail }) => [pointer, detail]) : []);
}

/** The fault of a field: of its pointer itself, or of a part of it. */
export function faultOf(faults, pointer) {
  for (const [at, detail] of faults ?? []) if (at === pointer || at.startsWith(`${pointer}/`)) return detail;
  return undefined;
}

/** A labelled input; `options` are attributes of it: `type`, `value`, `step`, `required`, `hint` … */
export function inputField(label, name, fault, { type = 'text', value = '', step, min, max, required = false, hint, changed,
  wide = false } = {}) {
  const about = fault || hint ? `about-${name}` : nothing;
  return html`<label class="field ${wide ? 'field-wide' : ''}"><span>${label}</span>
    <input name=${name} type=${type} .value=${String(value)} step=${step ?? nothing} min=${min ?? nothing} max=${max ?? nothing}
      ?required=${required}
      aria-invalid=${fault ? 'true' : nothing} aria-describedby=${about} @input=${changed ?? nothing}>
    ${fault ? html`<span class="fault" id="about-${name}">${fault}</span>` : hint
      ? html`<span class="hint" id="about-${name}">${hint}</span>` : nothing}</label>`;
}
