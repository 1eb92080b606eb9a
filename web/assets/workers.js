/* workers: the strip at the lower edge, the list, and one worker's page. */
import { h, text, attr, property, children, moment, facts, show } from './dom.js';
import { get } from './api.js';
import { state, silentFor } from './state.js';
import { context } from './context.js';
import { workerOffers, workerVerbs, steer } from './verbs.js';
import { jobLink, workerLink } from './router.js';
import { count, samplesRate, bytes, span, coreTime, plural } from './format.js';
import { emptyWorkers } from './empty.js';
import { trouble } from './notice.js';

const POLL_MS = 5000;
const busy = (w) => w.status?.threads_busy ?? (w.units_leased ? w.threads : 0);
const isOff = (w) => !['idle', 'working'].includes(w.state);

function words(w) {
  const silent = silentFor(w);
  if (silent) return `silent for ${span(silent)}`;
  if (isOff(w)) return w.state;
  const job = w.job && state.job(w.job);
  return job ? job.name : w.state === 'idle' ? 'idle' : '';
}
const why = (w) => [silentFor(w) ? 'It has not reported its state lately.' : '', w.note, w.status?.reason].filter(Boolean).join(' · ');
const collator = new Intl.Collator('en', { numeric: true });
const byName = (a, b) => collator.compare(a.name, b.name);
const alarm = (w) => (silentFor(w) ? 2 : w.state === 'blocked' ? 1 : 0);

/* ---- the strip ----------------------------------------------------------------------------------- */

export function mountStrip(node) {
  const chips = new Map(), list = h('ol', { 'aria-label': 'Workers' }), empty = h('div', { class: 'empty', hidden: true });
  node.append(h('h2', null, h('a', { href: '#/workers' }, 'Workers')), list, empty);
  const make = () => {
    const c = { name: h('b'), bar: h('span', { class: 'bar', 'aria-hidden': 'true' }, h('i')), threads: h('span'), rate: h('span'), what: h('span', { class: 'what' }), mem: h('span') };
    c.link = h('a', null, c.name, c.bar, c.threads, c.rate, c.what, c.mem);
    c.node = h('li', null, c.link);
    return c;
  };
  const fill = (c, w) => {
    text(c.name, w.name);
    attr(c.node, 'data-worker', w.session);
    attr(c.link, 'href', workerLink(w.name));
    attr(c.link, 'title', `${w.name}\n${why(w) || `${w.host}, ${w.software}`}`);
    property(c.bar.firstChild, '--share', w.threads ? Math.min(1, busy(w) / w.threads).toFixed(2) : 0);
    text(c.threads, `${w.threads} thr`);
    text(c.rate, w.samples_per_second > 0 ? `${count(w.samples_per_second)}/s` : '');
    text(c.what, words(w));
    text(c.mem, w.status ? bytes(w.status.memory_bytes) : '');
    c.node.className = silentFor(w) ? 'silent' : isOff(w) ? 'off' : w.state;
  };
  const update = () => {
    const sorted = [...state.workers].sort((a, b) => alarm(b) - alarm(a) || byName(a, b));
    const seen = new Set();
    children(list, sorted.map((w) => {
      const key = `${w.name}/${w.session}`;
      seen.add(key);
      if (!chips.has(key)) chips.set(key, make());
      fill(chips.get(key), w);
      return chips.get(key).node;
    }));
    for (const key of chips.keys()) if (!seen.has(key)) chips.delete(key);
    const none = state.loaded && !sorted.length;
    if (none && empty.hidden) children(empty, emptyWorkers());
    show(empty, none);
    show(list, !none);
  };
  context.on('workers', update);
  context.on('jobs', (c) => c.loaded && update());
}

/* ---- the list ------------------------------------------------------------------------------------- */

const buttons = (w, after) => workerOffers(w).map((v) => h('button', {
  title: `${w.name}: ${workerVerbs[v].done}`, class: v === 'block' ? 'danger' : '', onclick: () => steer(v, w.name).then(after),
}, v[0].toUpperCase() + v.slice(1)));
const cell = (name, ...inside) => h('td', { 'data-title': name, class: /state|why|owner|error/.test(name) ? 'wrap' : '' }, ...inside);
const verbCell = (...inside) => h('td', { class: 'buttons' }, h('div', { class: 'buttons' }, ...inside));
const HEAD = ['name', 'state', 'job', 'threads', 'rate', 'processors', 'memory', 'cache', 'units', 'connected', ''];

function row(w) {
  const s = w.status, job = w.job && state.job(w.job), silent = silentFor(w);
  const shown = [w.name, silent ? words(w) : w.state, why(w), job ? job.name : w.job ? `job ${w.job}` : '–', `${busy(w)} of ${w.threads}`, w.samples_per_second > 0 ? `${count(w.samples_per_second)}/s` : '–',
    s ? s.cpus.toFixed(1) : '–', s ? bytes(s.memory_bytes) : '–', s ? bytes(s.cache_bytes) : '–', count(Number(w.units_done)), span(Number(w.connected_s))];
  return keep(`${w.name}/${w.session}`, [...shown, silent, ...workerOffers(w)].join('\n'), () => h('tr', { 'data-worker': w.session, class: silent ? 'silent' : w.state },
    h('th', { scope: 'row' }, h('a', { href: workerLink(w.name) }, w.name)),
    cell('state', h('span', { class: `state ${w.state}` }, shown[1]), shown[2] && h('small', null, shown[2])),
    cell('job', job ? h('a', { href: jobLink(w.job) }, job.name) : shown[3]),
    HEAD.slice(3, -1).map((name, i) => cell(name, shown[4 + i])), verbCell(buttons(w))));
}
/* A row is made again only if it shows something else; a button that is in use stays in use. */
const kept = new Map();
function keep(key, now, make) {
  if (kept.get(key)?.now !== now) kept.set(key, { now, node: make() });
  return kept.get(key).node;
}
const table = (head, rows, label) => h('div', { class: 'table', tabindex: '0', role: 'region', 'aria-label': label }, h('table', null,
  h('thead', null, h('tr', null, head.map((t) => (t ? h('th', { scope: 'col' }, t) : h('td'))))), h('tbody', null, rows)));
export { table, cell, verbCell };

export function workersView(node) {
  let goneShown = false;
  const rows = table(HEAD, [], 'All workers'), body = h('div'), goneBox = h('details', { ontoggle: (e) => { goneShown = e.target.open; if (goneShown) gone(); } }, h('summary', null, 'Workers that left'), h('div'));
  kept.clear();
  node.append(h('h1', null, 'Workers'), rows, body, goneBox);
  const gone = () => get('/workers?gone=1').then((list) => children(goneBox.lastChild, [(list.gone || []).length
    ? table(['name', 'left', 'why', 'units', 'samples', 'core time'], list.gone.map((g) => h('tr', null, h('th', { scope: 'row' }, h('a', { href: workerLink(g.name) }, g.name)),
      cell('left', moment(g.left_at)), cell('why', g.why), cell('units', count(Number(g.units_done))), cell('samples', count(Number(g.samples_done))), cell('core time', coreTime(g.core_seconds)))), 'Workers that left')
    : h('p', null, 'None has left.')])).catch(trouble);
  const update = () => {
    const marked = state.marks.filter((m) => !state.workers.some((w) => w.name === m.name));
    const using = document.activeElement?.closest('[data-worker]')?.dataset.worker, name = using && document.activeElement.textContent;
    children(rows.querySelector('tbody'), [...state.workers].sort(byName).map(row));
    if (using && !document.activeElement?.closest('[data-worker]')) {
      const again = [...rows.querySelectorAll(`[data-worker="${using}"] :is(button, a)`)];
      (again.find((e) => e.textContent === name) || again.find((e) => e.matches('button')) || again[0])?.focus();
    }
    show(rows, state.workers.length);
    children(body, state.workers.length || !state.loaded ? [] : emptyWorkers());
    if (marked.length) body.append(h('h2', null, 'Names that are drained or blocked'), ...marked.map((m) => h('p', { class: 'line' }, h('a', { href: workerLink(m.name) }, m.name), ` ${m.blocked ? 'blocked' : 'drained'} by ${m.who} `, moment(m.at), ...buttons({ name: m.name, state: m.blocked ? 'blocked' : 'drained' }, reload))));
  };
  const reload = () => get('/workers').then((list) => { state.marks = list.marks || []; update(); }).catch(() => {});
  reload();
  update();
  return context.on('workers', update);
}

/* ---- one ------------------------------------------------------------------------------------------- */

export function workerView(node, name) {
  const word = h('p'), verbs = h('div', { class: 'buttons' }), head = h('div', null, word, verbs), now = h('div'), lines = h('div'), before = h('div');
  node.append(h('p', null, h('a', { href: '#/workers' }, '← Workers')), h('h1', null, name), head, now, lines, before);
  const log = (list) => h('ol', { class: 'log' }, (list || []).map((l) => h('li', null, moment(l.at), h('span', null, l.text))));
  let timer = 0, stopped = false;
  const read = async () => {
    clearTimeout(timer);
    try {
      const list = await get(`/workers?gone=1&name=${encodeURIComponent(name)}`);
      if (stopped) return;
      const w = (list.workers || [])[0], mark = (list.marks || []).find((m) => m.name === name), s = w && w.status;
      if (w) w.seenAt = performance.now();
      const shown = w || { name, state: mark?.blocked ? 'blocked' : mark ? 'drained' : 'gone' };
      const words_ = [w ? w.state : mark ? `not connected, ${shown.state}` : 'not connected', w && why(w)].filter(Boolean).join(': '), offers = workerOffers(shown).join();
      word.className = `state ${shown.state}`;
      text(word, words_);
      if (verbs.dataset.now !== offers) {
        const used = verbs.contains(document.activeElement);
        verbs.dataset.now = offers;
        children(verbs, buttons(shown, read));
        if (used) verbs.querySelector('button')?.focus();
      }
      children(now, w ? [facts([
        ['job', w.job ? h('a', { href: jobLink(w.job) }, state.job(w.job)?.name || `job ${w.job}`) : 'none'],
        ['rate', samplesRate(w.samples_per_second)], ['threads', `${busy(w)} of ${w.threads} render`],
        ['units', `${count(Number(w.units_done))} done, ${w.units_leased} in hand`], ['samples', count(Number(w.samples_done))], ['core time', coreTime(w.core_seconds || 0)],
        ['processors', s && `${s.cpus.toFixed(1)} used${s.other_cpus >= 0 ? `, ${s.other_cpus.toFixed(1)} by others` : ''}`],
        ['memory', s && `${bytes(s.memory_bytes)} of ${bytes(s.machine_memory_bytes)}`], ['cache', s && `${bytes(s.cache_bytes)} of ${bytes(s.cache_limit_bytes)}`],
        ['long units', (s?.long_units || []).map((u) => h('div', null, `job ${u.job}, frame ${u.frame}, tile ${u.tile}: ${span(u.running_ms / 1000)}`))],
        ['host', `${w.host}, process ${w.process}`], ['address', w.address], ['connected', span(Number(w.connected_s))], ['tags', w.tags], ['software', w.software], ['kernel', w.kernel],
      ].map(([k, v]) => [k, Array.isArray(v) && !v.length ? '' : v]))] : []);
      children(lines, w ? [h('h2', null, 'Last lines of its log'), (w.lines || []).length ? log(w.lines) : h('p', null, 'None yet.')] : []);
      const gone = list.gone || [];
      children(before, [h('h2', null, 'Before'), ...(gone.length ? gone.map((g) => h('details', null,
        h('summary', null, moment(g.joined_at), ' – ', moment(g.left_at), ` · ${g.why}`),
        facts([['units', count(Number(g.units_done))], ['samples', count(Number(g.samples_done))], ['core time', coreTime(g.core_seconds)], ['connections', plural(g.connections, 'connection')], ['software', g.software]]), log(g.lines)))
        : [h('p', null, 'No earlier process of this name.')])]);
    } catch (error) { if (!stopped) children(lines, [h('p', { class: 'problem' }, error.message)]); }
    if (!stopped) timer = setTimeout(read, POLL_MS);
  };
  read();
  const off = context.on('jobs', (c) => c.loaded && read());
  return () => { stopped = true; clearTimeout(timer); off(); };
}
