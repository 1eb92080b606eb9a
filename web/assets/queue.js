/* queue: the list of jobs. One row a job, made once; a change touches only what it says.
 * Rows keep their places while the pointer is among them, and for two seconds after it last moved there.
 */
import { h, text, attr, show, property, children } from './dom.js';
import { state, ended, share, frameCount, reason, inOrder, loadOlder, keptByTab } from './state.js';
import { context } from './context.js';
import { offered, act, owns, reorder, may } from './verbs.js';
import { jobLink, go } from './router.js';
import { lineWords, target, percent } from './format.js';
import { trouble, say } from './notice.js';
import { menuOf } from './job/job.js';

const HOLD_MS = 2000;
const DRAGGED = 'application/x-azulejo-job';
const FILTERS = {
  all: () => true,
  active: (j) => !ended(j),
  mine: owns,
  done: (j) => j.state === 'done',
  failed: (j) => ['failed', 'parked'].includes(j.state),
};
const memory = (key, value) => keptByTab.set(`queue.${key}`, value);
let filter = keptByTab.get('queue.filter') || 'all', words = keptByTab.get('queue.words') || '';
if (!FILTERS[filter]) filter = 'all';

const rows = new Map();      /* job -> row */
const picked = new Set();    /* numbers */
let list, chips, search, empty, more, bulk, anchor = 0;
let shown = [];              /* the rows' jobs, in order */
let heldUntil = 0, timer = 0;

const fits = (job) => FILTERS[filter](job) && words.toLowerCase().split(/\s+/).every((w) =>
  !w || `${job.job} ${job.name} ${job.owner} ${job.state}`.toLowerCase().includes(w));

function makeRow(number) {
  const r = {
    number, mark: h('span', { class: 'mark', 'aria-hidden': 'true' }),
    name: h('span', { class: 'name' }), head: h('span', { class: 'head' }),
    line: h('span', { class: 'line' }), owner: h('span', { class: 'owner' }),
    bar: h('span', { class: 'bar', 'aria-hidden': 'true' }, h('i')),
    pick: h('input', { type: 'checkbox', onclick: (e) => pick(number, e.shiftKey) }),
  };
  r.link = h('a', { href: jobLink(number), draggable: 'false' }, r.mark, r.name, r.head, r.line, r.owner, r.bar);
  r.link.onclick = (e) => { if (e.ctrlKey || e.metaKey || e.shiftKey) { e.preventDefault(); pick(number, e.shiftKey, true); } };
  r.node = h('li', { draggable: 'true', 'data-job': number }, r.link, r.pick);
  r.node.oncontextmenu = (e) => { e.preventDefault(); go(jobLink(number)); menuOf([state.job(number)], e.clientX, e.clientY); };
  return r;
}
function second(job) {
  if (job.state !== 'running') return reason(job);
  const frames = frameCount(job);
  return [frames > 1 && `${job.frames_done}/${frames}`, lineWords(job), !job.now?.figures && target(job.stop) && `to ${target(job.stop)}`,
    reason(job)].filter(Boolean).join(' · ');
}
function fill(r, job) {
  const part = share(job), frames = frameCount(job);
  text(r.name, job.name);
  text(r.head, job.state === 'running' ? percent(part) : job.state === 'queued' && job.state_text ? 'waiting' : job.state);
  const line = ended(job) ? [frames > 1 && `${job.frames_done}/${frames} frames`, reason(job)].filter(Boolean).join(' · ') : second(job);
  text(r.line, line);
  /* A reason needs the room. */
  text(r.owner, reason(job) ? '' : (job.owner || '').split('@')[0]);
  attr(r.link, 'title', [`job ${job.job}: ${job.name}`, job.owner, line].filter(Boolean).join('\n'));
  r.node.className = job.state;
  property(r.bar.firstChild, '--share', part.toFixed(3));
  attr(r.pick, 'aria-label', `Select ${job.name} (job ${job.job})`);
}

function counts() {
  const all = [...state.jobs.values()];
  for (const [name, chip] of chips) {
    attr(chip, 'aria-pressed', String(filter === name));
    const n = all.filter(FILTERS[name]).length;
    text(chip.lastChild, n ? n + (state.older && /all|done|mine/.test(name) ? '+' : '') : '');
  }
}
function order() {
  clearTimeout(timer);
  const wait = heldUntil - performance.now();
  if (wait > 0) {
    timer = setTimeout(order, wait + 20);
    return;
  }
  shown = [...state.jobs.values()].filter(fits).sort(inOrder).map((j) => j.job);
  const focus = list.contains(document.activeElement) && document.activeElement;
  children(list, shown.map((number) => {
    if (!rows.has(number)) { rows.set(number, makeRow(number)); fill(rows.get(number), state.job(number)); }
    return rows.get(number).node;
  }));
  if (focus && focus.isConnected && focus !== document.activeElement) focus.focus({ preventScroll: true });
  for (const number of rows.keys()) if (!state.jobs.has(number)) { rows.delete(number); picked.delete(number); }
  const nothing = state.loaded && !shown.length;
  show(empty, nothing);
  if (nothing) text(empty, state.jobs.size ? 'No job fits these words and this filter.' : 'No jobs yet.');
  show(more, state.older && !['active', 'failed'].includes(filter));
  mark();
}
function mark() {
  for (const [number, r] of rows) {
    attr(r.link, 'aria-current', number === context.job() ? 'true' : undefined);
    if (r.pick.checked !== picked.has(number)) r.pick.checked = picked.has(number);
  }
  list.classList.toggle('picking', picked.size > 0);
  bulkBar();
}

/* ---- choosing several ------------------------------------------------------------------------ */

function pick(number, range, fromLink) {
  const yes = fromLink || range ? true : !picked.has(number);
  if (fromLink && !range && picked.has(number)) picked.delete(number);
  else if (range && shown.includes(anchor)) {
    const [a, b] = [shown.indexOf(anchor), shown.indexOf(number)].sort((x, y) => x - y);
    for (const n of shown.slice(a, b + 1)) picked.add(n);
  } else if (yes) picked.add(number); else picked.delete(number);
  anchor = number;
  mark();
}
export const chosen = () => (picked.size ? [...picked] : context.job() ? [context.job()] : []);
function bulkBar() {
  show(bulk, picked.size > 0);
  if (!picked.size) { bulk.dataset.now = ''; return; }
  const jobs = [...picked].map(state.job).filter(Boolean), verbs = offered(jobs);
  const now = `${jobs.length}:${verbs.map((v) => v.name)}`;
  if (bulk.dataset.now === now) return;
  bulk.dataset.now = now;
  children(bulk, [h('span', null, `${jobs.length} chosen`),
    ...verbs.map((v) => h('button', { class: v.question ? 'danger' : '', title: v.says, onclick: () => act(v.name, [...picked]).then((d) => d && ['remove'].includes(v.name) && clear()) }, v.label)),
    h('button', { class: 'quiet', onclick: clear }, 'None')]);
}
const clear = () => { picked.clear(); mark(); };

/* ---- moving ------------------------------------------------------------------------------------ */

const waiting = () => shown.map(state.job).filter((j) => j && !ended(j));
function move(number, place) {
  const job = state.job(number), all = [...state.jobs.values()].filter((j) => !ended(j)).sort(inOrder);
  if (!job) return say('The job was removed meanwhile: nothing was moved.');
  if (ended(job)) return say('Only jobs that have not ended have a place in the queue.');
  /* `place` counts what is shown; with a filter, the whole queue's place is before the same neighbour. */
  const rest = waiting().filter((j) => j !== job), whole = all.filter((j) => j !== job);
  const at = place < rest.length ? whole.indexOf(rest[place]) : rest.length ? whole.indexOf(rest.at(-1)) + 1 : 0;
  heldUntil = 0;
  return reorder(all, job, at);
}
export function moveBy(step) {
  const number = context.job(), at = waiting().findIndex((j) => j.job === number);
  if (at >= 0 && at + step >= 0 && at + step < waiting().length) move(number, at + step);
}
function dragging() {
  let from = 0, over = null;
  const clean = () => { if (over) over.classList.remove('above', 'below'); over = null; };
  list.addEventListener('dragstart', (e) => {
    const li = e.target.closest('li');
    const job = li && state.job(li.dataset.job);
    if (!job || ended(job) || !may('operate', job)) { e.preventDefault(); return; }
    from = job.job;
    e.dataTransfer.effectAllowed = 'move';
    e.dataTransfer.setData(DRAGGED, String(from));
  });
  list.addEventListener('dragover', (e) => {
    /* Of this drag: that of a row which was removed has no end. */
    if (!e.dataTransfer.types.includes(DRAGGED)) return;
    const li = e.target.closest('li'), job = li && state.job(li.dataset.job);
    clean();
    if (!job || ended(job) || job.job === from) return;
    e.preventDefault();
    const box = li.getBoundingClientRect();
    over = li;
    li.classList.add(e.clientY < box.top + box.height / 2 ? 'above' : 'below');
  });
  list.addEventListener('drop', (e) => {
    if (!over) return;
    e.preventDefault();
    const after = over.classList.contains('below'), rest = waiting().filter((j) => j.job !== from);
    const at = rest.findIndex((j) => j.job === Number(over.dataset.job));
    if (at >= 0 || !state.job(from)) move(from, at + (after ? 1 : 0));
    else say('The job there ended or was removed meanwhile: nothing was moved.');
    clean();
  });
  list.addEventListener('dragend', clean);
}

/* ---- choosing one -------------------------------------------------------------------------------- */

export function step(by) {
  if (!shown.length) return;
  const at = shown.indexOf(context.job());
  const next = shown[at < 0 ? (by > 0 ? 0 : shown.length - 1) : Math.min(shown.length - 1, Math.max(0, at + by))];
  go(jobLink(next), true);
  const row = rows.get(next);
  if (row) { row.node.scrollIntoView({ block: 'nearest' }); if (list.contains(document.activeElement)) row.link.focus(); }
}
export const firstShown = () => shown[0] || 0;
export const pickShown = () => context.job() && pick(context.job());
export function focusSearch() { search.focus(); search.select(); }
export function setFilter(name) {
  filter = name;
  memory('filter', name);
  heldUntil = 0;
  counts();
  order();
}

export function mountQueue(node) {
  list = h('ol', { class: 'rows', 'aria-label': 'Jobs' });
  chips = new Map(Object.keys(FILTERS).map((name) => [name, h('button', { class: 'chip', onclick: () => setFilter(name) }, name, ' ', h('span', { class: 'n' }))]));
  search = h('input', { type: 'search', placeholder: 'Search', 'aria-label': 'Search jobs by name, owner, number or state', value: words });
  search.oninput = () => { words = search.value; memory('words', words); heldUntil = 0; order(); };
  search.onkeydown = (e) => { if (e.key === 'Escape') { search.value = ''; search.oninput(); search.blur(); } };
  empty = h('div', { class: 'empty', hidden: true });
  more = h('button', { class: 'more', hidden: true, onclick: () => loadOlder().catch(trouble) }, 'Older jobs');
  bulk = h('div', { class: 'bulk', hidden: true, role: 'toolbar', 'aria-label': 'The chosen jobs' });
  node.append(h('div', { class: 'tools' }, h('div', { class: 'line' }, h('h2', null, 'Queue'), search, h('a', { class: 'button', href: '#/submit' }, 'Submit')),
    h('div', { class: 'chips', role: 'group', 'aria-label': 'Which jobs' }, [...chips.values()])),
  h('div', { class: 'scroll', tabindex: '-1' }, list, empty, more), bulk);
  const hold = () => { heldUntil = performance.now() + HOLD_MS; };
  list.addEventListener('pointermove', hold, { passive: true });
  list.addEventListener('wheel', hold, { passive: true });
  list.addEventListener('pointerleave', () => { heldUntil = Math.min(heldUntil, performance.now()); order(); });
  dragging();
  context.on('select', mark);
  context.on('jobs', (changes) => {
    for (const number of changes.jobs.keys()) {
      const r = rows.get(number), job = state.job(number);
      if (r && job) fill(r, job);
    }
    for (const number of changes.removed) if (rows.has(number)) rows.get(number).node.className = 'gone';
    if (changes.jobs.size || changes.removed.size || changes.loaded) { counts(); order(); bulkBar(); }
  });
  counts();
}
