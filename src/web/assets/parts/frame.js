// What stands around every page: the mark, the way to the other pages, language, theme, and who is logged in.

import { html, nothing, render } from '../vendor/lit.js';
import { api } from '../api.js';
import { language, languages, speak, t } from '../texts.js';
import { go } from '../main.js';
import { NOTICES } from './notices.js';

const ENTRIES = [['queue', '/'], ['upload', '/upload'], ['control', '/control'], ['diagnosis', '/diagnosis'], ['dashboard', '/dashboard'], ['help', '/help']];
const THEMES = ['system', 'light', 'dark'];
const THEME = 'gable.theme';

function theme() {
  const kept = localStorage.getItem(THEME);
  return THEMES.includes(kept) ? kept : 'system';
}

function apply(chosen) {
  localStorage.setItem(THEME, chosen);
  document.documentElement.dataset.theme = chosen;
}
apply(theme());

async function leave() {
  await api.delete('/session').catch(() => {});
  go('/login');
}

/** Draws the frame into `body` and returns the element for the page, empty. `again` draws the page anew. */
export function frame(body, { page, session, again }) {
  const choose = (chosen) => { speak(chosen); again(); };
  const entry = ([name, address]) => html`
    <a href=${address} aria-current=${page === name ? 'page' : nothing}>${t(`frame.${name}`)}</a>`;
  document.title = `${t(`frame.${page}`)} · Gable`;
  render(html`
    <a class="skip" href="#page">${t('frame.skip')}</a>
    <header class="frame">
      <a class="mark" href="/"><span class="mark-picture" aria-hidden="true"></span>Gable</a>
      <nav aria-label=${t('frame.pages')}>${session ? ENTRIES.map(entry) : nothing}</nav>
      <div class="frame-end">
        <label><span class="unseen">${t('frame.language')}</span>
          <select @change=${(event) => choose(event.target.value)}>
            ${languages.map((tag) => html`<option value=${tag} ?selected=${tag === language} lang=${tag}>${tag.toUpperCase()}</option>`)}
          </select></label>
        <label><span class="unseen">${t('frame.theme')}</span>
          <select @change=${(event) => apply(event.target.value)}>
            ${THEMES.map((name) => html`<option value=${name} ?selected=${name === theme()}>${t(`frame.theme_${name}`)}</option>`)}
          </select></label>
        ${session ? html`<span class="who" title=${t(`frame.role_${session.role}`)}>${session.who.replace(/^account:/, '')}</span>` : nothing}
        ${session?.who.startsWith('account:') ? html`<button type="button" class="quiet" @click=${leave}>${t('frame.leave')}</button>` : nothing}
      </div>
    </header>
    <main id="page" tabindex="-1"></main>
    <div id=${NOTICES} role="status" aria-live="polite"></div>`, body);
  const place = body.querySelector('main');
  // each page begins with nothing of the one before
  const fresh = place.cloneNode(false);
  place.replaceWith(fresh);
  return fresh;
}
