/* router: the address is the state. "#/job/12/frame/3", "#/worker/NAME", "#/submit", ... */
const names = new Set(['workers', 'worker', 'events', 'store', 'access', 'submit']);
let take = () => {};

export function parse(hash = location.hash) {
  const parts = hash.replace(/^#\/?/, '').split('/').map((p) => { try { return decodeURIComponent(p); } catch { return p; } });
  if (parts[0] === 'job' && /^\d+$/.test(parts[1] || ''))
    return { view: 'farm', job: Number(parts[1]), frame: parts[2] === 'frame' && /^\d+$/.test(parts[3] || '') ? Number(parts[3]) : 0 };
  if (names.has(parts[0])) return { view: parts[0], name: parts[1] || '' };
  return { view: 'farm', job: 0, frame: 0 };
}
export const jobLink = (job, frame) => `#/job/${job}${frame ? `/frame/${frame}` : ''}`;
export const workerLink = (name) => `#/worker/${encodeURIComponent(name)}`;

/* `instead`: the page before is not one to go back to. */
export function go(hash, instead) {
  if (hash === location.hash) return;
  history[instead ? 'replaceState' : 'pushState'](null, '', hash);
  take(parse());
}
export function beginRouter(fn) {
  take = fn;
  addEventListener('hashchange', () => take(parse()));
  take(parse());
}
