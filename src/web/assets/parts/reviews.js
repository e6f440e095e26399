// What staff decides about an orientation.

import { api } from '../api.js';
import { problemText, t } from '../texts.js';
import { askText } from './dialog.js';
import { notify } from './notices.js';

/**
 * Accepts or rejects an orientation, called `name` for people; who rejects is asked why. Returns the review, or undefined
 * if nothing was decided.
 */
export async function decide(id, name, decision) {
  let why;
  if (decision === 'rejected') {
    why = await askText({ title: t('review.reject_title', { name }), label: t('review.why'), yes: t('review.reject'), danger: true });
    if (why === undefined) return undefined;
  }
  try {
    const review = await api.post(`/orientations/${id}/reviews`, { decision, ...(why ? { why } : {}) });
    notify(t(`review.${decision}_notice`, { name }), 'done');
    return review;
  } catch (error) {
    notify(`${name}: ${problemText(error)}`, 'error');
    return undefined;
  }
}
