// Logging in with the name and password of an account.

import { createRef, html, nothing, ref, render } from '../vendor/lit.js';
import { api, Problem } from '../api.js';
import { problemText, seconds, t } from '../texts.js';

/** Where to go after the login: the path that `search` names, if it is one of these pages, else the queue. */
export function nextOf(search) {
  const wanted = new URLSearchParams(search).get('then') ?? '/';
  // the browser reads it as it would follow it: only what stays here may be followed
  const address = URL.canParse(wanted, location.origin) ? new URL(wanted, location.origin) : null;
  const isOurs = wanted.startsWith('/') && address?.origin === location.origin && address.pathname !== '/login';
  return isOurs ? address.pathname + address.search : '/';
}

function failureOf(error) {
  if (!(error instanceof Problem)) return problemText(error);
  if (error.status === 401) return t('login.wrong');
  if (error.status !== 429) return problemText(error);
  return `${t('login.too_many')} ${t('login.again_after', { seconds: seconds(error.retryAfter_s ?? 3) })}`;
}

/** Shows the login in `place`. */
export function show(place, { go }) {
  const form = createRef();
  const draw = (failure, busy = false) => render(html`<section class="login"><h1>${t('login.title')}</h1>
    <form @submit=${submit} ${ref(form)}>
      <label class="field"><span>${t('login.name')}</span>
        <input name="name" autocomplete="username" autocapitalize="none" spellcheck="false" required></label>
      <label class="field"><span>${t('login.password')}</span>
        <input name="password" type="password" autocomplete="current-password" required></label>
      <p class="fault" role="alert">${failure ?? nothing}</p>
      <button type="submit" class="main" ?disabled=${busy}>${t('login.submit')}</button>
    </form></section>`, place);
  const submit = async (event) => {
    event.preventDefault();
    const { name, password } = form.value.elements;
    draw(undefined, true);
    try {
      await api.post('/session', { name: name.value.trim(), password: password.value });
      go(nextOf(location.search), { replace: true });
    } catch (error) {
      password.value = '';
      draw(failureOf(error));
      password.focus();
    }
  };
  draw();
  form.value.elements.name.focus();
}
