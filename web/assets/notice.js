/* notice: short lines for people, at the lower edge; and what only screen readers speak. */
import { h, text } from './dom.js';

const STAY_MS = 8000, KEPT = 4;
let last = null; /* presses the newest line's button */

function line(node, words, undo, undoName) {
  /* The same again, as of requests that are repeated, is no news. */
  for (const item of undo ? [] : [...node.children]) if (item.firstChild.textContent === words) item.remove();
  const act = () => { close(); undo(); };
  const item = h('div', { class: 'notice' }, h('span', null, words), undo && h('button', { onclick: act }, undoName || 'Undo'),
    h('button', { class: 'quiet', 'aria-label': 'Close this message', onclick: () => close() }, '×'));
  let timer = 0;
  const close = () => { item.remove(); if (last === act) last = null; };
  const start = () => { clearTimeout(timer); timer = setTimeout(close, STAY_MS); };
  const hold = () => clearTimeout(timer);
  for (const [event, fn] of [['mouseenter', hold], ['focusin', hold], ['mouseleave', start], ['focusout', start]]) item.addEventListener(event, fn);
  if (undo) last = act;
  node.append(item);
  while (node.children.length > KEPT) node.firstChild.remove();
  start();
}

export const say = (words, undo, undoName) => line(document.getElementById('said'), words, undo, undoName);
export function trouble(why) {
  if (why && (why.name === 'AbortError' || (why.status === 401 && document.querySelector('main.login')))) return;
  line(document.getElementById('refused'), why instanceof Error || why.message ? why.message : String(why));
}
export function undoLast() {
  if (last) last(); else say('Nothing to undo.');
}

/* State changes: several within a moment become one sentence. */
let waiting = [], timer = 0;
export function tell(words) {
  waiting.push(words);
  clearTimeout(timer);
  timer = setTimeout(() => {
    const node = document.getElementById('spoken');
    text(node, waiting.length > 3 ? `${waiting.slice(0, 3).join('. ')}. And ${waiting.length - 3} more changes.` : waiting.join('. '));
    waiting = [];
  }, 500);
}
