// The page of the control: map, search, health, import with a report, scenes.

import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { after, before, test } from 'node:test';
import { axe, launch, scene, service, until } from './support.js';

const XSS = '<img src=x onerror=window.hacked=1>';
let browser;
let served;

before(async () => {
  browser = await launch();
  served = await service();
});
after(async () => {
  await served?.stop();
  await browser?.close();
});

const open = (options) => browser.page(`${served.url}/control`, options);
const square = (name, at) => ({
  type: 'Feature', properties: { name, sigma_m: 0.05 },
  geometry: { type: 'MultiLineString', coordinates: [[[at, 50, 100], [at + 1e-4, 50, 100]], [[at, 50, 100], [at, 50.0001, 100]]] },
});
const collection = (...features) => Buffer.from(JSON.stringify({ type: 'FeatureCollection', features }));

async function importFile(page, buffer, crs = 'EPSG:4979') {
  await page.getByRole('tab', { name: 'Import' }).click();
  await page.locator('input[type=file]').setInputFiles({ name: 'control.geojson', mimeType: 'application/geo+json', buffer });
  await page.getByLabel('CRS').fill(crs);
  await page.getByRole('button', { name: 'Import', exact: true }).click();
}

test('all control points are found in view, and by their names', async () => {
  const { features } = scene().control;
  const page = await open();
  await page.getByText(`${features.length} in view`).waitFor();
  const name = features[0].properties.name;
  await page.getByPlaceholder('Search by name').fill(name);
  const entry = page.locator('.control-entry').filter({ hasText: name }).first();
  await page.getByText('found', { exact: false }).first().waitFor();
  await entry.click();
  await page.getByRole('heading', { name }).waitFor();
  const health = await served.api('GET', `/control-points/${encodeURIComponent(name)}/health`);
  await page.getByText(health.detail).waitFor();
  await page.getByText(`${features[0].geometry.coordinates.length}`, { exact: true }).first().waitFor();
});

test('an import says what is wrong with each feature and keeps the good ones; its table is safe in a spreadsheet', async () => {
  const page = await open();
  const bad = { type: 'Feature', geometry: null, properties: { name: '=cmd|calc' } };
  await importFile(page, collection(square(XSS, 7), bad));
  await page.getByText('=cmd|calc').waitFor();
  const row = await page.locator('.rejected tbody tr').allInnerTexts();
  assert.equal(row.length, 1);
  assert.match(row[0], /^1\s/);
  assert.match(row[0], /sigma_m is missing/);
  assert.match(await page.locator('.report-counts').innerText(), /^1 new\s+0 updated\s+1 rejected$/);
  const [download] = await Promise.all([page.waitForEvent('download'), page.getByRole('button', { name: 'Save as CSV' }).click()]);
  const lines = readFileSync(await download.path(), 'utf8').split('\r\n');
  assert.equal(lines[0], 'index,name,detail');
  assert.match(lines[1], /^1,"'=cmd\|calc",/);

  // the good one is there, its name is text and nothing else
  await page.getByRole('tab', { name: 'Points' }).click();
  await page.getByPlaceholder('Search by name').fill('img src');
  await page.locator('.control-entry').filter({ hasText: XSS }).first().click();
  await page.getByRole('heading', { name: XSS }).waitFor();
  assert.equal(await page.evaluate(() => window.hacked), undefined);
  assert.equal(await page.locator('img[src=x]').count(), 0);

  await page.getByRole('button', { name: 'Delete' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Delete' }).click();
  await page.getByText(`${XSS} is deleted`).waitFor();
  const names = (await served.api('GET', '/control-points?limit=200')).items.map((item) => item.properties.name);
  assert.ok(!names.includes(XSS) && names.length === scene().control.features.length, names.join());
});

test('a file that is no GeoJSON, and a CRS that nobody knows, are said where they are wrong', async () => {
  const page = await open();
  await importFile(page, Buffer.from('{"type": "Feat'));
  await page.getByRole('alert').filter({ hasText: 'not valid JSON' }).waitFor();
  await importFile(page, collection(square('a', 7)), 'EPSG:999');
  await page.locator('.fault').filter({ hasText: 'EPSG:999' }).waitFor();
  assert.equal(await page.getByLabel('CRS').getAttribute('aria-invalid'), 'true');
});

test('an import goes into a set, which is told of, and removed with all that is in it', async () => {
  const page = await open();
  await page.getByRole('tab', { name: 'Import' }).click();
  await page.getByLabel('Set').fill('survey 2024');
  await page.getByLabel('Use').selectOption('check');
  const { name } = scene().control.features[0].properties;
  await importFile(page, collection(square(name, 7), square('apart', 7.001)));
  await page.getByText('2 new', { exact: false }).waitFor();
  // a name that both sets have is two entries, each with what is known of it
  await page.getByRole('tab', { name: 'Points' }).click();
  await page.getByPlaceholder('Search by name').fill(name);
  await until(async () => (await page.locator('.control-entry').filter({ hasText: name }).count()) >= 2, 'both are listed');
  await page.getByPlaceholder('Search by name').fill('apart');
  await page.locator('.control-entry').filter({ hasText: 'apart' }).first().click();
  await page.getByText('only checks them').waitFor();
  await page.getByText('survey 2024').waitFor();

  await page.getByRole('tab', { name: 'Sets' }).click();
  await page.getByRole('heading', { name: 'survey 2024' }).waitFor();
  await page.getByRole('button', { name: 'Delete the set survey 2024' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Delete' }).click();
  await page.getByText('survey 2024 is deleted').waitFor();
  const kept = (await served.api('GET', '/control-sets')).items.map((set) => set.name);
  assert.deepEqual(kept, ['default']);
});

test('a scene is uploaded with its reference picked in its picture, and faults stand at their fields', async () => {
  const page = await open();
  await page.getByText(' in view').waitFor();
  await page.getByRole('tab', { name: 'Scenes' }).click();
  await page.getByText('New scene').click();
  await page.locator('.control-form input[type=file]').setInputFiles({ name: 'scene.png', mimeType: 'image/png', buffer: scene().photograph });
  const fields = { Name: 'church square', 'Ground sample distance (m)': '20', 'Std. deviation (m)': '0.05', 'East or longitude': '7', 'North or latitude': '50', 'Height (m)': '100' };
  for (const [label, value] of Object.entries(fields)) await page.getByLabel(label, { exact: true }).fill(value);
  const preview = page.locator('img.pick');
  const { width, height } = await preview.boundingBox();
  await preview.click({ position: { x: width / 2, y: height / 4 } });
  const at = await Promise.all(['px_x', 'px_y'].map((name) => page.locator(`input[name=${name}]`).inputValue().then(Number)));
  const [columns, rows] = scene().camera.image_size_px;
  assert.ok(Math.abs(at[0] - columns / 2) < 12 && Math.abs(at[1] - rows / 4) < 12, at.join());
  await page.getByRole('button', { name: 'Upload the scene' }).click();
  await page.locator('label.field', { hasText: 'Ground sample distance' }).locator('.fault').waitFor();
  await page.getByLabel('Ground sample distance (m)').fill('0.02');
  await page.getByRole('button', { name: 'Upload the scene' }).click();
  await page.getByText('The scene church square is there').waitFor();
  const [kept] = (await served.api('GET', '/control-scenes')).items;
  assert.equal(kept.name, 'church square');
  assert.ok(Math.abs(kept.reference_px[0] - at[0]) < 0.06 && kept.gsd_m === 0.02);
});

test('nothing that axe knows is wrong, in both themes and in German', async () => {
  for (const options of [{}, { theme: 'dark', language: 'de', viewport: { width: 1024, height: 768 } }]) {
    const page = await open(options);
    await until(() => page.locator('.control-entry').count(), 'the list is there');
    await axe(page);
    await page.locator('.control-entry').first().click();
    await page.locator('.health-line').waitFor();
    await axe(page);
    for (const tab of ['scenes', 'sets', 'import']) {
      await page.locator(`#tab-${tab}`).click();
      await axe(page);
    }
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), 'nothing is wider than the page');
  }
});
