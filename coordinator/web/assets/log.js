/* log: what happened on the farm, newest first: the jobs' logs together. */
import { h, children, moment } from './dom.js';
import { get } from './api.js';
import { state } from './state.js';
import { context } from './context.js';
import { jobLink } from './router.js';

const JOBS_READ = 20, SHOWN = 500;
const read = new Map(); /* job -> its events, by seq */

const keep = (number, events) => {
  if (!read.has(number)) read.set(number, new Map());
  for (const e of events) read.get(number).set(e.seq, { ...e, job: number });
};

export function eventsView(node) {
  const list = h('ol', { class: 'log wide' }), search = h('input', { type: 'search', placeholder: 'Search', 'aria-label': 'Search events', oninput: () => draw() });
  const lines = h('input', { type: 'checkbox', id: 'worker-lines', onchange: () => draw() });
  node.append(h('h1', null, 'Events'), h('div', { class: 'line' }, search, h('label', { htmlFor: 'worker-lines' }, lines, ' lines of workers, too')), list);
  let known = false;         /* the logs were read: nothing in them is nothing on the farm */
  const draw = () => {
    const words = search.value.toLowerCase();
    const all = [...read.values()].flatMap((m) => [...m.values()])
      .filter((e) => (lines.checked || !e.from_worker) && (!words || `${e.job} ${state.job(e.job)?.name} ${e.who} ${e.text}`.toLowerCase().includes(words)))
      .sort((a, b) => b.at - a.at || b.job - a.job || b.seq - a.seq).slice(0, SHOWN);
    children(list, all.length ? all.map((e) => h('li', { class: e.from_worker ? 'worker' : '' }, moment(e.at), h('a', { href: jobLink(e.job) }, state.job(e.job)?.name || `job ${e.job}`), h('span', { class: 'who' }, e.who), h('span', null, e.text)))
      : !known ? [] : [h('li', null, words ? 'No event has these words.' : 'Nothing has happened yet. What people and the farm do to jobs is written here.')]);
  };
  for (const e of state.log) keep(Number(e.job), [e]);
  draw();
  const load = () => {
    const newest = [...state.jobs.values()].sort((a, b) => Math.max(b.finished_at, b.submitted_at) - Math.max(a.finished_at, a.submitted_at)).slice(0, JOBS_READ);
    Promise.allSettled(newest.map((j) => get(`/jobs/${j.job}/log?after=0`).then((answer) => keep(j.job, answer.events || [])))).then(() => { known = true; draw(); });
  };
  if (state.loaded) load();
  const off = [context.on('jobs', (c) => c.loaded && load()), context.on('log', (events) => { for (const e of events) keep(Number(e.job), [e]); draw(); })];
  return () => off.forEach((stop) => stop());
}
