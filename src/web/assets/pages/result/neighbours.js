// The orientations before and after one in the list that it was opened from.

import { api, pages } from '../../api.js';

const MOST = 2000;

/** The part of an address's query that is the filter of the queue. */
export function filterOf(search) {
  const filter = new URLSearchParams(search);
  filter.delete('tab');
  filter.delete('point');
  return Object.fromEntries(filter);
}

/** `{previous, next}`: ids, as far as there are any; `next` is the one further down the list. */
export async function neighbours(id, filter, signal) {
  let previous;
  let found = false;
  try {
    for await (const items of pages('/orientations', filter, { most: MOST, signal })) {
      for (const item of items) {
        if (found) return { previous, next: item.id };
        if (item.id === id) found = true;
        else previous = item.id;
      }
    }
  } catch {
    // without a list the page is as good, only without its way on
    return {};
  }
  if (found) return { previous, next: undefined };
  // it is not in the list, having been decided about meanwhile: on to the first that is
  const { items } = await api.get('/orientations', { query: { ...filter, limit: 2 }, signal }).catch(() => ({ items: [] }));
  return { previous: undefined, next: items.find((item) => item.id !== id)?.id };
}
