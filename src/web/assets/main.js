// The frame of all pages: who is there, the way between the pages, language and theme. Each page is a module of
// `pages/` with `show(place, context)`, which may return a function that ends it.

import { html, render } from './vendor/lit.js';
import { api, NOBODY, Problem } from './api.js';
import { frame } from './parts/frame.js';
import { notify } from './parts/notices.js';
import { problemText, t } from './texts.js';

const PAGES = [
  [/^\/$/, 'queue'],
  [/^\/upload$/, 'upload'],
  [/^\/orientations\/([0-9a-f-]{36})$/, 'result'],
  [/^\/control$/, 'control'],
  [/^\/diagnosis(?:\/([^/]+))?$/, 'diagnosis'],
  [/^\/dashboard$/, 'dashboard'],
  [/^\/help$/, 'help'],
  [/^\/login$/, 'login'],
];

let end = () => {};
let turn = 0;

/** Goes to an address of these pages. */
export function go(address, { replace = false } = {}) {
  if (replace) history.replaceState(null, '', address);
  else history.pushState(null, '', address);
  return show();
}

/** Whether the caller may do what asks for `role`. */
function mayBe(session, role) {
  const order = ['reader', 'operator', 'admin'];
  return order.indexOf(session?.role) >= order.indexOf(role);
}

async function show() {
  const mine = ++turn;
  end();
  end = () => {};
  const [, name, id] = PAGES.map(([pattern, page]) => [pattern.exec(location.pathname), page])
    .filter(([match]) => match).map(([match, page]) => [match, page, match[1]])[0] ?? [null, 'nowhere'];
  const session = name === 'login' ? null : await api.get('/session').catch(refused);
  if (mine !== turn) return;
  if (session === undefined) return go(`/login?then=${encodeURIComponent(location.pathname + location.search)}`, { replace: true });
  const place = frame(document.body, { page: name, session, again: show });
  const context = { id: id && decodeURIComponent(id), session, may: (role) => mayBe(session, role), go };
  try {
    const page = await import(`./pages/${name}.js`);
    const ended = await page.show(place, context);
    // somebody went on before this page was there
    if (mine !== turn) ended?.();
    else end = ended ?? end;
  } catch (error) {
    if (mine !== turn) return;
    render(html`<section class="page"><h1>${t('frame.failed')}</h1><p role="alert">${problemText(error)}</p></section>`, place);
  }
}

// nobody, or a session that has ended: both have to log in
function refused(error) {
  if (error instanceof Problem && error.status === 401) return undefined;
  notify(problemText(error), 'error');
  return null;
}

document.addEventListener('click', (event) => {
  const link = event.target.closest?.('a[href]');
  if (!link || event.defaultPrevented || event.button !== 0 || event.metaKey || event.ctrlKey || event.shiftKey) return;
  const address = new URL(link.href);
  const ours = address.origin === location.origin && PAGES.some(([pattern]) => pattern.test(address.pathname));
  if (!ours || link.target || link.hasAttribute('download')) return;
  event.preventDefault();
  go(address.pathname + address.search);
});
addEventListener('popstate', show);
addEventListener(NOBODY, show);
show();
