// What all tests of the pages need: services over a simulated scene, a browser that tolerates no fault, and axe.

import assert from 'node:assert/strict';
import { execFileSync, spawn } from 'node:child_process';
import { cpSync, existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { crc32 } from './crc32.js';
import { chromium } from 'playwright-core';

const GABLE = process.env.GABLE;
const SEED = 8;
// small enough for a binary without optimization, with enough control that its orientation is green
const SETTINGS = {
  camera: { image_size_px: [1500, 1125], principal_distance_px: 1300, principal_point_px: [753, 559] },
  photograph: { rays_per_pixel: 1, noise_grey: 1 },
  control: { share: 0.7, share_outdated: 0 },
};
const FLAGS = ['--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run', '--disable-background-networking',
  '--disable-component-update', '--disable-sync'];
const WCAG = ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa'];

const shared = process.env.E2E_FOLDER ?? mkdtempSync(join(tmpdir(), 'gable-e2e-'));
if (!process.env.E2E_FOLDER) process.on('exit', () => rmSync(shared, { recursive: true, force: true }));

/** The simulated scene: `photograph` (bytes of its PNG), `camera`, `approximation`, `frame` (CRS), `control`, `truth`. */
export function scene() {
  const folder = join(shared, 'scenes', `seed-${SEED}`);
  if (!existsSync(join(folder, 'truth.json'))) {
    const settings = join(shared, 'settings.json');
    writeFileSync(settings, JSON.stringify(SETTINGS));
    execFileSync(GABLE, ['simulate', '--seed', String(SEED), '--settings', settings, '--out', join(shared, 'scenes')]);
  }
  const json = (name) => JSON.parse(readFileSync(join(folder, name), 'utf8'));
  const truth = json('truth.json');
  return {
    folder, truth, frame: truth.frame,
    photograph: readFileSync(join(folder, 'photograph.png')),
    camera: json('camera.json'), approximation: json('approximation.json'), control: json('control_points.geojson'),
  };
}

/** Another file with the same picture: a comment is put before the end of a PNG. */
export function variant(png, comment) {
  const body = Buffer.concat([Buffer.from('tEXt'), Buffer.from(`Comment\0${comment}`, 'latin1')]);
  const length = Buffer.alloc(4);
  length.writeUInt32BE(body.length - 4);
  const check = Buffer.alloc(4);
  check.writeUInt32BE(crc32(body));
  const end = png.length - 12;
  return Buffer.concat([png.subarray(0, end), length, body, check, png.subarray(end)]);
}

async function freePort() {
  const server = createServer();
  await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve));
  const { port } = server.address();
  await new Promise((resolve) => server.close(resolve));
  return port;
}

/** Waits until `condition` gives something true, and gives that. */
export async function until(condition, what, seconds = 60) {
  const end = Date.now() + seconds * 1000;
  for (;;) {
    const answer = await condition();
    if (answer) return answer;
    assert.ok(Date.now() < end, `after ${seconds} s still not: ${what}`);
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
}

async function started(data, environment) {
  const port = await freePort();
  const url = `http://127.0.0.1:${port}`;
  const child = spawn(GABLE, ['serve', '--listen', `127.0.0.1:${port}`, '--data', data], {
    env: { ...process.env, GABLE_RATE_PER_S: '0', ...environment }, stdio: ['ignore', 'ignore', 'pipe'],
  });
  let log = '';
  child.stderr.on('data', (text) => { log += text; });
  const ended = new Promise((resolve) => child.on('exit', resolve));
  const api = async (method, path, body, headers = {}) => {
    const plain = body === undefined || body instanceof Uint8Array || typeof body === 'string';
    const response = await fetch(`${url}/api/v1${path}`, {
      method, body: plain ? body : JSON.stringify(body),
      headers: { ...(plain ? {} : { 'content-type': 'application/json' }), ...headers },
    });
    const text = await response.text();
    const answer = text && (response.headers.get('content-type') ?? '').includes('json') ? JSON.parse(text) : text;
    assert.ok(response.ok, `${method} ${path}: ${response.status} ${text.slice(0, 500)}`);
    return answer;
  };
  const up = () => fetch(`${url}/health/ready`).then((answer) => answer.ok, () => false);
  await until(async () => {
    assert.equal(child.exitCode, null, log);
    return up();
  }, 'the service is ready');
  const stop = async () => { child.kill('SIGTERM'); await ended; };
  return { url, data, api, stop, log: () => log };
}

/** Whether the service has a route, as its contract says; tests of pages that are ahead of it skip or fake it. */
export async function knows(service, method, path) {
  const contract = await service.api('GET', '/openapi.json');
  return method.toLowerCase() in (contract.paths[`/api/v1${path}`] ?? {});
}

/** Orients the picture of `scene()` under another name; `request` changes what is asked for. Gives its orientation. */
export async function oriented(service, { bytes = scene().photograph, name = 'photograph.png', request = {} } = {}) {
  const { camera, approximation } = scene();
  const form = new FormData();
  form.append('file', new Blob([bytes], { type: 'image/png' }), name);
  const image = await (await fetch(`${service.url}/api/v1/images`, { method: 'POST', body: form })).json();
  const body = { image: image.id, camera: camera.name, approximation, ...request };
  return service.api('POST', '/orientations', body, { prefer: 'wait=120' });
}

// a data folder with the scene's camera, its control and one orientation, made once for all tests
async function template() {
  const folder = join(shared, 'data');
  const done = join(shared, 'done.json');
  if (existsSync(done)) return { folder, ...JSON.parse(readFileSync(done, 'utf8')) };
  const { camera, control, frame } = scene();
  const service = await started(folder, {});
  await service.api('POST', '/cameras', camera);
  await service.api('POST', `/control-points?crs=${encodeURIComponent(frame)}`, JSON.stringify(control), { 'content-type': 'application/geo+json' });
  const orientation = await oriented(service);
  assert.equal(orientation.status, 'succeeded', JSON.stringify(orientation.error));
  await service.stop();
  const facts = { orientation: orientation.id, image: orientation.image };
  writeFileSync(done, JSON.stringify(facts));
  return { folder, ...facts };
}

/**
 * A service with the scene's camera, its control and one green orientation (`orientation`, `image`: their ids), or an
 * `empty` one. `accounts` is a list of `{name, role, password}`, `settings` is of `GABLE_…`. Stop it by `stop()`.
 */
export async function service({ empty = false, accounts = [], settings = {}, prepare } = {}) {
  const folder = mkdtempSync(join(tmpdir(), 'gable-e2e-service-'));
  const data = join(folder, 'data');
  const { folder: from, ...facts } = empty ? {} : await template();
  if (from) cpSync(from, data, { recursive: true });
  else mkdirSync(data);
  for (const { name, role, password } of accounts) {
    execFileSync(GABLE, ['account', 'new', name, '--role', role, '--data', data], { input: `${password}\n` });
  }
  await prepare?.(join(data, 'gable.db'));
  const running = await started(data, settings);
  const stop = async () => { await running.stop(); rmSync(folder, { recursive: true, force: true }); };
  return { ...running, ...facts, stop };
}

// a browser says nothing of these by itself
function listenForViolations() {
  document.addEventListener('securitypolicyviolation', (event) => {
    console.error(`Content Security Policy: ${event.violatedDirective} ${event.blockedURI} ${event.sourceFile}:${event.lineNumber}`);
  });
}

// an answer that is not 2xx may be what a test is about; anything else that a browser complains of is a fault
function isFault(message) {
  const refused = message.text().startsWith('Failed to load resource') && message.location().url.includes('/api/v1/');
  return message.type() === 'error' && !refused;
}

/**
 * A browser. `page(url, {theme, language, viewport})` opens an address in a profile of its own; its `faults` are all errors
 * of scripts, of the console and of the content security policy. `close()` fails if there was any on any page.
 */
export async function launch() {
  const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium', args: FLAGS });
  const faults = [];
  const page = async (url, { theme = 'light', language = 'en', viewport = { width: 1440, height: 900 }, prepare } = {}) => {
    const context = await browser.newContext({ viewport, locale: language, colorScheme: theme, reducedMotion: 'reduce' });
    const opened = await context.newPage();
    opened.setDefaultTimeout(20_000);
    await opened.addInitScript(listenForViolations);
    opened.on('console', (message) => isFault(message) && faults.push(`${opened.url()}: ${message.text()}`));
    opened.on('pageerror', (error) => faults.push(`${opened.url()}: ${error.stack}`));
    await prepare?.(opened);
    await opened.goto(url);
    return opened;
  };
  const close = async () => {
    await browser.close();
    assert.deepEqual(faults, []);
  };
  return { browser, page, faults, close };
}

/** Fails with what axe finds against WCAG 2.2 A and AA on `page` as it is now. */
export async function axe(page) {
  // evaluated by the debugger, as the policy of the page forbids a script that is put in
  const source = readFileSync(new URL('./node_modules/axe-core/axe.min.js', import.meta.url), 'utf8');
  await page.evaluate(`if (!window.axe) { ${source} }`);
  const found = await page.evaluate((tags) => window.axe.run({ runOnly: { type: 'tag', values: tags } }), WCAG);
  const told = found.violations.flatMap((rule) => rule.nodes.map((node) => `${rule.id}: ${node.target.join(' ')}: ${node.failureSummary}`));
  assert.deepEqual(told, [], `axe at ${page.url()}`);
}
