/* main: the page's frame: header, views, connection, theme, keys. Reads: context.js, state.js, then this. */
import { h, text, attr, show, children, clockText, clockNow } from './dom.js';
import { context, emit } from './context.js';
import { live } from './live.js';
import { state, subscribe, load, loadJob, takeEvent, ended, reason, change, kept } from './state.js';
import { beginRouter, jobLink, go, parse } from './router.js';
import { mountQueue, step, focusSearch, setFilter, chosen, pickShown, moveBy, firstShown } from './queue.js';
import { mountJob, stepFrame } from './job/job.js';
import { mountStrip, workersView, workerView } from './workers.js';
import { eventsView } from './log.js';
import { storeView, accessView } from './admin.js';
import { submitView, beginDrops } from './submit.js';
import { emptyJobs } from './empty.js';
import { begin, hasToken, leave, loginForm, onOtherTab } from './login.js';
import { act, may, owns } from './verbs.js';
import { addKeys, allKeys, keysAreOn, switchKeys } from './keys.js';
import { open, closeAll } from './dialog.js';
import { undoLast, tell, say, trouble } from './notice.js';
import { count, samplesRate, plural, display, isolated } from './format.js';

const VIEWS = { workers: workersView, worker: workerView, events: eventsView, store: storeView, access: accessView, submit: submitView };
const TITLES = { workers: 'Workers', events: 'Events', store: 'Store', access: 'Access', submit: 'Submit' };
const ASK_MS = 4000;                  /* without a live connection */
const byId = (id) => document.getElementById(id);

/* ---- theme -------------------------------------------------------------------------------------- */

const dark = matchMedia('(prefers-color-scheme: dark)');
function theme() {
  const now = kept.get('theme') || (dark.matches ? 'dark' : 'light');
  if (document.documentElement.dataset.theme !== now) {
    document.documentElement.dataset.theme = now;
    emit('theme', now);
  }
  const button = byId('theme');
  if (button) { text(button, now === 'dark' ? '☀' : '☾'); attr(button, 'aria-label', now === 'dark' ? 'Light colours' : 'Dark colours'); }
}
function switchTheme() {
  const to = document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark';
  if (to === (dark.matches ? 'dark' : 'light')) kept.remove('theme'); else kept.set('theme', to);
  theme();
}
dark.addEventListener('change', theme);
theme();

/* ---- notifications: of the browser, when asked for ---------------------------------------------- */

const wants = () => kept.get('notify') || 'off';
async function askNotify(value) {
  if (value !== 'off' && 'Notification' in window && Notification.permission !== 'granted' && await Notification.requestPermission() !== 'granted') {
    say('The browser does not allow notifications for this page: allow them in its settings for this address.');
    value = 'off';
  }
  kept.set('notify', value);
  return value;
}
function notify(job) {
  if (wants() === 'off' || (wants() === 'mine' && !owns(job)) || !('Notification' in window) || Notification.permission !== 'granted') return;
  let note;
  try { note = new Notification(`${isolated(job.name)}: ${job.state}`, { body: reason(job) || (job.now?.figures ? `error ${display(job.now.figures.display)}` : ''), tag: `job-${job.job}`, icon: '/assets/icon.svg' }); } catch { /* phones have the permission, but let no page use it */
    kept.set('notify', 'off');
    say('This browser cannot show notifications of a page: they are off.');
    return;
  }
  note.onclick = () => { focus(); go(jobLink(job.job)); note.close(); };
}

/* ---- header --------------------------------------------------------------------------------------- */

let lostAt = 0, through = false, asking = 0; /* through: requests are answered all the same */
function header() {
  const threads = state.workers.reduce((n, w) => n + w.threads, 0), rate = state.workers.reduce((n, w) => n + w.samples_per_second, 0);
  const jobs = [...state.jobs.values()], of = (...s) => jobs.filter((j) => s.includes(j.state)).length;
  const open = jobs.filter((j) => !ended(j)).length, states = state.farm.states || {};
  text(byId('n-workers'), plural(state.workers.length, 'worker'));
  text(byId('n-threads'), plural(threads, 'thread'));
  text(byId('n-rate'), samplesRate(rate));
  text(byId('n-queue'), count(open));
  text(byId('n-done'), count(Math.max(of('done'), Number(states.done) || 0)));
  text(byId('n-failed'), count(Math.max(of('failed', 'parked'), (Number(states.failed) || 0) + (Number(states.parked) || 0))));
  byId('to-failed').classList.toggle('alarm', of('failed', 'parked') > 0);
  const why = state.farm.store_usable === false ? state.farm.store_why || state.farm.store_text || 'the store cannot be written: jobs wait, nothing is lost' : '';
  show(byId('farm-trouble'), why);
  text(byId('farm-trouble').firstChild, why && `${why}.`.replace(/\.\.$/, '.'));
  title();
}
function title() {
  const job = context.info(), route = parse();
  const view = TITLES[route.view] || (route.view === 'worker' ? route.name : job && `${isolated(job.name)}${job.state === 'running' && job.now?.figures ? ` ${display(job.now.figures.display)}` : ` ${job.state}`}`);
  document.title = `${lostAt ? '⚠ ' : ''}${view ? `${view} · ` : ''}Azulejo`;
}
function connection(now, first) {
  emit('connection', now);
  document.documentElement.dataset.connection = now;
  if (now === 'lost' && !lostAt) {
    lostAt = clockNow();
    tell('Connection lost');
    get401();
    asking = setTimeout(askInstead, ASK_MS);
  } else if (now === 'open') {
    if (lostAt) { tell('Connected again'); refreshed(); }
    lostAt = 0;
    through = false;
    clearTimeout(asking);
    if (first) load().catch(trouble);
  }
  lostWords();
  title();
}
function lostWords() {
  text(byId('lost-words'), !lostAt ? '' : through
    ? `The live connection does not get through (a proxy without WebSockets?). The lists are read again every ${ASK_MS / 1000} s; the picture is a preview.`
    : `No connection since ${clockText(lostAt)}. What you see is from then; the page tries again by itself.`);
  show(byId('connection-bar'), lostAt);
}
/* A proxy may let requests through, but no WebSocket. */
async function askInstead() {
  if (!byId('app').hidden) {
    try {
      await load();
      through = true;
      emit('connection', 'blocked');
    } catch (why) {
      through = false;
      if (why.status === 401) get401();
    }
  }
  if (!lostAt) return;
  lostWords();
  asking = setTimeout(askInstead, ASK_MS);
}
/* Lost because the token was revoked? */
async function get401() {
  const { session, retry, why } = await begin();
  if (!session && !retry) signIn(why || 'Your token is no longer valid: it was revoked, or it expired.');
}
/* After a restart the coordinator may be another release, or the token have another role. */
async function refreshed() {
  const { session } = await begin();
  if (!session) return;
  state.session = session;
  who();
  change().session = true;
}
function who() {
  const s = state.session;
  text(byId('who'), `${(s.who || s.role).split('@')[0]} ▾`);
  attr(byId('who'), 'title', `${s.who}, role ${s.role}`);
  show(byId('nav-access'), may('admin'));
  document.body.dataset.role = s.role;
}
function whoMenu() {
  const s = state.session, select = h('select', { id: 'notify', onchange: async () => { select.value = await askNotify(select.value); } },
    [['off', 'off'], ['mine', 'of my jobs'], ['all', 'of all jobs']].map(([v, t]) => h('option', { value: v }, t)));
  select.value = wants();
  return open(s.who || 'Signed in', (close) => [
    h('p', null, `Role ${s.role}${s.token_name ? `, token “${s.token_name}”` : ''}. ${state.farm.software || s.software || ''}`),
    h('div', { class: 'field' }, h('label', { htmlFor: 'notify' }, 'Notifications when a job ends or needs a person'), select),
    h('p', { class: 'links' }, h('a', { href: '/api/v1/openapi.yaml', target: '_blank', rel: 'noopener' }, 'The API')),
    h('div', { class: 'buttons' }, h('button', { onclick: () => { close(); help(); } }, 'Keys'), h('button', { onclick: () => { close(); leave(); } }, 'Sign out'), h('button', { class: 'primary', onclick: () => close() }, 'Close')),
  ]);
}

/* ---- views ------------------------------------------------------------------------------------------ */

let stopView = null;
function phone(tab) {
  document.body.dataset.tab = tab;
  for (const b of byId('tabs').children) attr(b, 'aria-current', b.dataset.tab === tab ? 'true' : undefined);
}
function take(route) {
  const farm = route.view === 'farm', main = byId('view');
  if (stopView) stopView();
  stopView = null;
  children(main, []);
  document.body.dataset.view = route.view;
  if (!farm) {
    const box = h('div', { class: 'page' });
    main.append(box);
    stopView = VIEWS[route.view](box, route.name) || null;
    main.scrollTop = 0;
  }
  for (const a of document.querySelectorAll('#nav a')) attr(a, 'aria-current', a.hash === `#/${farm ? '' : route.view.replace(/^worker$/, 'workers')}` ? 'page' : undefined);
  if (farm) {
    const was = context.shown;
    const job = route.job || (was.job && state.job(was.job) ? was.job : 0);
    if (job !== was.job || route.frame !== was.frame) {
      context.shown = { job, frame: route.frame };
      if (job && !state.job(job) && state.loaded) loadJob(job).catch(() => {});
      emit('select');
    }
    if (route.job && document.body.dataset.tab === 'queue') phone('picture');
    checkFrame();
  } else phone('view');
  nothing();
  title();
}
/* A link may name a frame that the job has not (any more): another job's, or one of before it was submitted again. */
function checkFrame() {
  const job = context.info(), frame = context.frame();
  if (!job || !frame || (frame >= job.first_frame && frame <= job.last_frame)) return;
  say(`${isolated(job.name)} has no frame ${frame}: it has ${job.first_frame === job.last_frame ? `frame ${job.first_frame} only` : `frames ${job.first_frame} to ${job.last_frame}`}.`);
  go(jobLink(job.job), true);
}
/* What stands where the picture would be. */
let said = '';
function nothing() {
  const what = !state.loaded || context.job() ? '' : state.jobs.size ? 'choose' : 'empty';
  show(byId('nothing'), what);
  if (what && what !== said) children(byId('nothing-words'), what === 'empty' ? emptyJobs() : [h('p', null, 'Choose a job to see its picture become right.')]);
  said = what;
}
/* Without a choice, the page shows what is served first. */
function chooseOne() {
  const route = parse(); /* it may be newer than what is shown */
  if (route.view !== 'farm' || route.job || context.job() || !state.loaded) return;
  const first = firstShown();
  if (first) {
    const tab = document.body.dataset.tab;
    go(jobLink(first), true);
    phone(tab);
  }
}

function changed(now) {
  if (now.loaded || now.jobs.has(context.job())) checkFrame(); /* before its parts ask for the frame */
  if (now.jobs.size || now.removed.size || now.loaded) emit('jobs', now);
  if (now.workers) emit('workers');
  if (now.log.length) emit('log', now.log);
  if (now.jobs.has(context.job()) || now.removed.has(context.job()) || now.loaded || now.session) emit('job');
  if (now.removedHere && now.removed.has(context.job())) go('#/', true);
  for (const [number, before] of now.jobs) {
    const job = state.job(number);
    if (!job || !state.loaded || now.loaded || before === undefined || before === job.state) continue;
    tell(`${isolated(job.name)} is ${job.state}${reason(job) ? `: ${reason(job)}` : ''}`);
    if (ended(job) || job.state === 'parked') notify(job);
  }
  header();
  if (now.loaded) {
    if (context.job() && !state.job(context.job())) loadJob(context.job()).catch(() => emit('job'));
    chooseOne();
  } else if (now.jobs.size || now.removed.size) chooseOne();
  if (now.loaded || now.jobs.size || now.removed.size) nothing();
}

/* ---- help and keys ---------------------------------------------------------------------------------- */

function help() {
  const groups = new Map();
  for (const [key, { text: words, group }] of allKeys()) {
    if (!groups.has(group)) groups.set(group, []);
    groups.get(group).push([key, words]);
  }
  const toggle = h('input', { type: 'checkbox', id: 'single-keys', checked: keysAreOn(), onchange: () => switchKeys(toggle.checked) });
  return open('Keys', (close) => [
    h('div', { class: 'columns' }, [...groups].map(([name, keys]) => h('section', null, h('h3', null, name), h('dl', { class: 'facts' }, keys.map(([key, words]) => [h('dt', null, h('kbd', null, key.replace('Arrow', ''))), h('dd', null, words)]))))),
    h('p', null, h('label', null, toggle, ' single keys act')),
    h('div', { class: 'buttons' }, h('button', { class: 'primary', onclick: () => close(), autofocus: true }, 'Close')),
  ], 'wide');
}
const onShown = (verb) => ({ run: () => act(verb, chosen()) });
addKeys({
  j: { text: 'next job', run: () => step(1) }, k: { text: 'previous job', run: () => step(-1) },
  J: { text: 'move the job down the queue', run: () => moveBy(1) }, K: { text: 'move the job up the queue', run: () => moveBy(-1) },
  x: { text: 'choose the job, for verbs on several', run: pickShown },
  '/': { text: 'search the queue', run: () => { phone('queue'); focusSearch(); } },
  '[': { text: 'previous frame', run: () => stepFrame(-1) }, ']': { text: 'next frame', run: () => stepFrame(1) },
}, 'Queue');
addKeys({
  p: { text: 'pause, or resume', run: () => act(chosen().every((n) => ['paused', 'parked'].includes(state.job(n)?.state)) ? 'resume' : 'pause', chosen()) },
  f: { text: 'finish', ...onShown('finish') }, r: { text: 'retry', ...onShown('retry') }, P: { text: 'priority', ...onShown('priority') },
  E: { text: 'extend', ...onShown('extend') }, c: { text: 'cancel', ...onShown('cancel') }, Delete: { text: 'remove', ...onShown('remove') },
  u: { text: 'undo', run: undoLast },
}, 'Verbs');
addKeys({
  'g q': { text: 'queue and picture', run: () => go(context.job() ? jobLink(context.job()) : '#/') }, 'g w': { text: 'workers', run: () => go('#/workers') },
  'g e': { text: 'events', run: () => go('#/events') }, 'g s': { text: 'store', run: () => go('#/store') },
  n: { text: 'submit a scene', run: () => go('#/submit') }, '?': { text: 'these keys', run: help },
}, 'Page');

/* ---- begin --------------------------------------------------------------------------------------------- */

function signIn(why) {
  live.end();
  for (const id of ['refused', 'said']) children(byId(id), []); /* the form says it */
  byId('app').hidden = true;
  closeAll();
  document.querySelector('.menu')?.remove();
  document.querySelector('main.login')?.remove();
  document.body.prepend(loginForm(why, () => { location.reload(); }));
  byId('token').focus();
}
function mount() {
  byId('theme').onclick = switchTheme;
  byId('who').onclick = whoMenu;
  byId('help').onclick = help;
  byId('again').onclick = () => live.begin({});
  for (const a of document.querySelectorAll('[data-filter]')) a.onclick = () => { phone('queue'); setFilter(a.dataset.filter); };
  for (const b of byId('tabs').children) b.onclick = () => {
    phone(b.dataset.tab);
    if (parse().view !== 'farm') go(context.job() ? jobLink(context.job()) : '#/');
    phone(b.dataset.tab);
  };
  mountQueue(byId('queue'));
  mountStrip(byId('workers'));
  const { cost, effects } = mountJob(byId('side'));
  /* The queue works also where one of these does not. */
  for (const [name, file, node] of [['mountPicture', './picture.js', byId('picture')], ['mountCost', './job/cost.js', cost], ['mountEffects', './job/effects.js', effects]])
    import(file).then((part) => part[name](node, context))
      .catch((why) => { console.error(why); node.append(h('p', { class: 'problem' }, `This part of the page failed: ${why.message}`)); });
  beginDrops();
}
async function start() {
  const { session, why, retry } = await begin();
  if (!session && retry) { setTimeout(start, 1000); return; }
  theme();
  if (!session) { signIn(why); return; }
  state.session = session;
  byId('app').hidden = false;
  phone('queue');
  mount();
  who();
  subscribe(changed);
  beginRouter(take);
  live.begin({ event: takeEvent, connection });
  /* The lists do not need the live connection: a proxy may not let it through. */
  setTimeout(() => state.loaded || load().catch(trouble), 1500);
  header();
}
/* In another tab somebody signed in, or out: what this one asks for is asked in that name from now on. */
onOtherTab(async () => {
  if (byId('app').hidden) { location.reload(); return; }
  const { session } = await begin(), before = state.session;
  if (!session) { signIn('You signed out in another tab of this browser.'); return; }
  await refreshed();
  if (session.token === before.token) return;
  live.again();
  say(`Another tab of this browser signed in as ${session.who}, role ${session.role}: this tab is that, too.`);
});
/* A token put into the address of a page that is open signs in as it does on opening, and is removed from there. */
addEventListener('hashchange', async (event) => {
  if (!hasToken()) return;
  event.stopImmediatePropagation(); /* it is no place to go to */
  const { session, why } = await begin();
  if (session) location.reload(); else signIn(why);
});
start();
