// From files to verdicts, as a user uploads them.

import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, describe, test } from 'node:test';
import { withPosition } from './exif.js';
import { axe, launch, scene, service, until, variant } from './support.js';

let running;
let browser;
const folder = mkdtempSync(join(tmpdir(), 'gable-e2e-files-'));
before(async () => { [running, browser] = [await service(), await launch()]; });
after(async () => { rmSync(folder, { recursive: true }); await running?.stop(); await browser?.close(); });

// a file on disk, so that its name, size and time are the same each time that it is chosen
function file(name, bytes) {
  const path = join(folder, name);
  writeFileSync(path, bytes);
  return path;
}
const photograph = (name) => file(name, variant(scene().photograph, name));
const choose = (page, ...paths) => page.locator('input[type=file]').setInputFiles(paths);
const row = (page, name) => page.locator('.uploads tbody tr').filter({ hasText: name });
const start = (page) => page.getByRole('button', { name: /^Orient( all)?$/ });

async function opened(address = '/upload', options = {}) {
  const page = await browser.page(`${running.url}${address}`, options);
  await page.getByRole('heading', { name: /Upload|Hochladen/, level: 1 }).waitFor();
  return page;
}

// what the approximation of the scene is, typed
async function typeSettings(page) {
  const { approximation, frame } = scene();
  await page.getByLabel('CRS of typed or listed positions').fill(frame);
  await page.getByText('More', { exact: true }).click();
  await page.getByLabel('Sigma of positions').fill(approximation.sigma_position_m.join('; '));
  await page.getByLabel('Kappa, °', { exact: true }).fill(String(approximation.kappa_deg));
  await page.getByLabel('Sigma of kappa').fill('5');
  await page.keyboard.press('Tab');
}

async function typePosition(page, name) {
  await page.getByLabel(`Position of ${name}`).fill(scene().approximation.position.coordinates.map((one) => one.toFixed(2)).join('; '));
}

describe('one image', () => {
  test('without a position: it is typed, and the way leads straight to the result', async () => {
    const page = await opened();
    await choose(page, photograph('single.png'));
    await row(page, 'single.png').getByText('Uploaded').waitFor();
    await row(page, 'single.png').getByText('The image has no position').waitFor();
    // recognised by the size of the image
    await row(page, 'single.png').getByText(scene().camera.name).waitFor();
    assert.ok(await start(page).isDisabled());
    await typeSettings(page);
    await page.getByLabel('Position of single.png').fill('7,5 and so on');
    await row(page, 'single.png').getByText('Three numbers').waitFor();
    await typePosition(page, 'single.png');
    await axe(page);
    await start(page).click();
    await page.waitForURL(/\/orientations\/[0-9a-f-]{36}$/, { timeout: 120_000 });
    const answer = await running.api('GET', `/orientations/${page.url().split('/').pop()}`);
    assert.equal(answer.status, 'succeeded');
    assert.equal(answer.verdict, 'green');
  });

  test('with a position in its EXIF, which is shown and used', async () => {
    const page = await opened();
    const { photograph: png } = scene();
    const jpeg = await page.evaluate(async (bytes) => {
      const picture = await createImageBitmap(new Blob([new Uint8Array(bytes)]));
      const canvas = new OffscreenCanvas(picture.width, picture.height);
      canvas.getContext('2d').drawImage(picture, 0, 0);
      return [...new Uint8Array(await (await canvas.convertToBlob({ type: 'image/jpeg', quality: 0.9 })).arrayBuffer())];
    }, [...png]);
    let request;
    await page.route(/\/api\/v1\/orientations$/, (route) => { request = route.request(); return route.fulfill({ status: 422, json: { title: 'Not now', detail: 'enough seen' } }); });
    await choose(page, file('drone.jpg', withPosition(Buffer.from(jpeg), 7.1001, -50.7002, 281)));
    const place = row(page, 'drone.jpg').getByRole('cell').nth(2);
    await place.getByText('from the image').waitFor();
    assert.match(await place.innerText(), /7\.10010° -50\.70020°\s+281 m/);
    await start(page).click();
    await row(page, 'drone.jpg').getByRole('alert').waitFor();
    assert.equal(await row(page, 'drone.jpg').getByRole('alert').innerText(), 'drone.jpg: enough seen');
    assert.match(request.headers()['idempotency-key'], /^[0-9a-f]{32}$/);
    const body = request.postDataJSON();
    assert.equal(body.approximation.position, undefined);
    assert.equal(body.tolerance_gsd, 10);
    // or typed, all the same
    await row(page, 'drone.jpg').getByRole('button', { name: /change/ }).click();
    await page.getByLabel('Position of drone.jpg').fill('7.2, 50.8, 300');
    await start(page).click();
    await until(() => request.postDataJSON().approximation.position, 'the typed position was sent');
    assert.deepEqual(request.postDataJSON().approximation.position, { crs: 'EPSG:4979', coordinates: [7.2, 50.8, 300] });
    assert.notEqual(request.headers()['idempotency-key'], undefined);
  });
});

test('a flight with a list makes a block; what is not in the list is said, what is there gets its light', async () => {
  const page = await opened();
  const { approximation, frame } = scene();
  const { position: { coordinates }, omega_deg: omega, phi_deg: phi, kappa_deg: kappa } = approximation;
  const line = (name) => [name, ...coordinates, omega, phi, kappa].join(',');
  const list = ['name,x,y,z,omega,phi,kappa,weather', ...['one.png', 'two.png', 'absent.png'].map((name) => `${line(name)},fine`)].join('\n');
  await choose(page, photograph('one.png'), photograph('two.png'), photograph('stranger.png'), file('flight.csv', list));
  await page.getByText('List flight.csv').waitFor();
  await page.getByLabel('Name of the block').fill('<b>flight</b> 7');
  await page.getByLabel('CRS of typed or listed positions').fill(frame);
  await page.keyboard.press('Tab');
  await start(page).click();
  await row(page, 'stranger.png').getByText('Not in the list').waitFor();
  await page.getByText('not here yet: 1').waitFor();
  await page.getByText('Columns that mean nothing here: weather').waitFor();
  for (const name of ['one.png', 'two.png']) await row(page, name).getByText('Green').waitFor({ timeout: 120_000 });
  await axe(page);
  const { items: [block] } = await running.api('GET', '/blocks');
  assert.equal(block.name, '<b>flight</b> 7');
  const { items } = await running.api('GET', `/blocks/${block.id}/images`);
  assert.deepEqual(items.map(({ name, verdict }) => [name, verdict ?? null]).sort(), [['absent.png', null], ['one.png', 'green'], ['two.png', 'green']]);
  const link = await row(page, 'one.png').getByRole('link').getAttribute('href');
  assert.equal(link, `/orientations/${items.find(({ name }) => name === 'one.png').orientation}`);
  // many: it stays here
  assert.equal(new URL(page.url()).pathname, '/upload');
});

test('a list with a fault names its line', async () => {
  const page = await opened();
  await choose(page, photograph('faulty.png'), file('faulty.csv', 'name,x,y,z\nfaulty.png,7.1,none,300\n'));
  await start(page).click();
  await page.locator('.list-line').getByText(/line 2/).waitFor();
  await axe(page);
  await page.getByRole('button', { name: 'Leave it out' }).click();
  await row(page, 'faulty.png').getByText('Uploaded').waitFor();
});

describe('sending', () => {
  test('goes on where it was after the page was closed', async () => {
    const path = photograph('resumed.png');
    const first = await opened();
    let halted = false;
    // the connection breaks in the middle
    await first.route(/\/uploads\/[0-9a-f-]{36}$/, (route) => {
      if (route.request().method() !== 'PATCH') return route.continue();
      halted = true;
      return route.abort('connectionreset');
    });
    await choose(first, path);
    await until(() => halted, 'the upload has begun');
    const context = first.context();
    await first.close();
    const second = await context.newPage();
    const begun = [];
    second.on('request', (request) => { if (/\/uploads(\/|$)/.test(request.url())) begun.push(request.method()); });
    await second.goto(`${running.url}/upload`);
    await choose(second, path);
    await row(second, 'resumed.png').getByText('Uploaded').waitFor();
    assert.ok(!begun.includes('POST'), `it began anew: ${begun}`);
    assert.equal(begun[0], 'HEAD');
    await second.close();
  });

  test('pauses, goes on, and is given up', async () => {
    const page = await opened();
    const held = [];
    await page.route(/\/uploads\/[0-9a-f-]{36}$/, (route) => (route.request().method() === 'PATCH' ? held.push(route) : route.continue()));
    const given = [];
    page.on('request', (request) => given.push(`${request.method()} ${new URL(request.url()).pathname}`));
    await choose(page, photograph('halting.png'), photograph('given up.png'));
    await until(() => held.length === 2, 'both are being sent');
    await page.getByRole('button', { name: 'Pause halting.png' }).click();
    await row(page, 'halting.png').getByText('Paused').waitFor();
    await axe(page);
    await page.getByRole('button', { name: 'Remove given up.png' }).click();
    await row(page, 'given up.png').waitFor({ state: 'detached' });
    await until(() => given.some((one) => one.startsWith('DELETE /api/v1/uploads/')), 'the service was told');
    await page.unroute(/\/uploads\/[0-9a-f-]{36}$/);
    await page.getByRole('button', { name: 'Go on with halting.png' }).click();
    await row(page, 'halting.png').getByText('Uploaded').waitFor();
  });

  test('what is no image fails, says so by name, and can be removed', async () => {
    const page = await opened();
    await choose(page, file('letter.png', 'Dear Sir or Madam'));
    const fault = row(page, 'letter.png').locator('.fault');
    await fault.waitFor();
    assert.match(await fault.innerText(), /^letter\.png: .+/);
    await axe(page);
    await page.getByRole('button', { name: 'Remove letter.png' }).click();
    await row(page, 'letter.png').waitFor({ state: 'detached' });
  });

  test('begins where files are dropped, and nowhere else', async () => {
    const page = await opened();
    const drop = async (place, name) => {
      const data = await page.evaluateHandle(([bytes, called]) => {
        const transfer = new DataTransfer();
        transfer.items.add(new File([new Uint8Array(bytes)], called, { type: 'image/png' }));
        return transfer;
      }, [[...variant(scene().photograph, name)], name]);
      await page.locator(place).dispatchEvent('drop', { dataTransfer: data });
    };
    await drop('.upload h1', 'beside.png');
    await drop('.drop-zone', 'dropped.png');
    await row(page, 'dropped.png').getByText('Uploaded').waitFor();
    assert.equal(await row(page, 'beside.png').count(), 0);
    assert.equal(new URL(page.url()).pathname, '/upload');
  });

  test('goes on while other pages are looked at', async () => {
    const page = await opened();
    await choose(page, photograph('stays.png'));
    await page.getByRole('link', { name: 'Help' }).click();
    await page.getByRole('heading', { name: 'Help' }).waitFor();
    await page.getByRole('link', { name: 'Upload' }).click();
    await row(page, 'stays.png').getByText('Uploaded').waitFor();
  });
});

describe('settings', () => {
  test('a fault is shown at its field and at the image', async () => {
    const page = await opened();
    await choose(page, photograph('strict.png'));
    await row(page, 'strict.png').getByText('Uploaded').waitFor();
    await typeSettings(page);
    await typePosition(page, 'strict.png');
    await page.getByLabel('Tolerance').fill('-1');
    await page.keyboard.press('Tab');
    await start(page).click();
    await row(page, 'strict.png').getByText(/tolerance_gsd/).waitFor();
    assert.equal(await page.getByLabel('Tolerance').getAttribute('aria-invalid'), 'true');
    await axe(page);
    await page.getByLabel('Tolerance').fill('12');
    await page.keyboard.press('Tab');
    await start(page).click();
    await page.waitForURL(/\/orientations\//, { timeout: 120_000 });
  });

  test('a new camera is asked for where none fits, and is recognised then', async () => {
    const bare = await service({ empty: true });
    const page = await browser.page(`${bare.url}/upload`);
    await choose(page, photograph('unknown.png'));
    await row(page, 'unknown.png').getByText('No camera for 1500 × 1125').waitFor();
    await page.getByRole('button', { name: 'New camera' }).click();
    const dialog = page.getByRole('dialog');
    assert.equal(await dialog.getByLabel('Width, px').inputValue(), '1500');
    await axe(page);
    const evil = '<img src=x onerror="window.hit=1">';
    await dialog.getByLabel('Name').fill(evil);
    await dialog.getByLabel('Principal distance, px').fill('-5');
    await dialog.getByRole('button', { name: 'Save' }).click();
    await dialog.getByRole('alert').getByText(/principal_distance_px/).waitFor();
    assert.equal(await dialog.getByLabel('Principal distance, px').getAttribute('aria-invalid'), 'true');
    await dialog.getByLabel('Principal distance, px').fill('1300');
    await dialog.getByRole('button', { name: 'Save' }).click();
    await dialog.waitFor({ state: 'detached' });
    await row(page, 'unknown.png').getByText(evil).waitFor();
    assert.equal(await page.evaluate(() => window.hit), undefined);
    const { items: [camera] } = await bare.api('GET', '/cameras');
    assert.deepEqual([camera.image_size_px, camera.principal_point_px], [[1500, 1125], [750, 562.5]]);
    await page.close();
    await bare.stop();
  });
});

for (const theme of ['light', 'dark']) {
  test(`accessible: ${theme}`, async () => {
    const page = await opened('/upload', { theme, language: theme === 'dark' ? 'de' : 'en', viewport: { width: 1024, height: 768 } });
    await axe(page);
    await choose(page, photograph(`axe-${theme}.png`));
    await page.locator('.uploads [aria-invalid=true]').waitFor();
    await page.locator('summary').click();
    await axe(page);
  });
}
