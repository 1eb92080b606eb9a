/* live: one WebSocket for events and pictures. It comes back by itself and asks for what it missed.
 *
 *   closed --open--> open --lost--> waiting --timer, "online", page visible--> open ...
 */
const RETRY_MS = [250, 500, 1000, 2000, 4000];
const SILENCE_MS = 20000;             /* then it is asked whether it is still there */
const HEALTH_MS = 5000;
const HIDDEN_MS = 10000;              /* a page that is hidden for so long watches no picture */

const handlers = { event() {}, connection() {} };
const watches = new Map();            /* serial -> {want, to} */
let socket = null, last = null, serial = 0, tries = 0, timer = 0, silence = 0, ended = true, hiding = 0, asleep = false;

function send(message) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function request(number, { job, frame, layer }) {
  send({ watch: number, job, frame: frame || 0, layer: layer || 'color' });
}

function take(text) {
  const { id, event, data } = JSON.parse(text);
  if (id) last = id;
  const watch = data && watches.get(data.watch);
  if (event === 'picture') watch && watch.to.picture && watch.to.picture(data);
  else if (event === 'picture-done') watch && watch.to.done && watch.to.done(data);
  else handlers.event(event, data);
}

function takeTiles(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < 12 || view.getUint32(0) !== 0x415a4c31) return;
  const watch = watches.get(view.getUint32(4, true));
  if (watch && watch.to.tiles) watch.to.tiles(buffer, view.getUint32(8, true));
}

/* A connection may be dead without a word: a machine that sleeps, a pulled cable. */
async function look(mine) {
  try {
    await fetch('/healthz', { cache: 'no-store', signal: AbortSignal.timeout(HEALTH_MS) });
    silence = setTimeout(() => look(mine), SILENCE_MS);
  } catch { mine.close(); if (socket === mine) mine.onclose(); }
}

/* The coordinator knows nothing of a watch any more: new numbers, so that late tiles of the old one are dropped. */
function ask() {
  const wanted = [...watches.values()];
  watches.clear();
  for (const watch of wanted) {
    watch.serial = ++serial;
    watches.set(serial, watch);
  }
  const newest = wanted.at(-1);
  if (newest) request(newest.serial, newest.want);
}

function open() {
  clearTimeout(timer);
  if (ended || (socket && socket.readyState <= WebSocket.OPEN)) return;
  const mine = new WebSocket(location.origin.replace(/^http/, 'ws') + '/api/v1/live');
  socket = mine;
  mine.binaryType = 'arraybuffer';
  mine.onopen = () => {
    tries = 0;
    silence = setTimeout(() => look(mine), SILENCE_MS);
    send({ resume: last });
    handlers.connection('open', last === null);
    ask();
  };
  mine.onmessage = ({ data }) => {
    clearTimeout(silence);
    silence = setTimeout(() => look(mine), SILENCE_MS);
    if (socket !== mine) return;
    if (typeof data === 'string') take(data); else takeTiles(data);
  };
  mine.onclose = () => {
    if (socket !== mine) return;
    socket = null;
    clearTimeout(silence);
    if (ended) return;
    handlers.connection('lost');
    timer = setTimeout(open, RETRY_MS[Math.min(tries++, RETRY_MS.length - 1)]);
  };
}

addEventListener('online', open);
/* The tiles of a hidden page are not seen. */
function sleep() {
  if (socket && watches.size) { send({ watch: 0 }); asleep = true; }
}
function wake() {
  clearTimeout(hiding);
  open();
  if (asleep) { asleep = false; ask(); }
}
document.addEventListener('visibilitychange', () => { if (document.hidden) hiding = setTimeout(sleep, HIDDEN_MS); else wake(); });

export const live = {
  /* event(name, data) and connection("open" | "lost", first). */
  begin(to) { Object.assign(handlers, to); ended = false; open(); },
  end() { ended = true; last = null; if (socket) socket.close(); },
  /* As somebody else: the connection goes on in the name that it was begun with. */
  again() { if (socket) socket.close(); },
  /* Watch a frame: {job, frame (0: the one in work), layer}. Calls picture(data) first, and again after a lost
   * connection or when frame 0 becomes another frame; tiles(ArrayBuffer, count) for each "AZL1" message;
   * done(data). The coordinator sends one picture at a time: the newest watch. Returns stop(). */
  watch(want, to) {
    const watch = { want, to, serial: ++serial };
    watches.set(serial, watch);
    request(serial, want);
    return () => {
      watches.delete(watch.serial);
      const before = [...watches.values()].at(-1);
      if (before) request(before.serial, before.want); else send({ watch: 0 });
    };
  },
};
