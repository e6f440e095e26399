// The page of the classifiers: what a threshold decides, training, activating and rolling back, comparing.

import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { labelledSet } from './labelled.js';
import { axe, launch, service, until } from './support.js';

let browser;
let served;

before(async () => {
  browser = await launch();
  served = await service({ empty: true });
});
after(async () => {
  await served?.stop();
  await browser?.close();
});

const open = (path, options) => browser.page(`${served.url}${path}`, options);
const number = (text) => Number(text.replace(/[^\d.-]/g, ''));

/** What the page says is decided at the threshold. */
async function decided(page) {
  const count = async (name) => number(await page.locator(`[data-case=${name}] strong`).textContent());
  const [cc, cw, wc, ww] = await Promise.all(['cc', 'cw', 'wc', 'ww'].map(count));
  const threshold = Number(await page.getByRole('slider').getAttribute('aria-valuenow'));
  return { cc, cw, wc, ww, threshold, cost: number(await page.locator('[data-cost]').textContent()) };
}

function assertAsOfTheCurve(classifier, now) {
  const { curve } = classifier.evaluation;
  const expected = curve.find((point) => (point.threshold ?? -Infinity) >= now.threshold) ?? curve.at(-1);
  const [cc, cw, wc, ww] = classifier.provenance.costs;
  const images = expected.cc + expected.cw + expected.wc + expected.ww;
  assert.deepEqual([now.cc, now.cw, now.wc, now.ww], [expected.cc, expected.cw, expected.wc, expected.ww]);
  const cost = (expected.cc * cc + expected.cw * cw + expected.wc * wc + expected.ww * ww) / images;
  assert.ok(Math.abs(now.cost - cost) < 6e-5, `${now.cost} is not ${cost}`);
}

test('the threshold in use gives what the service says, and moving it by key and by pointer what the curve says', async () => {
  const classifier = await served.api('GET', '/classifiers/shipped');
  const page = await open('/diagnosis/shipped');
  await page.locator('.cost-curve').waitFor();
  const first = await decided(page);
  assert.ok(Math.abs(first.threshold - classifier.threshold) < 1e-9);
  assert.deepEqual([first.cc, first.cw, first.wc, first.ww], ['cc', 'cw', 'wc', 'ww'].map((name) => classifier.decisions[name]));
  assert.ok(Math.abs(first.cost - classifier.decisions.expected_cost) < 6e-5);

  await page.getByRole('slider').focus();
  for (let k = 0; k < 5; k += 1) await page.keyboard.press('PageUp');
  const byKey = await decided(page);
  assert.ok(byKey.threshold > first.threshold && byKey.cc + byKey.cw < first.cc + first.cw, JSON.stringify(byKey));
  assertAsOfTheCurve(classifier, byKey);

  const box = await page.locator('.cost-curve').boundingBox();
  const grip = await page.locator('.threshold circle').boundingBox();
  await page.mouse.move(grip.x + grip.width / 2, grip.y + grip.height / 2);
  await page.mouse.down();
  await page.mouse.move(box.x + 0.35 * box.width, grip.y, { steps: 4 });
  await page.mouse.up();
  const dragged = await decided(page);
  assert.ok(dragged.threshold < first.threshold && dragged.cc > first.cc, JSON.stringify(dragged));
  assertAsOfTheCurve(classifier, dragged);
  // let go is let go
  await page.mouse.move(box.x + 0.8 * box.width, grip.y);
  assert.deepEqual(await decided(page), dragged);

  await page.getByText('All thresholds').click();
  const row = await page.locator('.curve-table tr[aria-current=true] td').allTextContents();
  assert.deepEqual(row.slice(0, 4).map(number), [dragged.cc, dragged.cw, dragged.wc, dragged.ww]);
  await page.getByRole('button', { name: 'Back to the one in use' }).click();
  assert.deepEqual(await decided(page), first);
});

test('a set is uploaded, trained from with progress, decides, and is rolled back', async () => {
  const page = await open('/diagnosis');
  await page.getByLabel('a labelled set (NDJSON)').check();
  await page.locator('input[name=set]').setInputFiles({ name: 'set.ndjson', mimeType: 'application/x-ndjson', buffer: Buffer.from(labelledSet(120)) });
  await page.getByLabel('Name', { exact: true }).fill('<b>from a set</b>');
  for (const kind of ['as in the paper', 'one feature', 'support vector machine']) await page.getByLabel(kind).uncheck();
  await page.getByRole('button', { name: 'Train', exact: true }).click();
  const row = page.locator('.classifiers tbody tr').filter({ hasText: '<b>from a set</b>' });
  await row.getByText('Ready').waitFor({ timeout: 120_000 });
  const { items } = await served.api('GET', '/classifiers');
  assert.deepEqual(items.map(({ name }) => name).sort(), ['<b>from a set</b>', 'shipped']);
  assert.equal(await row.getByText('Decides now').count(), 0);

  await row.getByRole('button', { name: 'Let it decide' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Let it decide' }).click();
  await row.getByText('Decides now').waitFor();
  const active = async () => (await served.api('GET', '/classifiers')).items.find((item) => item.active).name;
  assert.equal(await active(), '<b>from a set</b>');
  await page.getByRole('button', { name: 'Roll back' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Roll back' }).click();
  await page.locator('.classifiers tbody tr').filter({ hasText: 'shipped' }).getByText('Decides now').waitFor();
  assert.equal(await active(), 'shipped');

  for (const name of ['shipped', '<b>from a set</b>']) await page.getByLabel(`Compare ${name}`).check();
  await page.getByRole('button', { name: 'Compare two' }).click();
  await page.locator('.cost-curve').nth(1).waitFor();
  assert.deepEqual(await page.locator('.classifier-name a').allTextContents(), ['shipped', '<b>from a set</b>']);
  // a file of it comes as it is
  const [download] = await Promise.all([page.waitForEvent('download'), page.locator('.classifier').nth(1).getByRole('link', { name: 'classifier.json' }).click()]);
  assert.equal(download.suggestedFilename(), 'classifier.json');
});

test('a name that is taken is said at its field', async () => {
  const page = await open('/diagnosis');
  await page.getByLabel('Name', { exact: true }).fill('shipped');
  await page.getByRole('button', { name: 'Train', exact: true }).click();
  const field = page.getByLabel('Name', { exact: false }).first();
  await page.getByText('shipped is the name of the classifier that Gable brings along').waitFor();
  assert.equal(await field.getAttribute('aria-invalid'), 'true');
});

test('nothing that axe knows is wrong, in both themes and in German', async () => {
  for (const options of [{}, { theme: 'dark', language: 'de', viewport: { width: 1024, height: 768 } }]) {
    const page = await open('/diagnosis', options);
    await page.locator('.classifiers tbody tr').first().waitFor();
    await axe(page);
    await page.goto(`${served.url}/diagnosis/shipped?with=shipped`);
    await until(() => page.locator('.cost-curve').count().then((count) => count === 2), 'both are shown');
    await axe(page);
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), 'nothing is wider than the page');
  }
});
