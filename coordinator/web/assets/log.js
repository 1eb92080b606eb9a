/* log: what happened on the farm, newest first: the jobs' logs together. */
import { h, children, moment } from './dom.js';
import { get } from './api.js';
import { state } from './state.js';
import { context } from './context.js';
import { jobLink } from './router.js';

const JOBS_READ = 20, SHOWN = 500;
const read = new Map(); /* job -> its log as the store has it: events with numbers */

/* All events with an `order` in their job. One that came live has no number (its seq is 0): it is left out when the
 * job's log has it, too, as often as that has it; else it is newer than the log. */
function together() {
  const all = [], kept = new Map();
  const name = (e) => JSON.stringify([Number(e.job), Number(e.at), e.who, e.text]);
  for (const [job, events] of read) for (const e of events) {
    const known = { ...e, job, order: Number(e.seq) };
    all.push(known);
    kept.set(name(known), (kept.get(name(known)) || 0) + 1);
  }
  state.log.forEach((e, i) => {
    const left = kept.get(name(e)) || 0;
    if (left) kept.set(name(e), left - 1);
    else all.push({ ...e, job: Number(e.job), order: Number.MAX_SAFE_INTEGER - state.log.length + i });
  });
  return all;
}

export function eventsView(node) {
  const list = h('ol', { class: 'log wide' }), search = h('input', { type: 'search', placeholder: 'Search', 'aria-label': 'Search events', oninput: () => draw() });
  const lines = h('input', { type: 'checkbox', id: 'worker-lines', onchange: () => draw() });
  node.append(h('h1', null, 'Events'), h('div', { class: 'line' }, search, h('label', { htmlFor: 'worker-lines' }, lines, ' lines of workers, too')), list);
  let known = false;         /* the logs were read: nothing in them is nothing on the farm */
  const draw = () => {
    const words = search.value.toLowerCase();
    const all = together()
      .filter((e) => (lines.checked || !e.from_worker) && (!words || `${e.job} ${state.job(e.job)?.name} ${e.who} ${e.text}`.toLowerCase().includes(words)))
      .sort((a, b) => b.at - a.at || b.job - a.job || b.order - a.order).slice(0, SHOWN);
    children(list, all.length ? all.map((e) => h('li', { class: e.from_worker ? 'worker' : '' }, moment(e.at), h('a', { href: jobLink(e.job) }, state.job(e.job)?.name || `job ${e.job}`), h('span', { class: 'who' }, e.who), h('span', null, e.text)))
      : !known ? [] : [h('li', null, words ? 'No event has these words.' : 'Nothing has happened yet. What people and the farm do to jobs is written here.')]);
  };
  draw();
  const load = () => {
    const newest = [...state.jobs.values()].sort((a, b) => Math.max(b.finished_at, b.submitted_at) - Math.max(a.finished_at, a.submitted_at)).slice(0, JOBS_READ);
    Promise.allSettled(newest.map((j) => get(`/jobs/${j.job}/log?after=0`).then((answer) => read.set(j.job, answer.events || [])))).then(() => { known = true; draw(); });
  };
  if (state.loaded) load();
  const off = [context.on('jobs', (c) => (c.loaded ? load() : [...c.jobs.values()].includes(undefined) && draw())), context.on('log', draw)];
  return () => off.forEach((stop) => stop());
}
