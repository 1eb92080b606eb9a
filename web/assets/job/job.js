/* job: the panel beside the picture: how far a job is, how good, when it is good enough; its verbs, frames, files, log. */
import { h, text, attr, show, children, setMoment, moment, facts, command, clockText, clockNow } from '../dom.js';
import { get, url } from '../api.js';
import { state, ended, share, frameCount, bit, reason, loadJob } from '../state.js';
import { context } from '../context.js';
import { offered, act, owns } from '../verbs.js';
import { jobLink, go } from '../router.js';
import { span, coreTime, display, target, lineWords, interval, endedByDepth, percent, plural, samplesRate, bytes } from '../format.js';
import { where } from '../empty.js';

const FRAMES_SHOWN = 240, LINES_KEPT = 400;
const END = { cap: 'all samples', target: 'the target', time: 'the time limit', cores: 'the core limit', cancel: 'a cancel', schedule: 'its schedule', finish: 'finish', missed: 'the target, which it misses,', rays: 'the limit of rays' };
const TOO_FEW = 'too few samples to know';
let ui = null;
let points = new Map();     /* "job/frame" -> the last HistoryPoint of a frame that is not in work */
let logged = { job: 0, seq: 0, busy: false };
let asked = '';

/* ---- figures ----------------------------------------------------------------------------------- */

function pointOf(job, frame) {
  if (frame === job.now_frame && job.now) return job.now;
  /* Other frames' are in the history, which grows between two rests. */
  const key = `${job.job}/${frame}/${job.frames_done}/${['running', 'finishing', 'cancelling'].includes(job.state) ? '' : job.seconds_active}`;
  if (!points.has(key)) {
    if (points.size > 100) points.clear();
    points.set(key, undefined);
    get(`/jobs/${job.job}/frames/${frame}/history`)
      .then((history) => { points.set(key, (history.points || []).at(-1)); update(); }).catch(() => {});
  }
  return points.get(key);
}
const between = (low, high, f) => (low >= 0 && high > low ? ` (${f(low)} to ${f(high)})` : '');

/* When is it good enough? In words. */
function whenWords(job) {
  if (job.state === 'done') return job.missed > 0 ? `no: ${target(job.stop)} is missed` : job.finished_early ? 'finished early' : 'done';
  if (ended(job) || job.state === 'cancelling') return 'not any more';
  const end = (job.forecasts || []).find((f) => f.at_end), aim = target(job.stop), runs = ['running', 'finishing'].includes(job.state);
  const after = job.state === 'queued' ? ' of rendering left' : ' after it is resumed';
  if (end && end.seconds >= 0 && frameCount(job) === 1) {
    const when = interval(end), shown = when === 'shown' ? between(end.seconds_low, end.seconds_high, span) : '';
    const time = when === 'wide' ? 'too early to say when' : `${span(end.seconds)}${shown}`;
    const misses = aim && job.stop.measure === 'display' && end.display > 1.1 * job.stop.target;
    const what = misses ? `${display(end.display)} at the end, not ${aim},` : aim || `${display(end.display)} at the end`;
    return when === 'wide' ? `${what}: ${time}` : `${what}${runs ? ` in ${time}` : `, ${time}${after}`}`;
  }
  if (job.seconds_left >= 0 && runs)
    return `${aim ? `${aim}, all frames` : 'all done'} in ${span(job.seconds_left)}, at ${clockText(clockNow() + job.seconds_left)}`;
  return aim ? `${aim}; when is not known yet` : runs ? 'not known yet' : '–';
}
const stateWords = (job) => [job.state, reason(job)].filter(Boolean).join(': ');

function figures(job, frame) {
  const point = pointOf(job, frame), f = point && point.figures;
  text(ui.error, f ? display(f.display) : '–');
  attr(ui.error, 'title', f ? '95 % of the pixels that see the subject are within this many codes of 255 of the picture that infinitely many samples would give' : 'Too few samples to know');
  const denoised = point?.denoised && `RMSE ${Number(f.rmse_percent.toPrecision(2))} % raw, ${Number(point.denoised.rmse_percent.toPrecision(2))} % denoised`;
  text(ui.errorMore, f ? [denoised, between(f.display_low, f.display_high, display).replace(/^ \(|\)$/g, ''), `${f.psnr_db === 'inf' || f.psnr_db === null ? '∞' : f.psnr_db.toFixed(1)} dB`, f.worst_part > 0 && `worst part ${display(f.worst_part)}`, f.fireflies > 0 && plural(f.fireflies, 'firefly', 'fireflies'), !f.reliable && 'may be understated'].filter(Boolean).join(' · ') : job.state === 'done' ? TOO_FEW : 'not known yet');
  text(ui.when, whenWords(job));
  text(ui.spent, coreTime(job.core_seconds || 0));
  text(ui.rate, job.state === 'running' ? `${samplesRate(job.samples_per_second)} on ${plural(job.workers, 'worker')}` : plural(frameCount(job) === 1 && Number(point?.samples) > Number(job.samples_done) ? Number(point.samples) : Number(job.samples_done), 'sample'));
}

/* ---- verbs --------------------------------------------------------------------------------------- */

const inFront = (job) => offered([job]).filter((v) => v.front.includes(job.state)).slice(0, 2);
const inMenu = (job) => offered([job]).filter((v) => !inFront(job).includes(v));
const verbButton = (verb, job) => h('button', { class: verb.question ? 'danger' : '', title: verb.says, onclick: () => act(verb.name, job.job) }, verb.label);
const menuButton = (job) => h('button', { 'aria-haspopup': 'menu', title: 'More verbs', onclick: (e) => { const b = e.currentTarget.getBoundingClientRect(), now = state.job(job.job); if (now) menuOf([now], b.left, b.bottom + 4, inMenu(now)); } }, 'More');

/* While a job is shown its buttons stay the same elements: one that is replaced under the pointer loses its click. */
const made = { job: 0, buttons: new Map() };
function madeOnce(job, name, make) {
  if (made.job !== job.job) Object.assign(made, { job: job.job, buttons: new Map() });
  if (!made.buttons.has(name)) made.buttons.set(name, make());
  return made.buttons.get(name);
}

function buttons(job) {
  const wanted = inFront(job).map((v) => madeOnce(job, v.name, () => verbButton(v, job)));
  if (inMenu(job).length) wanted.push(madeOnce(job, 'more', () => menuButton(job)));
  const used = ui.verbs.contains(document.activeElement);
  children(ui.verbs, wanted);
  if (used && !ui.verbs.contains(document.activeElement)) ui.verbs.querySelector('button')?.focus();
}

/* A menu of verbs at a place of the window. */
export function menuOf(jobs, x, y, some) {
  const before = document.activeElement;
  const can = some || offered(jobs);
  if (!can.length) return;
  const close = () => { node.remove(); removeEventListener('pointerdown', outside, true); if (before && before.isConnected) before.focus(); };
  const outside = (e) => { if (!node.contains(e.target)) close(); };
  const items = can.map((v) => h('button', { role: 'menuitem', class: v.question ? 'danger' : '', onclick: () => { close(); act(v.name, jobs.map((j) => j.job)); } }, h('b', null, v.label), h('small', null, v.says)));
  const node = h('div', { role: 'menu', class: 'menu', 'aria-label': 'Verbs', 'data-own-keys': true }, items);
  node.onkeydown = (e) => {
    const at = items.indexOf(document.activeElement), to = { ArrowDown: at + 1, ArrowUp: at - 1, Home: 0, End: -1 }[e.key];
    if (e.key === 'Escape' || e.key === 'Tab') { e.preventDefault(); close(); } else if (to !== undefined) { e.preventDefault(); items.at(to % items.length).focus(); }
  };
  document.body.append(node);
  const box = node.getBoundingClientRect();
  node.style.left = `${Math.max(8, Math.min(x, innerWidth - box.width - 8))}px`;
  node.style.top = `${Math.max(8, Math.min(y, innerHeight - box.height - 8))}px`;
  addEventListener('pointerdown', outside, true);
  items[0].focus();
}

/* ---- frames -------------------------------------------------------------------------------------- */

function frames(job, frame) {
  const n = job.last_frame - job.first_frame + 1;
  show(ui.frames, n > 1);
  if (n <= 1) return;
  const follow = context.frame() === 0;
  text(ui.framesHead, `${job.frames_done} of ${frameCount(job)} frames done${job.frames_resting ? `, ${job.frames_resting} rest` : ''}`);
  attr(ui.follow, 'aria-pressed', String(follow));
  if (document.activeElement !== ui.number) ui.number.value = frame;
  attr(ui.number, 'min', job.first_frame);
  attr(ui.number, 'max', job.last_frame);
  const few = n <= FRAMES_SHOWN;
  show(ui.grid, few);
  if (!few) return;
  if (ui.grid.dataset.job !== `${job.job}:${n}`) {
    ui.grid.dataset.job = `${job.job}:${n}`;
    children(ui.grid, Array.from({ length: n }, (_, i) => h('a', { href: jobLink(job.job, job.first_frame + i) }, String(job.first_frame + i))));
  }
  [...ui.grid.children].forEach((cell, i) => {
    const f = job.first_frame + i;
    const what = bit(job.done, i) ? 'done' : bit(job.resting, i) ? 'rests' : f === job.preview_frame && !ended(job) ? 'work' : 'open';
    if (cell.className !== what) { cell.className = what; cell.title = `Frame ${f}: ${{ done: 'done', rests: 'rests until the job is extended', work: 'in work', open: 'not begun, or in work' }[what]}`; }
    attr(cell, 'aria-current', f === frame ? 'true' : undefined);
  });
}
export function stepFrame(by) {
  const job = context.info();
  if (!job || job.first_frame === job.last_frame) return;
  const to = Math.min(job.last_frame, Math.max(job.first_frame, context.shownFrame() + by));
  go(jobLink(job.job, to), true);
}

/* ---- files, settings ------------------------------------------------------------------------------- */

function files(job, frame) {
  const single = job.first_frame === job.last_frame;
  const isDone = job.done ? bit(job.done, frame - job.first_frame) : single && job.frames_done > 0;
  const at = `/jobs/${job.job}/frames/${frame}/`;
  const formats = job.output?.formats?.length ? job.output.formats : ['exr', 'png'];
  const some = isDone ? [...formats.map((f) => (f === 'jpeg' ? 'jpg' : f)), 'effects.json'] : ['preview.png', 'preview.exr'];
  const now = `${job.job}/${frame}/${some}/${job.revision}`;
  if (ui.files.dataset.now === now) return;
  ui.files.dataset.now = now;
  children(ui.files, [
    h('p', { class: 'links' }, some.map((name) => h('a', { class: 'button', href: url(at + name), download: true }, name.replace('preview.', 'Preview ').replace(/^(exr|png|jpg)$/, (s) => s.toUpperCase())))),
    !isDone && h('p', { class: 'hint' }, 'Frame ', String(frame), ' is not done: a preview is its picture so far.'),
    h('p', { class: 'hint' }, 'All files, and when each thread rendered what, from a terminal:'),
    command(`azulejo fetch ${job.job} -o .${where()}`), command(`azulejo trace ${job.job} -o trace.json${where()}`),
  ].filter(Boolean));
}

function settings(job) {
  const s = job.settings || {}, o = job.output || {}, stop = job.stop || {};
  const now = JSON.stringify([job.job, s, o, stop, job.priority, job.after, job.not_before, job.owner, job.finished_at, job.cut_frames, job.conflicts, job.ended_by_depth, job.develop_error]);
  if (ui.settings.dataset.now === now) return;
  ui.settings.dataset.now = now;
  children(ui.settings, [facts([
    ['job', String(job.job)], ['scene', job.scene_name], ['owner', job.owner], ['submitted', job.submitted_at > 0 && moment(job.submitted_at)],
    ['ended', job.finished_at > 0 && moment(job.finished_at)],
    ['priority', String(job.priority)], ['after', (job.after || []).flatMap((n, i) => [i ? ', ' : '', h('a', { href: jobLink(n) }, `job ${n}`)])],
    ['not before', Number(job.not_before) > 0 && moment(job.not_before)], ['requires', job.require],
    ['memory', Number(job.memory) > 0 && `${bytes(job.memory)}${job.memory_said ? '' : ', estimated'}`],
    ['size', `${s.width} × ${s.height}${s.whole_width ? ` of ${s.whole_width} × ${s.whole_height}` : ''}`],
    ['frames', job.first_frame === job.last_frame ? String(job.first_frame) : `${job.first_frame}-${job.last_frame}, ${s.fps || 24} a second`],
    ['samples', job.by_schedule ? 'what its schedule says' : s.spp >= 1 << 20 ? 'no limit' : `${s.spp} a pixel at most`], ['target', target(stop)],
    ['time limit', Number(stop.time_limit_ms) > 0 && `${span(stop.time_limit_ms / 1000)} a frame`],
    ['core limit', Number(stop.core_limit_ms) > 0 && `${coreTime(stop.core_limit_ms / 1000)} a frame`],
    ['limit of rays', Number(stop.max_rays) > 0 && `${plural(Number(stop.max_rays), 'ray')} a frame`],
    ['depth', String(s.max_depth)], ['light ended by depth', endedByDepth(job.ended_by_depth)], ['seed', String(s.seed)],
    ['operator', o.tonemap], ['exposure', `${o.exposure_ev > 0 ? '+' : ''}${o.exposure_ev || 0} EV`], ['white', o.white_kelvin > 0 && `${o.white_kelvin} K`],
    ['denoised', o.denoise && o.denoise !== 'off' && `${o.denoise === 'fast' ? 'fast' : 'yes'}${o.denoise_around > 0 ? `, with ${plural(o.denoise_around, 'frame')} before and after each` : ''}`],
    ['cut', (job.cut_frames || []).map((c) => h('div', null, `frame ${c.frame} by ${END[c.end] || c.end} at ${c.samples_min}–${c.samples_max} samples`))],
    ['conflicts', Number(job.conflicts) > 0 && plural(Number(job.conflicts), 'result') + ' differed from one merged before'],
    ['develop', job.develop_error],
  ].map(([k, v]) => [k, Array.isArray(v) && !v.length ? '' : v]))]);
}

/* ---- log ------------------------------------------------------------------------------------------- */

const logLine = (e) => h('li', { class: e.from_worker ? 'worker' : '' }, moment(e.at), h('span', { class: 'who' }, e.who), h('span', null, e.text));

async function readLog() {
  const number = context.job();
  if (!ui.log.open || !number || (logged.job === number && logged.busy)) return;
  if (logged.job !== number) { logged = { job: number, seq: 0 }; children(ui.lines, []); }
  const mine = logged;
  mine.busy = true;
  try {
    for (;;) {
      const answer = await get(`/jobs/${number}/log?after=${mine.seq}`), fresh = (answer.events || []).filter((e) => e.seq > mine.seq);
      if (logged !== mine || !fresh.length) break;
      mine.seq = fresh.at(-1).seq;
      appendLog(fresh);
    }
  } catch { /* the connection's line says it */ }
  mine.busy = false;
}
function appendLog(events) {
  const box = ui.lines, atEnd = box.scrollTop + box.clientHeight >= box.scrollHeight - 8;
  box.append(...events.map(logLine));
  while (box.children.length > LINES_KEPT) box.firstChild.remove();
  if (atEnd) box.scrollTop = box.scrollHeight;
}

/* ---- all of it --------------------------------------------------------------------------------------- */

export function update() {
  const job = context.info();
  show(ui.all, !!job);
  show(ui.none, !job && context.job() > 0 && state.loaded);
  if (!job) return;
  const frame = context.shownFrame();
  text(ui.name, job.name);
  text(ui.frame, frameCount(job) > 1 || job.last_frame > job.first_frame ? `frame ${frame} / ${job.last_frame}` : '');
  ui.state.className = `state ${job.state}`;
  text(ui.stateWords, stateWords(job));
  attr(ui.progress, 'value', share(job).toFixed(4));
  text(ui.percent, percent(share(job)));
  text(ui.now, job.state === 'running' ? lineWords(job) : '');
  text(ui.owner, owns(job) ? 'yours' : job.owner || '');
  setMoment(ui.since, job.finished_at > 0 ? job.finished_at : job.submitted_at);
  text(ui.sinceWord, job.finished_at > 0 ? 'ended' : 'submitted');
  figures(job, frame);
  buttons(job);
  frames(job, frame);
  files(job, frame);
  settings(job);
  /* What only the answer about one job has: which frames are done. */
  const wanted = `${job.job}/${job.frames_done}/${job.state}`;
  if (job.last_frame > job.first_frame && asked !== wanted) {
    asked = wanted;
    loadJob(job.job).catch(() => { asked = ''; });
  }
}

/* Puts the panel into `node`; gives the places of the cost and the effects. */
export function mountJob(node) {
  ui = {};
  const part = (name, tag, props, ...inside) => (ui[name] = h(tag, props, ...inside));
  const number = (e) => { const job = context.info(), f = Number(e.target.value); if (job && f >= job.first_frame && f <= job.last_frame) go(jobLink(job.job, f), true); };
  const cost = h('div', { id: 'cost' }), effects = h('div', { id: 'effects' });
  node.append(
    part('none', 'p', { class: 'empty', hidden: true }, 'There is no such job on this farm: it was removed, or the link is of another farm.'),
    part('all', 'div', { class: 'job', hidden: true },
      h('header', null, h('h2', null, part('name', 'span'), ' ', part('frame', 'small')),
        /* Above all that may take another line: a button must not move under the pointer. */
        part('verbs', 'div', { class: 'buttons', role: 'toolbar', 'aria-label': 'Verbs' }),
        part('state', 'p', { class: 'state' }, h('span', { class: 'mark', 'aria-hidden': 'true' }), part('stateWords', 'span')),
        h('p', { class: 'line' }, part('progress', 'progress', { max: 1, 'aria-label': 'How much of the job is done' }), part('percent', 'b')),
        part('now', 'p', { class: 'hint now' }),
        h('p', { class: 'hint' }, part('owner', 'span'), ' · ', part('sinceWord', 'span'), ' ', part('since', 'time', { class: 'moment' }))),
      h('dl', { class: 'figures' },
        h('div', null, h('dt', null, 'error'), h('dd', null, part('error', 'b', { class: 'big' }), part('errorMore', 'small'))),
        h('div', null, h('dt', null, 'good enough'), part('when', 'dd')),
        h('div', null, h('dt', null, 'spent'), h('dd', null, part('spent', 'span'), part('rate', 'small')))),
      part('frames', 'section', { class: 'frames', hidden: true },
        h('div', { class: 'line' }, part('framesHead', 'span'), h('label', null, 'Frame ', part('number', 'input', { type: 'number', onchange: number })),
          part('follow', 'button', { class: 'chip', title: 'Show the frame in work', onclick: () => go(jobLink(context.job()), true) }, 'Follow')),
        part('grid', 'div', { class: 'grid' })),
      cost, effects,
      part('filesBox', 'details', { open: true }, h('summary', null, 'Files'), part('files', 'div')),
      part('settingsBox', 'details', null, h('summary', null, 'Settings'), part('settings', 'div')),
      part('log', 'details', null, h('summary', null, 'Log'), part('lines', 'ol', { class: 'log', tabindex: '0', 'aria-label': 'What happened to the job' }))));
  ui.log.ontoggle = readLog;
  context.on('select', () => { update(); readLog(); });
  context.on('job', update);
  context.on('log', (events) => { if (events.some((e) => Number(e.job) === context.job())) readLog(); });
  update();
  return { cost, effects };
}
