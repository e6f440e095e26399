// The dashboard and the help.

import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { axe, knows, launch, service, until } from './support.js';

let running;
let browser;
before(async () => { [running, browser] = [await service(), await launch()]; });
after(async () => { await running?.stop(); await browser?.close(); });

const COUNTS = [[4, 2, 1, 0], [0, 0, 0, 0], [1, 0, 3, 2]];
const DAY_MS = 86_400_000;

function statistics() {
  const until_ = Date.UTC(2026, 10, 28, 12);
  const steps = COUNTS.map(([green, yellow, red, failed], index) => ({
    at: new Date(Date.UTC(2026, 10, 26 + index)).toISOString(), submitted: 9, succeeded: green + yellow + red, failed, cancelled: 0, green, yellow, red, accepted: index, rejected: 0,
  }));
  return {
    since: new Date(until_ - 7 * DAY_MS).toISOString(), until: new Date(until_).toISOString(), step: 'day', steps, queued: 17, running: 2,
    oldest_queued_at: new Date(Date.now() - 30_000).toISOString(), seconds: { median: 0.8, p95: 4 },
    failures: [{ code: 'timeout', count: 2 }], reasons: [{ code: 'ambiguous', count: 5 }, { code: '<img src=x onerror="window.hit=1">', count: 1 }],
  };
}

const faked = (asked = []) => ({
  prepare: (page) => page.route(/\/api\/v1\/statistics/, (route) => { asked.push(new URL(route.request().url()).searchParams); return route.fulfill({ json: statistics() }); }),
});

test('the bars and the table say the same as the service', async () => {
  const page = await browser.page(`${running.url}/dashboard`, faked());
  await page.getByText('Service ready').waitFor();
  const heights = async (part) => page.locator(`.chart .bar-${part}`).evaluateAll((bars) => bars.map((bar) => bar.getBBox().height));
  const [green] = await heights('green');
  const near = (value, wanted) => assert.ok(Math.abs(value - wanted) < 0.01 * green, `${value} is not ${wanted}`);
  const [yellow] = await heights('yellow');
  near(yellow, green / 2);
  const red = await heights('red');
  near(red[0], green / 4);
  near(red[1], (3 / 4) * green);
  assert.equal((await heights('failed')).length, 1);
  await page.getByText('As a table').click();
  const cells = await page.locator('.as-table tbody tr').first().locator('td').allInnerTexts();
  assert.deepEqual(cells, ['9', '1', '0', '3', '2', '0', '2', '0']);
  assert.match(await page.locator('.figures-of').innerText(), /waiting\s+17\s+running\s+2\s[\s\S]*oriented in the span\s+11\s/);
  assert.equal(await page.evaluate(() => window.hit), undefined);
  await axe(page);
});

test('reasons and failures lead to those that are counted', async () => {
  const page = await browser.page(`${running.url}/dashboard`, faked());
  const link = page.getByRole('link', { name: 'Another orientation fits nearly as well' });
  const address = new URL(await link.getAttribute('href'), running.url);
  assert.deepEqual([address.pathname, address.searchParams.get('reason'), address.searchParams.get('since')], ['/', 'ambiguous', statistics().since]);
  const failures = await page.getByRole('link', { name: 'It took longer than it may' }).getAttribute('href');
  assert.match(failures, /^\/\?status=failed&since=/);
});

test('span and step are in the address', async () => {
  const asked = [];
  const page = await browser.page(`${running.url}/dashboard?span=24h`, faked(asked));
  await page.locator('.chart').waitFor();
  assert.equal(asked.at(-1).get('step'), 'hour');
  await page.getByLabel('Span').selectOption('30d');
  await until(() => Date.now() - new Date(asked.at(-1).get('since')) > 29 * DAY_MS, 'the longer span was asked for');
  assert.match(page.url(), /span=30d/);
  await page.goBack();
  await until(async () => (await page.getByLabel('Span').inputValue()) === '24h', 'the span is back');
});

test('the real figures', async (t) => {
  if (!(await knows(running, 'GET', '/statistics'))) { t.skip('the service has no statistics yet'); return; }
  const page = await browser.page(`${running.url}/dashboard`);
  await page.locator('.chart .bar-green').waitFor();
  await page.getByRole('link', { name: 'Everything agrees' }).click();
  await page.locator(`#row-${running.orientation}`).waitFor();
});

for (const theme of ['light', 'dark']) {
  test(`accessible: ${theme}`, async () => {
    const page = await browser.page(`${running.url}/dashboard`, { theme, language: 'de', viewport: { width: 1024, height: 768 }, ...faked() });
    await page.locator('.chart').waitFor();
    await axe(page);
    await page.goto(`${running.url}/help`);
    await page.locator('.lights').waitFor();
    await axe(page);
  });
}

test('the help leads to the documentation of the API', async () => {
  const page = await browser.page(`${running.url}/help`);
  assert.equal(await page.getByRole('link', { name: 'Its documentation' }).getAttribute('href'), '/docs');
});
