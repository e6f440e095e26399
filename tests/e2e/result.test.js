// The page of an orientation: the viewer shows what the API says, table and viewer go together, corrections by hand.

import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { decoded, viewerScale } from './pixels.js';
import { axe, launch, oriented, scene, service, until, variant } from './support.js';

const MATCHED = [0x56, 0xb4, 0xe9];
const XSS = '<img src=x onerror=window.hacked=1>';
const OTHERS = 30;
let browser;
let served;
let drawing;

before(async () => {
  browser = await launch();
  served = await service();
  drawing = await served.api('GET', `/orientations/${served.orientation}/drawing`);
});
after(async () => {
  await served?.stop();
  await browser?.close();
});

async function open({ query = '', id = served.orientation, ...options } = {}) {
  const page = await browser.page(`${served.url}/orientations/${id}${query}`, options);
  await page.locator('.viewer-map canvas').first().waitFor();
  await page.waitForLoadState('networkidle');
  return page;
}

/** Shows only these layers. */
async function only(page, ...names) {
  for (const box of await page.locator('.viewer-layer input').all()) await box.setChecked(names.includes(await box.getAttribute('name')));
}

async function screen(page) {
  await page.mouse.move(2, 2);
  return decoded(browser.browser, await page.screenshot());
}

const middle = ([a, b]) => [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
const length = ([a, b]) => Math.hypot(b[0] - a[0], b[1] - a[1]);
const apart = (one, other) => Math.hypot(...one.map((value, k) => value - other[k]));
const inside = ([x, y]) => x > 20 && y > 20 && x < drawing.image.width_px - 20 && y < drawing.image.height_px - 20;
const matched = () => drawing.control_points.filter((point) => point.state === 'matched' && point.located_px && inside(point.located_px));
const beside = ([x, y]) => x > 0.35 * drawing.image.width_px || y > 0.6 * drawing.image.height_px;

test('control lines lie on the screen where the API has them in the image, and nowhere else', async () => {
  const page = await open();
  await only(page, 'edges');
  const { toScreen } = await viewerScale(page);
  const edges = drawing.edges.filter((edge) => drawing.control_points[edge.control_point].state === 'matched' && edge.projected_px.every(inside) && length(edge.projected_px) > 40 && beside(middle(edge.projected_px)));
  assert.ok(edges.length >= 5, `${edges.length} edges to look at`);
  const picture = await screen(page);
  for (const { projected_px } of edges.slice(0, 12)) {
    const [x, y] = toScreen(middle(projected_px));
    const near = [-1, 0, 1].flatMap((dx) => [-1, 0, 1].map((dy) => apart(picture.at(x + dx, y + dy), MATCHED)));
    assert.ok(Math.min(...near) < 40, `no line at ${middle(projected_px)}: ${picture.at(x, y)}`);
  }
  const blue = (data) => { let count = 0; for (let k = 0; k < data.length; k += 4) count += apart([data[k], data[k + 1], data[k + 2]], MATCHED) < 12; return count; };
  const shown = blue(picture.data);
  await only(page);
  await until(async () => blue((await screen(page)).data) < shown / 10, 'the lines are gone');
});

test('the tiles show the pixels of the file at their places', async () => {
  const page = await open();
  await only(page);
  await page.getByRole('button', { name: '1:1' }).click();
  await page.locator('.viewer-zoom', { hasText: /^100%$/ }).waitFor();
  await page.waitForLoadState('networkidle');
  const { scale, toScreen } = await viewerScale(page);
  assert.ok(Math.abs(scale - 1) < 3e-3, `scale ${scale}`);
  // means of squares of 24 px, each within one tile: where the image has them and where the screen shows them
  const places = [[700, 470], [800, 400], [640, 620], [900, 600], [760, 300], [1000, 450]];
  const tiles = await page.evaluate(async ({ image, squares }) => {
    const means = [];
    for (const [x, y] of squares) {
      const [column, row] = [Math.floor(x / 512), Math.floor(y / 512)];
      const bitmap = await createImageBitmap(await (await fetch(`/api/v1/images/${image}/tiles/0/${column}/${row}`)).blob());
      const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext('2d');
      context.drawImage(bitmap, 0, 0);
      const { data } = context.getImageData(x - column * 512, y - row * 512, 24, 24);
      means.push(data.reduce((sum, value, k) => sum + (k % 4 === 0 ? value : 0), 0) / 576);
    }
    return means;
  }, { image: served.image, squares: places });
  const picture = await screen(page);
  const seen = places.map((place) => {
    const [x, y] = toScreen(place);
    let sum = 0;
    for (let dx = 0; dx < 24; dx += 1) for (let dy = 0; dy < 24; dy += 1) [sum] = [sum + picture.at(x + dx, y + dy)[0]];
    return sum / 576;
  });
  assert.ok(Math.max(...tiles) - Math.min(...tiles) > 10, `squares that can be told apart: ${tiles}`);
  seen.forEach((value, k) => assert.ok(Math.abs(value - tiles[k]) < 4, `at ${places[k]}: ${value} instead of ${tiles[k]}`));
});

// where the end of a residual vector is to be drawn: from the foot on the projected edge, so many times as long
function tip({ projected_px: [from, to], matched_px: [segment] }, magnification) {
  const along = [0, 1].map((k) => (to[k] - from[k]) / length([from, to]));
  const at = middle(segment);
  const way = (at[0] - from[0]) * along[0] + (at[1] - from[1]) * along[1];
  return from.map((value, k) => { const foot = value + way * along[k]; return foot + magnification * (at[k] - foot); });
}

test('residuals are as many times as long as the slider says, which is remembered', async () => {
  const page = await open();
  await only(page, 'residuals');
  const slider = page.getByLabel(/Residuals magnified/);
  const matchedEdges = drawing.edges.filter((edge) => edge.matched_px.length && length(edge.projected_px) > 5);
  for (const [step, magnification] of [['74', 50], ['100', 200]]) {
    await slider.fill(step);
    await page.getByText(`×${magnification}`, { exact: true }).waitFor();
    const { toScreen } = await viewerScale(page);
    const picture = await screen(page);
    const around = ([x, y]) => [-1, 0, 1].flatMap((dx) => [-1, 0, 1].map((dy) => picture.at(x + dx, y + dy)));
    const isWhite = (end) => around(toScreen(end)).some((place) => place.every((value) => value > 225));
    const share = (times) => {
      const ends = matchedEdges.map((edge) => tip(edge, times)).filter((end) => inside(end) && beside(end));
      assert.ok(ends.length >= 5, `${ends.length} vectors to look at`);
      return ends.filter(isWhite).length / ends.length;
    };
    // some lie under the rim of another one
    assert.ok(share(magnification) > 0.75, `×${magnification}: ${share(magnification)} of the ends are there`);
    // nor do they go any farther
    assert.ok(share(4 * magnification) < 0.5, `×${4 * magnification}: ${share(4 * magnification)} while it is ×${magnification}`);
  }
  await page.reload();
  await page.getByText('×200', { exact: true }).waitFor();
  const shown = await page.locator('.viewer-layer input').evaluateAll((boxes) => boxes.filter((box) => box.checked).map((box) => box.name));
  assert.deepEqual(shown, ['residuals']);
});

test('a row brings its point into view, a click on the point brings its row', async () => {
  const page = await open({ query: '?tab=points' });
  const [first, second] = matched();
  await page.getByRole('button', { name: first.name, exact: true }).click();
  await page.mouse.move(2, 2);
  const centre = () => Promise.all(['x', 'y'].map((name) => page.locator(`.viewer-${name}`).getAttribute(`data-${name}`).then(Number)));
  await until(async () => apart(await centre(), first.located_px) < 120, `the viewer is at ${first.name}`);
  await page.getByRole('button', { name: 'All', exact: true }).click();
  await only(page, 'references');
  await until(async () => (await viewerScale(page)).scale < 0.9, 'all of it is shown');
  const { toScreen } = await viewerScale(page);
  const target = matched().slice(1).find((point) => beside(point.located_px)) ?? second;
  await page.mouse.move(...toScreen(target.located_px));
  await page.locator('tr.hovered').filter({ hasText: target.name }).waitFor();
  await page.mouse.click(...toScreen(target.located_px));
  await page.locator('tr.selected').filter({ hasText: target.name }).waitFor();
  assert.equal(await page.locator('tr.selected').count(), 1);
  // its part of the image and what the search has seen
  await page.locator('.window-heat').waitFor({ timeout: 120_000 });
  const seen = await served.api('GET', `/orientations/${served.orientation}/control-points/${encodeURIComponent(target.name)}/window`);
  const peak = seen.accumulator.peaks[0];
  const row = await page.locator('.peaks tbody tr').first().locator('td').allTextContents();
  assert.ok(Math.abs(Number(row[2]) - peak.log_likelihood) < 0.006, `${row} is not ${peak.log_likelihood}`);
});

test('rows are sorted by their figures', async () => {
  const page = await open({ query: '?tab=points' });
  await page.getByRole('button', { name: /^Res\./ }).click();
  const values = (await page.locator('.points tbody tr td.figure:nth-of-type(2)').allTextContents()).filter((text) => text !== '–').map(Number);
  assert.deepEqual(values, [...values].sort((a, b) => b - a));
  assert.equal(await page.locator('th[aria-sort=descending]').count(), 1);
});

const sigma = (result) => Math.max(...result.ground_precision.map((point) => point.sigma_planimetric_m));
const shownSigma = (page) => page.locator('.change').filter({ hasText: 'Largest ground sigma' }).locator('strong').innerText().then((text) => Number(text.replace(' m', '')));

async function correcting(page) {
  await page.getByRole('tab', { name: 'Verdict' }).click();
  await page.getByRole('button', { name: 'Correct by hand' }).click();
  await page.locator('.changes').waitFor({ timeout: 120_000 });
  await page.getByRole('tab', { name: 'Control points' }).click();
}

test('a point that is switched off changes the figures to those of the API, and undoing brings them back', async () => {
  const page = await open();
  await correcting(page);
  const before = await shownSigma(page);
  const off = matched().slice(0, 2).map((point) => point.name);
  const expected = await served.api('POST', `/orientations/${served.orientation}/trials`, { off });
  for (const name of off) await page.getByLabel(`${name} takes part`).uncheck();
  await page.getByText('2 off, 0 moved').waitFor();
  await until(async () => Math.abs(await shownSigma(page) - sigma(expected.result)) < 6e-4, 'the sigma of the API is shown');
  assert.notEqual(await shownSigma(page), before);
  await page.locator('.viewer-map').focus();
  await page.keyboard.press('Control+z');
  await page.getByText('1 off, 0 moved').waitFor();
  await page.keyboard.press('Control+z');
  await until(async () => await shownSigma(page) === before, 'all is as before');
  await page.keyboard.press('Control+y');
  await page.getByText('1 off, 0 moved').waitFor();
  assert.equal(await page.getByLabel(`${off[0]} takes part`).isChecked(), false);
  assert.equal(await page.getByLabel(`${off[1]} takes part`).isChecked(), true);
  await page.getByRole('button', { name: 'Reset' }).click();
  await until(async () => await shownSigma(page) === before, 'all is as before');
  await axe(page);
});

test('a point is dragged to another place, and the correction is kept with who and why', async () => {
  const page = await open();
  await correcting(page);
  await page.getByRole('button', { name: 'All', exact: true }).click();
  const { toScreen, scale } = await viewerScale(page);
  const point = matched().find((one) => beside(one.located_px) && inside([one.located_px[0] + 60, one.located_px[1] - 60]));
  const [x, y] = toScreen(point.located_px);
  const sent = page.waitForRequest((request) => request.url().endsWith('/trials') && request.postDataJSON().moved.length === 1);
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 10, y - 8, { steps: 3 });
  await page.mouse.move(x + 20, y - 15, { steps: 3 });
  await page.mouse.up();
  const [moved] = (await sent).postDataJSON().moved;
  assert.equal(moved.name, point.name);
  const expected = [point.located_px[0] + 20 / scale, point.located_px[1] - 15 / scale];
  assert.ok(apart(moved.at_px, expected) < 2 / scale, `${moved.at_px} is not ${expected}`);
  await page.getByText('0 off, 1 moved').waitFor();
  const away = await page.locator('.change').filter({ hasText: 'Centre moved by' }).locator('strong').innerText();
  assert.ok(Number(away.replace(' m', '')) > 0, away);

  await page.getByRole('button', { name: 'Save', exact: true }).click();
  const dialog = page.getByRole('dialog');
  await dialog.getByText('loopback').waitFor();
  await dialog.getByLabel('Why').fill(`the chimney ${XSS}`);
  await dialog.getByRole('button', { name: 'Save' }).click();
  await page.locator('.correcting').waitFor({ state: 'detached' });
  await page.getByRole('tab', { name: 'Verdict' }).click();
  await page.locator('.reviews .why').filter({ hasText: `the chimney ${XSS}` }).waitFor();
  const [kept] = (await served.api('GET', `/orientations/${served.orientation}/reviews`)).items;
  assert.equal(kept.why, `the chimney ${XSS}`);
  assert.deepEqual(kept.correction.moved, [moved]);
  assert.equal(await page.evaluate(() => window.hacked), undefined);
  // it can be looked at again
  await page.getByRole('button', { name: 'Look at the correction' }).click();
  await page.getByText('0 off, 1 moved').waitFor({ timeout: 60_000 });
  await page.getByRole('button', { name: 'Back to what was found' }).click();
  await page.locator('.correcting').waitFor({ state: 'detached' });
});

test('it is rejected by key with a reason, and accepted by button', async () => {
  const page = await open();
  await page.locator('.decide').waitFor();
  await page.keyboard.press('r');
  await page.getByRole('dialog').getByRole('textbox').fill('lies in the lake');
  await page.getByRole('dialog').getByRole('button', { name: 'Reject' }).click();
  await page.locator('.result-head .decision.rejected').waitFor();
  await page.getByRole('button', { name: /^Accept/ }).click();
  await page.locator('.result-head .decision.accepted').waitFor();
  const { items } = await served.api('GET', `/orientations/${served.orientation}/reviews`);
  assert.deepEqual(items.slice(0, 2).map(({ decision, why }) => [decision, why]), [['accepted', ''], ['rejected', 'lies in the lake']]);
});

test('j and k go through the list it came from', async () => {
  const { id } = await oriented(served, { bytes: variant(scene().photograph, 'second'), name: 'second.png' });
  const page = await open({ query: '?status=succeeded' });
  await page.getByRole('button', { name: 'Previous' }).and(page.locator(':enabled')).waitFor();
  await page.keyboard.press('k');
  await page.waitForURL(`**/orientations/${id}?status=succeeded`);
  await page.getByRole('heading', { name: 'second.png' }).waitFor();
  await page.getByRole('button', { name: 'Next' }).and(page.locator(':enabled')).waitFor();
  await page.keyboard.press('j');
  await page.waitForURL(`**/orientations/${served.orientation}?status=succeeded`);
});

test('check points are told with what they are off, in a table of their own', async () => {
  const page = await open({ query: '?tab=points' });
  assert.equal(await page.locator('.checks').count(), 0, 'without a check point there is no table');
  const { control, frame } = scene();
  const checking = structuredClone(control);
  const { name } = matched()[0];
  checking.features.find((feature) => feature.properties.name === name).properties.use = 'check';
  const replace = (all) => served.api('POST', `/control-points?crs=${encodeURIComponent(frame)}&mode=replace`, JSON.stringify(all), { 'content-type': 'application/geo+json' });
  await replace(checking);
  const { id, result } = await oriented(served, { bytes: variant(scene().photograph, 'checked'), name: 'checked.png' });
  const [point] = result.check_points;
  assert.equal(point.name, name);
  const checked = await open({ id, query: '?tab=points' });
  const cells = await checked.locator('.checks tbody tr').locator('th, td').allInnerTexts();
  assert.deepEqual(cells, [name, point.residual_m.toFixed(3), point.residual_px.toFixed(2), point.residual_m <= result.tolerance_m ? 'within' : '▲ over it']);
  await axe(checked);
  await replace(control);
});

test('it is followed while it runs, and the result comes without loading the page again; names are text', async () => {
  const { control, frame } = scene();
  const named = structuredClone(control);
  const { name } = matched()[0];
  named.features.find((feature) => feature.properties.name === name).properties.name = XSS;
  await served.api('POST', `/control-points?crs=${encodeURIComponent(frame)}&mode=replace`, JSON.stringify(named), { 'content-type': 'application/geo+json' });
  const form = new FormData();
  form.append('file', new Blob([variant(scene().photograph, 'third')], { type: 'image/png' }), `${XSS}.png`);
  const image = await (await fetch(`${served.url}/api/v1/images`, { method: 'POST', body: form })).json();
  const wanted = { image: image.id, camera: scene().camera.name, approximation: scene().approximation };
  // others go first, so that there is something to follow when the page is there
  for (let count = 0; count < OTHERS; count += 1) await served.api('POST', '/orientations', { ...wanted, priority: 'high' });
  const { id } = await served.api('POST', '/orientations', { ...wanted, priority: 'low' });
  const page = await browser.page(`${served.url}/orientations/${id}`);
  await page.evaluate(() => { window.here = true; });
  await page.locator('.underway progress').waitFor();
  await page.locator('.verdict-head').waitFor({ timeout: 120_000 });
  assert.equal(await page.evaluate(() => window.here), true);
  await page.getByRole('heading', { name: `${XSS}.png` }).waitFor();
  await page.getByRole('tab', { name: 'Control points' }).click();
  await page.getByRole('button', { name: XSS, exact: true }).click();
  await page.getByRole('heading', { name: XSS, exact: true }).waitFor();
  for (const tab of ['Orientation', 'Ground', 'Raw data']) await page.getByRole('tab', { name: tab }).click();
  assert.equal(await page.evaluate(() => window.hacked), undefined);
  assert.equal(await page.locator('img[src=x]').count(), 0);
});

test('nothing that axe knows is wrong in any part, in both themes and in German', async () => {
  for (const options of [{}, { theme: 'dark', language: 'de', viewport: { width: 1024, height: 768 } }]) {
    const page = await open(options);
    for (const tab of ['verdict', 'points', 'orientation', 'ground', 'raw']) {
      await page.locator(`#tab-${tab}`).click();
      await page.locator(`.panel-${tab}`).waitFor();
      await axe(page);
      assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `${tab} is not wider than the page`);
    }
  }
});
