/* keys: single keys for everything. A key acts only where nothing is typed; they can be switched off. */

import { kept } from './state.js';

const table = new Map(); /* key -> {text, run, group} */
let on = kept.get('keys') !== 'off';

/* {"j": {text: "next job", run}}; "g w" is two keys in a row. Returns a function that takes them back. */
export function addKeys(map, group = 'Page') {
  for (const [key, entry] of Object.entries(map)) table.set(key, { group, ...entry });
  return () => { for (const key of Object.keys(map)) table.delete(key); };
}
export const allKeys = () => [...table];
export const keysAreOn = () => on;
export function switchKeys(yes) {
  on = yes;
  kept.set('keys', yes ? 'on' : 'off');
}

const typing = (node) => node && (node.isContentEditable || /^(TEXTAREA|SELECT)$/.test(node.tagName) ||
  (node.tagName === 'INPUT' && !/^(checkbox|radio|button|range|file)$/.test(node.type)));

let first = '', firstAt = -Infinity;
addEventListener('keydown', (event) => {
  if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.isComposing || typing(event.target)) return;
  if (document.querySelector('dialog[open]') || (!on && event.key.length === 1)) return;
  /* A focused button, slider or list has its own Enter, Space and arrows. */
  if (/^(Enter| |Arrow.*|Home|End)$/.test(event.key) && event.target.closest('button,a,input,summary,[role=slider],[data-own-keys]')) return;
  const key = (event.altKey ? 'Alt+' : '') + event.key;
  const two = event.timeStamp - firstAt < 1500 ? table.get(`${first} ${key}`) : undefined;
  const entry = two || table.get(key);
  first = key;
  firstAt = event.timeStamp;
  if (!entry) return;
  if (two) first = '';
  event.preventDefault();
  entry.run(event);
});
