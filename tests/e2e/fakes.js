// Answers of the API that a test makes up: many rows, hostile names, an outcome that is hard to bring about.

/** An id in the order of time, of which `number` is the age. */
export function idOf(number) {
  return `01a22311-0000-7000-8000-${String(999_999_999_999 - number).padStart(12, '0')}`;
}

/** An orientation as lists have it; `number` 0 is the newest. */
export function orientation(number, changed = {}) {
  const verdict = ['green', 'yellow', 'red'][number % 3];
  return {
    id: idOf(number), image: idOf(number), camera: idOf(0), image_name: `IMG_${String(number).padStart(5, '0')}.jpg`, camera_name: 'camera',
    status: 'succeeded', stage: 'diagnose', progress: 1, attempts: 1, verdict, error: null, created_at: new Date(Date.UTC(2026, 10, 28) - number * 60_000).toISOString(),
    diagnosis: { score: 3 - (number % 3) * 2, probability_correct: [0.999, 0.8, 0.2][number % 3], reasons: [{ code: 'score_too_low', detail: `detail ${number}` }] },
    ...changed,
  };
}

/** Lets `page` have `items` as the list of orientations, page by page, as the service pages them. */
export async function fakeOrientations(page, items, { onList } = {}) {
  await page.route(/\/api\/v1\/orientations\?/, async (route) => {
    const query = new URL(route.request().url()).searchParams;
    onList?.(query);
    const wanted = items.filter((item) => (!query.get('verdict') || item.verdict === query.get('verdict'))
      && (!query.get('status') || item.status === query.get('status'))
      && (query.get('review') !== 'open' || (item.status === 'succeeded' && !item.review)));
    const limit = Number(query.get('limit') ?? 50);
    const from = query.get('cursor') ? wanted.findIndex(({ id }) => id === query.get('cursor')) + 1 : 0;
    const some = wanted.slice(from, from + limit);
    const isMore = from + limit < wanted.length;
    await route.fulfill({ json: { items: some, ...(isMore ? { next_cursor: some.at(-1).id } : {}) } });
  });
}

/** Lets `page` hear these events of all orientations, once. */
export async function fakeEvents(page, events) {
  let told = false;
  await page.route(/\/api\/v1\/orientations\/events/, (route) => {
    const body = told ? '' : events.map((event) => `event: change\ndata: ${JSON.stringify(event)}\n\n`).join('');
    told = true;
    return route.fulfill({ contentType: 'text/event-stream', body: `retry: 100000\n\n${body}` });
  });
}
