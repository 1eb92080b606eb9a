/* login: the token in the address (#token=...) becomes a session, once; without one it is asked for. */
import { h } from './dom.js';
import { get, post, del } from './api.js';

/* Tabs of a browser share the session's cookie: signing in or out in one does so in all. */
let tabs = { postMessage() {} };
try { tabs = new BroadcastChannel('azulejo'); } catch { /* refused with the page's storage */ }
export const onOtherTab = (fn) => { tabs.onmessage = fn; };
async function signIn(token) {
  await post('/session', { token });
  tabs.postMessage('session');
}

const TOKEN = /[#&]token=([^&]+)/;
export const hasToken = () => TOKEN.test(location.hash);

/* The session {role, who, ...}, or null: the form is to be shown, with `why` in words. */
export async function begin() {
  const m = location.hash.match(TOKEN);
  if (m) {
    history.replaceState(null, '', '#/');
    try { await signIn(decodeURIComponent(m[1])); } catch (error) { return { session: null, why: error.message }; }
  }
  try {
    const session = await get('/session');
    return { session: session.role && session.role !== 'none' ? session : null, why: '' };
  } catch (error) {
    return { session: null, why: error.status === 401 ? '' : error.message, retry: !error.status || error.status >= 500 };
  }
}
export async function leave() {
  try { await del('/session'); tabs.postMessage('session'); } finally { location.hash = '#/'; location.reload(); }
}

export function loginForm(why, done) {
  const problem = h('p', { class: 'problem', role: 'alert' }, why);
  const input = h('input', { id: 'token', name: 'token', type: 'password', autocomplete: 'current-password', required: true, spellcheck: 'false' });
  return h('main', { class: 'login' }, h('form', {
    onsubmit: async (e) => {
      e.preventDefault();
      const words = input.value.trim(), m = words.match(/token=([^&\s]+)/);
      try { await signIn(m ? decodeURIComponent(m[1]) : words); done(); } catch (error) { problem.textContent = error.message; input.select(); }
    },
  }, h('h1', null, h('img', { src: '/assets/icon.svg', alt: '', width: 32, height: 32 }), ' Azulejo'),
  h('p', null, 'This page needs a token. The coordinator prints its page’s whole address when it starts; for others:'),
  h('code', null, 'azulejo token create --role view'),
  h('div', { class: 'field' }, h('label', { htmlFor: 'token' }, 'Token, or the whole address'), input), problem,
  h('div', { class: 'buttons' }, h('button', { class: 'primary' }, 'Open'))));
}
