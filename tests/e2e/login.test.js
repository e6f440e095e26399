// Logging in and out.

import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { axe, launch, service } from './support.js';

const ANNA = { name: 'anna', role: 'operator', password: 'correct horse battery' };
let running;
let browser;
before(async () => { [running, browser] = [await service({ accounts: [ANNA] }), await launch()]; });
after(async () => { await running?.stop(); await browser?.close(); });

async function logIn(page, { name, password } = ANNA) {
  await page.getByLabel('Name').fill(name);
  await page.getByLabel('Password').fill(password);
  await page.getByRole('button', { name: 'Log in' }).click();
}

test('who is not logged in is led to the login, and then to where they wanted to go', async () => {
  const page = await browser.page(`${running.url}/?verdict=green`);
  await page.waitForURL('**/login?then=*');
  await logIn(page);
  await page.waitForURL(`${running.url}/?verdict=green`);
  await page.locator(`#row-${running.orientation}`).waitFor();
  await page.getByText('anna').waitFor();
  await page.getByRole('button', { name: 'Log out' }).click();
  await page.waitForURL('**/login');
  await page.goto(`${running.url}/help`);
  await page.waitForURL('**/login?then=%2Fhelp');
});

test('a wrong password is told, and may be typed again', async () => {
  const page = await browser.page(`${running.url}/login`);
  await logIn(page, { ...ANNA, password: 'wrong one, sadly' });
  await page.getByRole('alert').getByText('There is no such account, or the password is wrong.').waitFor();
  assert.equal(await page.getByLabel('Password').inputValue(), '');
  await axe(page);
  await logIn(page);
  await page.waitForURL(`${running.url}/`);
});

for (const then of ['//example.org/', 'https://example.org/', '/\\example.org', 'javascript:alert(1)', '\t//example.org', '/%09/example.org', '/login']) {
  test(`a login leads nowhere else: ${JSON.stringify(then)}`, async () => {
    const elsewhere = [];
    const page = await browser.page(`${running.url}/login?then=${encodeURIComponent(then)}`);
    page.on('request', (request) => { if (!request.url().startsWith(running.url)) elsewhere.push(request.url()); });
    await logIn(page);
    await page.getByRole('button', { name: 'Log out' }).waitFor();
    assert.equal(new URL(page.url()).origin, running.url);
    assert.deepEqual(elsewhere, []);
  });
}

test('after too many failures it says when to try again', async () => {
  const many = await service({ accounts: [ANNA] });
  const fail = () => fetch(`${many.url}/api/v1/session`, {
    method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify({ name: 'anna', password: 'wrong one, sadly' }),
  });
  let answer = await fail();
  while (answer.status === 401) answer = await fail();
  assert.equal(answer.status, 429);
  const page = await browser.page(`${many.url}/login`);
  await page.route('**/api/v1/session', (route) => route.fulfill({
    status: 429, headers: { 'retry-after': '3', 'content-type': 'application/problem+json' }, body: JSON.stringify({ title: 'Too many', detail: 'Too many' }),
  }));
  await logIn(page);
  await page.getByRole('alert').getByText('Too many attempts have failed. Try again in 3 s.').waitFor();
  await page.close();
  await many.stop();
});

for (const theme of ['light', 'dark']) {
  test(`accessible: ${theme}`, async () => {
    const page = await browser.page(`${running.url}/login`, { theme });
    await page.getByLabel('Name').waitFor();
    await axe(page);
  });
}
