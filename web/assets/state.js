/* state: what the page knows of the farm, as the API sends it. Changes are announced once in an animation frame.
 *
 *   begin --> load (lists) --> events change it --> "reset" --> load again
 */
import { get } from './api.js';
import { clockText, setClock } from './dom.js';

/* What the browser keeps for this page. One that refuses (site data blocked, a full disk) must not keep the page from working. */
function memory(name) {
  const here = new Map(), of = (fn) => { try { return fn(window[name]); } catch { return null; } };
  return {
    get: (key) => of((s) => s.getItem(key)) ?? here.get(key) ?? null,
    set(key, value) { here.set(key, value); of((s) => s.setItem(key, value)); },
    remove(key) { here.delete(key); of((s) => s.removeItem(key)); },
  };
}
export const kept = memory('localStorage'), keptByTab = memory('sessionStorage');

const EVENTS_KEPT = 2000;
const ENDED_FIRST = 200;

const jobs = new Map();
const gone = new Set(); /* removed since they were asked for: an answer of before does not bring them back */
let changes = null, listeners = [], touched = null, loading = null;

export const state = {
  session: null,        /* {role, who, token, software, farm}; null: not signed in */
  farm: {},             /* as GET /farm */
  verbs: new Map(),     /* name -> as GET /verbs has it; in the order of buttons */
  jobs,
  workers: [],          /* WorkerInfo, each with `seenAt`, a moment of performance.now() */
  marks: [],            /* WorkerMark */
  log: [],              /* JobEvent with `job`, oldest first */
  older: 0,             /* ended jobs before these are on the coordinator, too */
  loaded: false,
  job: (number) => jobs.get(Number(number)),
  active: () => [...jobs.values()].filter((j) => !ended(j)),
};

const FINAL = new Set(['done', 'failed', 'cancelled']);
export const ended = (job) => FINAL.has(job.state);

/* fn({jobs: Map number -> state before, removed: Set, workers, farm, log: [new lines], loaded, session}) */
export const subscribe = (fn) => listeners.push(fn);

export function change() {
  if (!changes) {
    changes = { jobs: new Map(), removed: new Set(), log: [] };
    /* A hidden page has no animation frames, but its notifications are wanted. */
    if (document.hidden) setTimeout(flush, 200); else requestAnimationFrame(flush);
  }
  return changes;
}
function flush() {
  if (!changes) return;
  const now = changes;
  changes = null;
  for (const fn of listeners) fn(now);
}
document.addEventListener('visibilitychange', () => changes && document.hidden && flush());

/* A name that can be seen and pressed: one of spaces alone is none. */
export const nameOf = (name, job) => (/[^\s\p{C}\p{Default_Ignorable_Code_Point}]/u.test(name || '') ? name : `job ${job}`);

/* Keys that only the answer about one job has (azulejo.proto) stay until it is asked again. */
const ONLY_ALONE = ['done', 'developed', 'resting'];
/* Answers and events come by connections of their own: an older one may come after a newer one. `first`: of a list that begins
 * what is known. */
export function takeJob(info, first) {
  const before = jobs.get(info.job), late = !first && before && BigInt(info.told || 0) < BigInt(before.told || 0);
  const [now, other] = late ? [before, info] : [info, before];
  now.name = nameOf(now.name, now.job);
  if (other) for (const key of ONLY_ALONE) if (!now[key] && other[key]) now[key] = other[key];
  jobs.set(now.job, now);
  if (touched) touched.add(info.job);
  const all = change().jobs;
  if (!all.has(info.job)) all.set(info.job, before && before.state);
}
/* `here`: by a person at this page; the farm's word of it may have come before the answer. */
export function takeRemoved(number, here) {
  gone.add(number);
  if (touched) touched.add(number);
  if (jobs.delete(number) || here) change().removed.add(number);
  if (here) change().removedHere = true;
}
/* A verb's answer. A job that is gone has no scene. */
export function takeAnswer(answer) {
  for (const info of (answer && answer.jobs) || []) if (info.scene) takeJob(info); else takeRemoved(info.job, true);
}
export function takeWorkers(list) {
  const at = performance.now();
  state.workers = (Array.isArray(list) ? list : list.workers || []).map((w) => ({ ...w, seenAt: at }));
  if (list.marks) state.marks = list.marks;
  change().workers = true;
}
export function takeFarm(farm) {
  if (Number(farm.now)) setClock(Number(farm.now));
  state.farm = farm;
  change().farm = true;
}
export function takeLog(lines) {
  const all = change().log;
  for (const line of lines) {
    state.log.push(line);
    all.push(line);
  }
  if (state.log.length > EVENTS_KEPT) state.log.splice(0, state.log.length - EVENTS_KEPT);
}

async function pages(path, each, most = Infinity, from = 0) {
  for (let before = from, n = 0; ;) {
    const list = await get(`${path}&before=${before}`);
    const got = list.jobs || [];
    each(got);
    n += got.length;
    if (!Number(list.older) || !got.length) return 0;
    before = Math.min(...got.map((j) => j.job));
    if (n >= most) return before;
  }
}

/* All lists anew. Events that come meanwhile are newer than the answers. */
export function load() {
  if (loading) return loading;
  touched = new Set();
  const seen = new Set();
  const take = (list) => {
    for (const info of list) {
      seen.add(info.job);
      if (!touched.has(info.job)) { takeJob(info, true); touched.delete(info.job); }
    }
  };
  loading = (async () => {
    await Promise.all([
      state.verbs.size || get('/verbs').then((list) => list.verbs.forEach((v) => state.verbs.set(v.name, v))),
      get('/farm').then(takeFarm).catch(() => {}), /* its lines are the least of what is shown */
      get('/workers').then(takeWorkers),
      pages('/jobs?filter=active', take),
      pages('/jobs?filter=ended', take, ENDED_FIRST).then((before) => { state.older = before; }),
    ]);
    for (const number of jobs.keys())
      if (!seen.has(number) && !touched.has(number)) takeRemoved(number);
    state.loaded = true;
    change().loaded = true;
  })().finally(() => { loading = null; touched = null; });
  return loading;
}
export async function loadOlder() {
  state.older = await pages('/jobs?filter=ended', (list) => list.forEach((j) => jobs.has(j.job) || takeJob(j)), ENDED_FIRST, state.older);
  change().loaded = true;
}
export async function loadJob(number) {
  gone.delete(Number(number));
  const list = await get(`/jobs/${number}`);
  const info = (list.jobs || [list])[0];
  if (info && info.job && !gone.has(info.job)) takeJob(info);
  return info;
}

/* An event of the live connection. */
export function takeEvent(name, data) {
  if (name === 'job') takeJob(data);
  else if (name === 'job-removed') takeRemoved(Number(data.job));
  else if (name === 'workers') takeWorkers(data);
  else if (name === 'farm') takeFarm(data);
  else if (name === 'log') takeLog([data]);
  else if (name === 'reset') load().catch(() => {});
}

/* ---- what a job's figures say --------------------------------------------------------------- */

/* How much of its work is done, 0..1. */
export const share = (job) => job.done_share || 0;
export const frameCount = (job) => Math.max(1, job.last_frame - job.first_frame + 1 - (job.frames_resting || 0));
export const bit = (hex, i) => hex && i >> 3 < hex.length / 2 ? (parseInt(hex.substr((i >> 3) * 2, 2), 16) >> (i & 7)) & 1 : 0;

/* Why it waits or failed, in words, and what a person noted. */
const why = (job) => (Number(job.waits_until) ? `waits until ${clockText(job.waits_until)}` : '') || job.state_text || (job.state === 'queued' && job.queue_position > 1 ? `${job.queue_position - 1} before it` : job.finished_early ? 'finished early' : '');
export const reason = (job) => [why(job), job.comment].filter(Boolean).join('; ');

/* The order of the queue: what is served first comes first, the newest of the ended. */
const RANK = { running: 0, finishing: 0, cancelling: 0, queued: 1, paused: 2, parked: 2 };
export function inOrder(a, b) {
  const endA = ended(a), endB = ended(b);
  if (endA !== endB) return endA ? 1 : -1;
  if (endA) return (b.finished_at || 0) - (a.finished_at || 0) || b.job - a.job;
  return b.priority - a.priority || RANK[a.state] - RANK[b.state] ||
    (a.queue_position || 1e9) - (b.queue_position || 1e9) || a.job - b.job;
}

/* Seconds since a worker's last status (it tells one every 5 s), if that is long; else 0. Between two events of
 * the list the page cannot know better. */
export const silentFor = (worker) => (worker.status && worker.status_age_s > 12 ? worker.status_age_s : 0);
