// The queue: what is listed, filters, keys, decisions, many rows, hostile names.

import assert from 'node:assert/strict';
import { after, before, describe, test } from 'node:test';
import { fakeEvents, fakeOrientations, idOf, orientation } from './fakes.js';
import { axe, knows, launch, oriented, scene, service, until, variant } from './support.js';

let running;
let browser;
let yellow;
before(async () => {
  [running, browser] = [await service(), await launch()];
  // a threshold that nothing reaches: right, but not green
  yellow = await oriented(running, { bytes: variant(scene().photograph, 'yellow'), name: 'doubtful.png', request: { threshold: 99 } });
  assert.equal(yellow.verdict, 'yellow');
});
after(async () => { await running?.stop(); await browser?.close(); });

const rowOf = (page, id) => page.locator(`#row-${id}`);
const current = (page) => page.locator('[role=row][aria-selected=true]');

// answers a decision like the service, where it does not know decisions yet
async function decisions(page) {
  const sent = [];
  const known = await knows(running, 'POST', '/orientations/{id}/reviews');
  await page.route(/\/reviews$/, async (route) => {
    if (route.request().method() !== 'POST') return route.fallback();
    const body = route.request().postDataJSON();
    sent.push({ id: route.request().url().split('/').at(-2), ...body });
    return known ? route.continue() : route.fulfill({ status: 201, json: { id: idOf(1), ...body, who: 'loopback', created_at: new Date().toISOString() } });
  });
  return sent;
}

describe('what is listed', () => {
  test('verdicts by word and shape, newest first, and a row leads to its result', async () => {
    const page = await browser.page(running.url);
    const rows = page.locator('.body [role=row]');
    await rows.nth(1).waitFor();
    assert.match(await rows.nth(0).innerText(), /Yellow/);
    assert.match(await rows.nth(1).innerText(), /Green/);
    assert.equal(await rows.nth(1).locator('svg.light-green').count(), 1);
    assert.equal(await page.getByRole('grid').getAttribute('aria-rowcount'), '3');
    await rows.nth(1).getByRole('link').click();
    await page.waitForURL(`**/orientations/${running.orientation}`);
  });

  test('name, score, probability and reasons', async (t) => {
    const [item] = (await running.api('GET', '/orientations?limit=1')).items;
    if (!item.image_name) { t.skip('the service does not list them yet'); return; }
    const page = await browser.page(running.url);
    const text = await rowOf(page, yellow.id).innerText();
    assert.match(text, /doubtful\.png/);
    assert.ok(text.includes(item.diagnosis.score.toFixed(1)), text);
    assert.match(text, /All the evidence together is not enough/);
    if (!(await knows(running, 'GET', '/images/{id}/thumbnail'))) return;
    await rowOf(page, yellow.id).locator('img').waitFor();
    await until(() => rowOf(page, yellow.id).locator('img').evaluate((img) => img.naturalWidth > 0), 'the thumbnail is there');
  });

  test('a service where nothing was oriented says what to do first', async () => {
    const empty = await service({ empty: true });
    const page = await browser.page(empty.url);
    await page.getByRole('link', { name: 'Import control points' }).waitFor();
    await axe(page);
    await page.getByRole('link', { name: 'Upload images' }).click();
    await page.waitForURL('**/upload');
    await page.close();
    await empty.stop();
  });
});

describe('filters', () => {
  test('are in the address, and the back button undoes them', async () => {
    const page = await browser.page(running.url);
    await rowOf(page, running.orientation).waitFor();
    await page.getByRole('combobox', { name: 'Verdict' }).selectOption('yellow');
    await rowOf(page, running.orientation).waitFor({ state: 'detached' });
    assert.equal(new URL(page.url()).search, '?verdict=yellow');
    await rowOf(page, yellow.id).waitFor();
    await page.goBack();
    await rowOf(page, running.orientation).waitFor();
    assert.equal(await page.getByRole('combobox', { name: 'Verdict' }).inputValue(), '');
  });

  test('an address that was sent shows the same; nothing found can be undone', async () => {
    const page = await browser.page(`${running.url}/?verdict=red`);
    await page.getByText('No orientation matches these filters.').waitFor();
    assert.equal(await page.getByRole('combobox', { name: 'Verdict' }).inputValue(), 'red');
    await axe(page);
    await page.locator('.nothing').getByRole('button', { name: 'Clear filters' }).click();
    await rowOf(page, yellow.id).waitFor();
    assert.equal(new URL(page.url()).search, '');
  });

  test('all of them reach the service, and a link to a result takes them along', async () => {
    const asked = [];
    const page = await browser.page(`${running.url}/?verdict=yellow&review=open&reason=ambiguous&time=24h&q=IMG`, {
      prepare: (opened) => fakeOrientations(opened, [orientation(1)], { onList: (query) => asked.push(Object.fromEntries(query)) }),
    });
    const query = await until(() => asked.find(({ reason }) => reason), 'the list was asked for');
    assert.deepEqual({ ...query, since: undefined }, { verdict: 'yellow', review: 'open', reason: 'ambiguous', q: 'IMG', limit: '200', since: undefined });
    assert.ok(Math.abs(Date.now() - 24 * 3_600_000 - new Date(query.since)) < 60_000);
    const link = await rowOf(page, idOf(1)).getByRole('link').getAttribute('href');
    assert.match(link, /\?q=IMG&verdict=yellow&review=open&reason=ambiguous&time=24h$/);
    await page.getByRole('searchbox').fill('other name');
    await until(() => asked.some(({ q }) => q === 'other name'), 'the search was sent');
    assert.equal(new URL(page.url()).searchParams.get('q'), 'other name');
  });
});

describe('keys', () => {
  test('go through the rows, open one, and come back to it', async () => {
    const page = await browser.page(running.url);
    await rowOf(page, yellow.id).waitFor();
    await page.keyboard.press('j');
    assert.equal(await current(page).getAttribute('id'), `row-${yellow.id}`);
    await page.keyboard.press('ArrowDown');
    assert.equal(await current(page).getAttribute('id'), `row-${running.orientation}`);
    assert.equal(await page.getByRole('grid').getAttribute('aria-activedescendant'), `row-${running.orientation}`);
    await page.keyboard.press('k');
    assert.equal(await current(page).getAttribute('id'), `row-${yellow.id}`);
    await page.keyboard.press('Enter');
    await page.waitForURL(`**/orientations/${yellow.id}`);
    await page.goBack();
    await current(page).waitFor();
    assert.equal(await current(page).getAttribute('id'), `row-${yellow.id}`);
  });

  test('accept one, reject another with the reason why', async () => {
    let sent;
    const page = await browser.page(running.url, { prepare: async (opened) => { sent = await decisions(opened); } });
    await rowOf(page, yellow.id).waitFor();
    await page.keyboard.press('u');
    assert.equal(await current(page).getAttribute('id'), `row-${yellow.id}`);
    await page.keyboard.press('r');
    const dialog = page.getByRole('dialog');
    await dialog.waitFor();
    await axe(page);
    // an answer is required
    await dialog.getByRole('button', { name: 'Reject', exact: true }).click();
    assert.ok(await dialog.isVisible());
    await page.keyboard.type('the roofs are beside the lines');
    await dialog.getByRole('button', { name: 'Reject', exact: true }).click();
    await rowOf(page, yellow.id).getByText('Rejected').waitFor();
    await page.keyboard.press('j');
    await page.keyboard.press('a');
    await rowOf(page, running.orientation).getByText('Accepted').waitFor();
    assert.deepEqual(sent, [
      { id: yellow.id, decision: 'rejected', why: 'the roofs are beside the lines' }, { id: running.orientation, decision: 'accepted' },
    ]);
    if (await knows(running, 'GET', '/orientations/{id}/reviews')) {
      const { items: [review] } = await running.api('GET', `/orientations/${yellow.id}/reviews`);
      assert.equal(review.why, 'the roofs are beside the lines');
    }
  });

  test('do nothing where somebody types, nor when they are turned off', async () => {
    let sent;
    const page = await browser.page(running.url, { prepare: async (opened) => { sent = await decisions(opened); } });
    await rowOf(page, yellow.id).waitFor();
    await page.keyboard.press('/');
    await page.keyboard.type('jar');
    assert.equal(await page.getByRole('searchbox').inputValue(), 'jar');
    await page.getByRole('searchbox').fill('');
    await rowOf(page, yellow.id).waitFor();
    await page.getByRole('button', { name: 'Keys' }).click();
    await axe(page);
    await page.getByRole('checkbox', { name: /single character/ }).uncheck();
    await page.keyboard.press('Escape');
    await page.getByRole('grid').focus();
    for (const key of ['j', 'a', 'r', 'u', '?']) await page.keyboard.press(key);
    assert.equal(await current(page).count(), 0);
    assert.equal(await page.getByRole('dialog').count(), 0);
    // those that are no characters still do
    await page.keyboard.press('ArrowDown');
    assert.equal(await current(page).count(), 1);
    assert.deepEqual(sent, []);
  });

  test('a reader may not decide', async () => {
    const accounts = [{ name: 'rita', role: 'reader', password: 'a long password of hers' }];
    const closed = await service({ accounts });
    const page = await browser.page(closed.url);
    await page.getByLabel('Name').fill('rita');
    await page.getByLabel('Password').fill(accounts[0].password);
    await page.keyboard.press('Enter');
    await rowOf(page, closed.orientation).waitFor();
    assert.equal(await page.getByRole('button', { name: /^Accept/ }).count(), 0);
    await page.close();
    await closed.stop();
  });
});

describe('live', () => {
  test('progress and the end of an orientation, without a reload', async () => {
    const items = [orientation(0, { status: 'running', stage: 'locate', progress: 0.3, verdict: undefined, diagnosis: undefined }), orientation(1)];
    let done = false;
    const page = await browser.page(running.url, {
      prepare: async (opened) => {
        await fakeOrientations(opened, items);
        await fakeEvents(opened, [{ id: items[0].id, status: 'running', stage: 'adjust', progress: 0.7 }]);
        await opened.route(`**/api/v1/orientations/${items[0].id}`, (route) => { done = true; return route.fulfill({ json: { ...items[0], status: 'succeeded' } }); });
      },
    });
    const row = rowOf(page, items[0].id);
    await row.getByText('Adjust with lines').waitFor();
    await until(async () => Number(await row.locator('progress').evaluate((bar) => bar.value)) === 0.7, 'the bar follows');
    assert.equal(done, false);
  });

  test('a new orientation appears and gets its verdict', async (t) => {
    if (!(await knows(running, 'GET', '/orientations/events'))) { t.skip('the service has no events of all yet'); return; }
    const page = await browser.page(running.url);
    await rowOf(page, yellow.id).waitFor();
    const { camera, approximation } = scene();
    const fresh = await running.api('POST', '/orientations', { image: running.image, camera: camera.name, approximation });
    await rowOf(page, fresh.id).waitFor();
    await rowOf(page, fresh.id).getByText('Green').waitFor({ timeout: 120_000 });
    await rowOf(page, fresh.id).getByText('Everything agrees').waitFor();
  });
});

test('a page of the list that cannot be had is said, and asked for again', async () => {
  const items = Array.from({ length: 400 }, (_, number) => orientation(number));
  let broken = true;
  const page = await browser.page(running.url, {
    prepare: async (opened) => {
      await fakeOrientations(opened, items);
      await opened.route(/\/api\/v1\/orientations\?.*cursor=/, (route) => (broken
        ? route.fulfill({ status: 500, contentType: 'application/problem+json', json: { title: 'Out of order', detail: 'Out of order for now.' } }) : route.fallback()));
    },
  });
  await rowOf(page, idOf(0)).waitFor();
  await page.keyboard.press('End');
  await page.getByRole('alert').getByText('Out of order for now.').waitFor();
  await axe(page);
  broken = false;
  await page.getByRole('button', { name: 'Try again' }).click();
  await page.getByRole('alert').waitFor({ state: 'detached' });
  await page.keyboard.press('End');
  await rowOf(page, idOf(399)).waitFor();
});

test('a window that is not seen gives its connection back', async () => {
  let connections = 0;
  const page = await browser.page(running.url, {
    prepare: (opened) => opened.route(/\/orientations\/events/, (route) => {
      connections += 1;
      return route.fulfill({ contentType: 'text/event-stream', body: 'retry: 100000\n\n' });
    }),
  });
  await rowOf(page, yellow.id).waitFor();
  assert.equal(connections, 1);
  const seen = (hidden) => page.evaluate((value) => {
    Object.defineProperty(document, 'hidden', { value, configurable: true });
    document.dispatchEvent(new Event('visibilitychange'));
  }, hidden);
  await seen(true);
  await seen(false);
  await until(() => connections === 2, 'it listens again');
});

test('ten thousand rows: the first ones at once, the last ones by a key, few of them in the document', async () => {
  const items = Array.from({ length: 10_000 }, (_, number) => orientation(number));
  const begun = Date.now();
  const page = await browser.page(running.url, { prepare: (opened) => fakeOrientations(opened, items) });
  await rowOf(page, idOf(0)).waitFor();
  assert.ok(Date.now() - begun < 5000, `${Date.now() - begun} ms until the first row`);
  const grid = page.getByRole('grid');
  await grid.evaluate((place) => { place.scrollTop = 150 * 48; });
  await rowOf(page, idOf(155)).waitFor();
  await page.keyboard.press('End');
  await rowOf(page, idOf(9999)).waitFor({ timeout: 60_000 });
  assert.equal(await rowOf(page, idOf(9999)).getAttribute('aria-rowindex'), '10001');
  assert.equal(await grid.getAttribute('aria-rowcount'), '10001');
  assert.ok(await page.locator('[role=row]').count() < 60);
  // a thousand steps of scrolling draw quickly
  const took = await grid.evaluate(async (place) => {
    const from = performance.now();
    for (let step = 0; step < 50; step += 1) {
      place.scrollTop = (step * 9999 * 48) / 50;
      await new Promise(requestAnimationFrame);
    }
    return performance.now() - from;
  });
  assert.ok(took < 5000, `${took} ms for 50 jumps`);
  await page.keyboard.press('Home');
  await rowOf(page, idOf(0)).waitFor();
});

test('hostile names are text', async () => {
  const evil = '<img src=x onerror="window.hit=1"><script>window.hit=2</script>';
  const reasons = [{ code: evil, detail: evil }];
  const items = [orientation(0, { image_name: evil, camera_name: evil, diagnosis: { score: 1, probability_correct: 0.5, reasons } }),
    orientation(1, { status: 'failed', verdict: undefined, diagnosis: undefined, error: { code: evil, detail: evil } })];
  const page = await browser.page(`${running.url}/?q=${encodeURIComponent(evil)}&verdict=&reason=${encodeURIComponent(evil)}&block=${encodeURIComponent(evil)}`, {
    prepare: async (opened) => {
      await fakeOrientations(opened, items);
      for (const path of ['cameras', 'blocks']) await opened.route(`**/api/v1/${path}?*`, (route) => route.fulfill({ json: { items: [{ id: idOf(1), name: evil }] } }));
    },
  });
  await rowOf(page, idOf(0)).waitFor();
  assert.equal(await rowOf(page, idOf(0)).getByRole('link').innerText(), evil);
  assert.ok((await rowOf(page, idOf(0)).locator('.cell-reasons').innerText()).includes(evil));
  assert.ok((await rowOf(page, idOf(1)).innerText()).includes(evil));
  assert.equal(await page.getByRole('searchbox').inputValue(), evil);
  assert.equal(await page.evaluate(() => window.hit), undefined);
  assert.equal(await page.locator('main img[src=x], main script').count(), 0);
});

for (const theme of ['light', 'dark']) {
  for (const language of ['en', 'de']) {
    test(`accessible: ${theme}, ${language}`, async () => {
      const items = Array.from({ length: 40 }, (_, number) => orientation(number, number % 4 ? {} : { review: 'accepted' }));
      items[0] = { ...items[0], status: 'running', stage: 'adjust', progress: 0.4, verdict: undefined, diagnosis: undefined };
      items[1] = { ...items[1], status: 'failed', error: { code: 'timeout', detail: 'too long' }, verdict: undefined, diagnosis: undefined };
      const page = await browser.page(running.url, { theme, language, prepare: (opened) => fakeOrientations(opened, items) });
      await rowOf(page, idOf(3)).waitFor();
      await axe(page);
      await page.keyboard.press('j');
      await page.keyboard.press('j');
      await axe(page);
    });
  }
}
