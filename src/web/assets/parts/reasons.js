// Why a verdict is as it is, in plain words. The service gives a stable code, whose text stands in `texts/`, and a
// sentence of its own with the figures of the case.

import { has, t } from '../texts.js';

/** All codes that the service may give, the good one first. */
export const REASONS = [
  'verified', 'score_too_low', 'outside_experience', 'control_points_decisive', 'control_points_contradict',
  'precision_insufficient', 'fit_poor', 'configuration_weak', 'few_control_points', 'evidence_weak', 'ambiguous',
  'contradicts_approximation', 'control_missing', 'points_disagree', 'many_eliminated', 'interior_orientation_red',
  'interior_orientation_doubtful', 'approximation_degenerate', 'no_control_in_view', 'nothing_located', 'not_determined',
];

/** What `reason` (`{code, detail}`) means, in the language of the user; one that is not known says what the service says. */
export function reasonText({ code, detail }) {
  const key = `reason.${code}`;
  return has(key) ? t(key) : detail || code;
}

/** What the error `code` of a failed orientation means; `detail` where it is not known. */
export function failureText({ code, detail }) {
  const key = `failure.${code}`;
  return has(key) ? t(key) : detail || code;
}
