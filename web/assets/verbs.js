/* verbs: everything that can be done to jobs and workers, under the names of azulejo's commands. The coordinator
 * says which a job offers now, and checks each of them again.
 *
 * Verbs that lose nothing ask nothing, and offer the way back. The others say what is lost.
 */
import { get, post } from './api.js';
import { state, takeAnswer, load, loadJob } from './state.js';
import { say, trouble } from './notice.js';
import { confirm, form } from './dialog.js';
import { frameList, errorTarget, milliseconds, target, isolated } from './format.js';

const ROLES = ['none', 'view', 'submit', 'operate', 'admin'];
const rank = (role) => ROLES.indexOf(role);
export const owns = (job) => !!state.session && job.owner === state.session.who;

/* Is this caller offered what needs the role? For a job of its own, "submit" suffices. */
export function may(role, job) {
  const mine = rank(state.session ? state.session.role : 'none');
  return mine >= rank(role) || (!!job && mine >= rank('submit') && owns(job));
}

const names = (jobs) => (jobs.length === 1 ? isolated(jobs[0].name) : `${jobs.length} jobs`);

/* What the page adds to the verbs that the coordinator lists (state.verbs): the way back, undo(jobs, body) -> [verb, body], and
 * ask(jobs, send): asks for what one field does not hold, and then gives send the body; null or false: nothing was asked for. */
const more = {
  pause: { undo: () => ['resume'] },
  resume: { undo: (jobs) => jobs.every((j) => j.state === 'paused') && ['pause'] },
  priority: { undo: (jobs) => jobs.length === 1 && ['priority', { priority: jobs[0].priority }] },
  'retry-frames': { ask: askFrames },
  extend: { ask: askExtend },
  develop: { ask: askDevelop },
  cancel: { undo: () => ['retry'], undoName: 'Retry' },
  remove: { lost: (jobs) => jobs.reduce((n, j) => n + (j.frames_done || 0), 0) },
};
const find = (name) => state.verbs.has(name) && { ...state.verbs.get(name), ...more[name] };

/* Asks what the verb has to know, or says what is lost. */
function ask(verb, jobs, send) {
  if (verb.ask) return verb.ask(jobs, send);
  if (verb.question) {
    const frames = verb.lost ? verb.lost(jobs) : 0;
    return confirm(`${verb.label} ${names(jobs)}?`, [verb.question, ...(frames ? [`Finished frames whose pictures are lost: ${frames}.`] : [])],
      verb.button).then((yes) => yes && send({}));
  }
  if (verb.takes !== 'number' && verb.takes !== 'text') return send({});
  const number = verb.takes === 'number', value = jobs[0][verb.field];
  return form(`${verb.label}: ${names(jobs)}`, [verb.says], [{
    name: verb.field, label: verb.field[0].toUpperCase() + verb.field.slice(1), type: verb.takes, step: 1, value: String(value ?? ''), required: number,
  }], verb.button, (v) => ({ [verb.field]: number ? Math.trunc(Number(v[verb.field])) : v[verb.field] }), send);
}
async function askFrames([job], send) {
  return form(`Frames of ${names([job])} to render again`, [
    'They go on from their films where these are kept; a lost picture is made again without rendering.'],
  [{ name: 'frames', label: 'Frames', value: `${job.first_frame}-${job.last_frame}`, hint: 'as in 1,5,10-100x10', required: true }],
  'Retry these frames', (v) => ({ frames: frameList(v.frames) }), send);
}
async function askExtend([job], send) {
  const isDone = job.state === 'done';
  return form(`Extend ${names([job])}`, [isDone ? 'Rendering goes on from the films that are kept. Give one of these, or both.'
    : 'The new rules replace those that it has. Give one of these, or both.'], [
    { name: 'error', label: 'Error to reach', value: target(job.stop), hint: 'as in 2/255, 1% or 45dB' },
    { name: 'spp', label: 'Samples a pixel, at most', type: 'number', min: 1, value: job.stop?.target > 0 ? '' : String(2 * (job.settings?.spp || 128)) },
    { name: 'time', label: 'Time limit a frame', hint: 'as in 10m; empty: none' },
    ...(isDone ? [{ name: 'frames', label: 'Frames', hint: 'as in 1,5,10-20; empty: all' }] : []),
  ], 'Extend', (v) => {
    const body = {}, stop = {};
    if (v.error) Object.assign(stop, errorTarget(v.error), { adaptive: true });
    if (v.time) Object.assign(stop, { time_limit_ms: milliseconds(v.time), adaptive: true });
    if (v.spp) body.spp = Number(v.spp);
    if (v.frames) body.frames = frameList(v.frames);
    if (Object.keys(stop).length) body.stop = stop;
    if (!body.spp && !body.stop) throw new Error('Say how many samples, or which error is to be reached.');
    return body;
  }, send);
}
async function askDevelop([job], send) {
  let operators = [];
  try { operators = listOf(await get('/operators'), 'operators').map((o) => o.name); } catch (why) { trouble(why); return null; }
  const output = job.output || {};
  return form(`Develop ${names([job])} again`, ['The pictures of all frames are made again; nothing is rendered. The picture’s own controls do this, too.'], [
    { name: 'tonemap', label: 'Operator', value: output.tonemap, options: operators.map((n) => [n, n]) },
    { name: 'exposure_ev', label: 'Exposure, in stops', type: 'number', step: 'any', value: String(output.exposure_ev || 0) },
    { name: 'white_kelvin', label: 'White balance, in kelvin', type: 'number', step: 'any', min: 0, value: output.white_kelvin ? String(output.white_kelvin) : '', hint: 'empty: colours as they are' },
  ], 'Develop', (v) => ({
    output: {
      ...output, tonemap: v.tonemap, exposure_ev: Number(v.exposure_ev) || 0, white_kelvin: Number(v.white_kelvin) || 0,
      parameters: v.tonemap === output.tonemap ? output.parameters || {} : {},
    },
  }), send);
}
/* A list that is the answer, or below this name in it. */
export const listOf = (answer, name) => (Array.isArray(answer) ? answer : answer[name] || []);

const allows = (verb, job) => job.verbs.includes(verb.name) && may(verb.role, job);
/* The verbs that have a chance with all of these jobs. */
export function offered(jobs) {
  if (!jobs.length) return [];
  return [...state.verbs.values()].filter((v) => (!v.single || jobs.length === 1) && jobs.every((j) => allows(v, j)));
}

/* A cancelled job still makes its pictures: what undoes that waits for it. */
async function settled(numbers) {
  if (numbers.some((n) => state.job(n)?.state === 'cancelling')) say('It follows when the pictures are made.');
  for (let i = 0; i < 600 && numbers.some((n) => state.job(n)?.state === 'cancelling'); i++) await new Promise((done) => setTimeout(done, 200));
}

const GONE = 'There is no such job any more: it was removed.';

/* Sends it to all of these jobs, and says what became of it. Throws if no job took it; resolves with whether all did. */
async function deliver(verb, jobs, given, quiet) {
  const before = jobs.map((j) => ({ ...j })), body = { ...(verb.takes === 'flag' && { [verb.field]: true }), ...given }, failed = [], rest = [...jobs];
  await Promise.all(Array.from({ length: 6 }, async () => {
    for (let job; (job = rest.shift());)
      try { takeAnswer(await post(`/jobs/${job.job}/${verb.path}`, body)); } catch (why) { failed.push([job, why]); }
  }));
  const [first] = failed;
  if (first && jobs.length === 1) throw first[1];
  const why = first && new Error(`${failed.length} of ${jobs.length} jobs refused it. ${names([first[0]])}: ${first[1].message}`);
  const done = before.filter((j) => !failed.some(([f]) => f.job === j.job));
  if (!done.length) throw why;
  if (why) trouble(why);
  if (!quiet) {
    const back = verb.undo && verb.undo(done, body);
    const numbers = done.map((j) => j.job);
    say(`${names(done)}: ${verb.done}.`, back ? () => settled(numbers).then(() => act(back[0], numbers, back[1] || {}, true)) : undefined, verb.undoName);
  }
  return !why;
}

/* A verb, for one job or several. `body`: what it would ask for. Resolves with whether all of it was done. */
export async function act(name, numbers, body, quiet) {
  if (!state.verbs.size) await load().catch(() => {}); /* the page has just been opened */
  const verb = find(name), wanted = [numbers].flat();
  let jobs = wanted.map(state.job).filter(Boolean);
  if (!verb || !wanted.length) return false;
  /* What the page knows may be a moment old: an answer can overtake an event. */
  const doubted = jobs.filter((j) => may('operate', j) && !allows(verb, j));
  await Promise.all(doubted.map((j) => loadJob(j.job).catch(() => {})));
  jobs = jobs.map((j) => state.job(j.job)).filter(Boolean);
  const unfit = jobs.filter((j) => !allows(verb, j));
  if (unfit.length || !jobs.length) {
    if (!unfit.length) trouble(new Error(GONE));
    else trouble(new Error(!may('operate', unfit[0])
      ? `Your token may not ${verb.path} jobs of others: it has the role “${state.session?.role}”.`
      : `${verb.label} is not possible for ${names(unfit)}: ${unfit.length === 1 ? 'it is' : 'some are'} ${unfit[0].state}.`));
    return false;
  }
  const run = (given) => deliver(verb, jobs, given, quiet);
  try {
    return !!await (body === undefined ? ask(verb, jobs, run) : run(body));
  } catch (why) {
    trouble(why);
    return false;
  }
}

/* ---- order ------------------------------------------------------------------------------------ */

/* The farm orders by priority, then by owner and submission. What has to change so that `moved` stands at `place`
 * of this list (its order without the moved job): [[job, priority], ...]. */
export function prioritiesFor(list, moved, place) {
  const rest = list.filter((j) => j !== moved);
  const wanted = new Map();
  const of = (j) => (wanted.has(j) ? wanted.get(j) : j.priority);
  /* At the same priority only jobs of one owner keep the order of their submission. */
  const least = (above, below) => of(below) + (above.owner === below.owner && above.job < below.job ? 0 : 1);
  const above = rest[place - 1], below = rest[place];
  let now = moved.priority;
  if (above) now = Math.min(now, of(above) - (above.owner === moved.owner && above.job < moved.job ? 0 : 1));
  if (below) now = Math.max(now, least(moved, below));
  if (now !== moved.priority) wanted.set(moved, now);
  let under = moved;
  for (let i = place - 1; i >= 0; i--) {
    const need = least(rest[i], under);
    if (of(rest[i]) >= need) break;
    wanted.set(rest[i], need);
    under = rest[i];
  }
  return [...wanted];
}
export async function reorder(list, moved, place) {
  const changed = prioritiesFor(list, moved, place);
  if (!changed.length) {
    say(`${isolated(moved.name)} has that place already; jobs that are paused are listed after those that wait.`);
    return;
  }
  const others = changed.find(([j]) => !may('operate', j));
  if (others) {
    trouble(new Error(`${isolated(others[0].name)} is not yours: your token may only move your own jobs.`));
    return;
  }
  const before = changed.map(([j]) => [j.job, j.priority]);
  const all = (pairs) => Promise.all(pairs.map(([number, priority]) => act('priority', number, { priority }, true)));
  const fine = await all(changed.map(([j, p]) => [j.job, p]));
  if (fine.every(Boolean))
    say(`${changed.map(([j, p]) => `${isolated(j.name)}: priority ${p}`).slice(0, 3).join(', ')}${changed.length > 3 ? ` and ${changed.length - 3} more` : ''}.`, () => all(before));
}

/* ---- workers ---------------------------------------------------------------------------------- */

export const workerVerbs = {
  drain: { states: ['idle', 'working', 'paused'], done: 'gets no more work, and finishes what it has', undo: 'resume' },
  resume: { states: ['draining', 'drained'], done: 'gets work again', undo: 'drain' },
  block: { states: ['idle', 'working', 'paused', 'draining', 'drained', 'leaving', 'gone'], done: 'blocked: its work goes to others', undo: 'unblock' },
  unblock: { states: ['blocked'], done: 'gets work again', undo: 'block' },
};
export const workerOffers = (worker) => (may('operate') ? Object.keys(workerVerbs).filter((v) => workerVerbs[v].states.includes(worker.state)) : []);
/* The name that was blocked: the worker's own, or that of its key, which blocks all of its workers. */
async function blockedName(name) {
  const blocked = ((await get(`/workers/${encodeURIComponent(name)}`)).marks || []).filter((m) => m.blocked).map((m) => m.name);
  return blocked.includes(name) ? name : blocked[0] || name;
}
export async function steer(verb, name, quiet) {
  try {
    const whom = verb === 'unblock' ? await blockedName(name) : name;
    await post(`/workers/${encodeURIComponent(whom)}/${verb}`);
    const { done, undo } = workerVerbs[verb];
    if (!quiet) say(`${whom === name ? name : `all workers of the key ${whom}`}: ${done}.`, () => steer(undo, whom, true));
  } catch (why) { trouble(why); }
}
