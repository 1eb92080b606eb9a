/* context: what the page's parts share. main.js makes one; mountPicture, mountCost and mountEffects get it.
 *
 *   context.api      api.js: get(path), post(path, body), put, del; a refusal throws ApiError (its message is for people)
 *   context.live     live.js: watch({job, frame, layer}, {picture, tiles, done}) -> stop()
 *   context.state    state.js: job(number), jobs, workers, farm, session: plain JSON as the API sends it
 *   context.job()    number of the job that is shown; 0: none
 *   context.frame()  the frame that is shown; 0: the one in work (its number: shownFrame())
 *   context.info()   JobInfo of that job; undefined: not known (yet)
 *   context.shownFrame()
 *   context.may(role, job)  is this caller offered what needs the role; `job`: its own suffices with "submit"
 *   context.act(verb, numbers, body)  a verb of verbs.js ("extend", "develop", ...): asks what it must, reports refusals; -> done?
 *   context.say(text, undo)  a line for people, with a button if `undo` is a function
 *   context.trouble(error)   the same for a refusal
 *   context.tell(text)       for screen readers only
 *   context.frameLoop(fn)    fn once in the next animation frame, however often it is asked for
 *   context.on(event, fn) -> off()
 *       "select"      another job or frame is shown
 *       "job"         the shown job's JobInfo changed
 *       "workers"     the list of workers changed
 *       "connection"  fn("open" | "lost" | "blocked": requests get through, WebSockets do not)
 *       "theme"       fn("dark" | "light")
 *   context.keys(map, where)  keys of a part for the help and for keys.js: {"e": {text: "exposure up", run}}
 *
 * Elements are shown and hidden by CSS: a part must cope with an element of no size (ResizeObserver).
 */
import { state } from './state.js';
import * as api from './api.js';
import { live } from './live.js';
import { addKeys } from './keys.js';
import { say, trouble, tell } from './notice.js';
import { may, act } from './verbs.js';

const listeners = new Map();

export function emit(event, data) {
  /* A part that fails must not keep the others from what happened. */
  for (const fn of [...(listeners.get(event) || [])])
    try { fn(data); } catch (why) { reportError(why); }
}

const waiting = new Set();
function frameLoop(fn) {
  if (waiting.size === 0) requestAnimationFrame(() => {
    const now = [...waiting];
    waiting.clear();
    for (const run of now) run();
  });
  waiting.add(fn);
}

export const context = {
  api, live, state, say, trouble, tell, may, act, frameLoop,
  shown: { job: 0, frame: 0 },
  job() { return this.shown.job; },
  frame() { return this.shown.frame; },
  info() { return state.job(this.shown.job); },
  shownFrame() {
    const info = this.info(), { frame } = this.shown;
    if (!info) return frame;
    const isThere = frame >= info.first_frame && frame <= info.last_frame; /* a link may name one that is not */
    return frame && isThere ? frame : info.preview_frame || info.now_frame || info.first_frame;
  },
  on(event, fn) {
    if (!listeners.has(event)) listeners.set(event, new Set());
    listeners.get(event).add(fn);
    return () => listeners.get(event).delete(fn);
  },
  keys: addKeys,
};
