/* log: what happened on the farm, newest first: the jobs' logs together, by the numbers of their events. */
import { h, children, moment } from './dom.js';
import { get } from './api.js';
import { state } from './state.js';
import { context } from './context.js';
import { jobLink } from './router.js';

const READ = 1000, SHOWN = 500;
let read = []; /* the store's newest events */

/* Each event once: one that came live has the number that the store has. */
const together = () => [...new Map([...read, ...state.log].map((e) => [Number(e.seq), e])).values()];

export function eventsView(node) {
  const list = h('ol', { class: 'log wide' }), search = h('input', { type: 'search', placeholder: 'Search', 'aria-label': 'Search events', oninput: () => draw() });
  const lines = h('input', { type: 'checkbox', id: 'worker-lines', onchange: () => draw() });
  node.append(h('h1', null, 'Events'), h('div', { class: 'line' }, search, h('label', { htmlFor: 'worker-lines' }, lines, ' lines of workers, too')), list);
  let known = false;         /* the logs were read: nothing in them is nothing on the farm */
  const draw = () => {
    const words = search.value.toLowerCase();
    const all = together()
      .filter((e) => (lines.checked || !e.from_worker) && (!words || `${e.job} ${state.job(e.job)?.name} ${e.who} ${e.text}`.toLowerCase().includes(words)))
      .sort((a, b) => b.seq - a.seq).slice(0, SHOWN);
    children(list, all.length ? all.map((e) => h('li', { class: e.from_worker ? 'worker' : '' }, moment(e.at), h('a', { href: jobLink(e.job) }, state.job(e.job)?.name || `job ${e.job}`), h('span', { class: 'who' }, e.who), h('span', null, e.text)))
      : !known ? [] : [h('li', null, words ? 'No event has these words.' : 'Nothing has happened yet. What people and the farm do to jobs is written here.')]);
  };
  draw();
  const load = () => get(`/log?newest=${READ}`).then((answer) => { read = answer.events || []; known = true; draw(); }).catch(() => {});
  if (state.loaded) load();
  const off = [context.on('jobs', (c) => (c.loaded ? load() : [...c.jobs.values()].includes(undefined) && draw())), context.on('log', draw)];
  return () => off.forEach((stop) => stop());
}
