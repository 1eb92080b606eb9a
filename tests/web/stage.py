"""The page's own modules without a coordinator: a site that serves them, made-up pictures, and a context that
answers as the API does."""
import http.server
import json
import os
import random
import struct
import threading

from farm import ROOT

ASSETS = os.path.join(ROOT, "web", "assets")
TYPES = {"js": "text/javascript", "css": "text/css", "html": "text/html", "svg": "image/svg+xml"}
POLICY = "default-src 'self'; img-src 'self' blob:"
NOTHING = """<!doctype html><html lang="en"><meta charset="utf-8"><title>stage</title>
<link rel="icon" href="/icon"><link rel="stylesheet" href="/assets/style.css"><link rel="stylesheet" href="/assets/picture.css"><link rel="stylesheet" href="/stage.css">
<main id="picture"></main><aside id="cost"></aside><aside id="effects"></aside>"""

STYLE = """#picture { position: fixed !important; inset: 0 auto auto 0; width: 900px; height: 640px }
aside { position: fixed; left: 916px; width: 320px; top: 8px }
aside + aside { top: 420px }"""


class Stage(http.server.ThreadingHTTPServer):
    """answers: path below / -> (type, bytes), beside the assets."""

    daemon_threads = True

    def __init__(self, answers=None):
        self.answers = dict(answers or {})
        super().__init__(("127.0.0.1", 0), Answering)
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def url(self, path="/"):
        return "http://127.0.0.1:%d%s" % (self.server_port, path)

    def __exit__(self, *_):
        self.shutdown()
        self.server_close()


class Answering(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        path = self.path.split("?")[0]
        kind, data = self.server.answers.get(path, (None, None))
        name = os.path.join(ASSETS, *path.split("/")[2:])
        if path == "/":
            kind, data = "text/html", NOTHING.encode()
        elif path == "/stage.css":
            kind, data = "text/css", STYLE.encode()
        elif path == "/icon":
            kind, data = "image/svg+xml", b"<svg xmlns='http://www.w3.org/2000/svg'/>"
        elif data is None and path.startswith("/assets/") and os.path.exists(name):
            kind, data = TYPES[name.rsplit(".", 1)[1]], open(name, "rb").read()
        self.send_response(200 if data is not None else 404)
        self.send_header("Content-Type", kind or "text/plain")
        self.send_header("Content-Security-Policy", POLICY)
        self.end_headers()
        self.wfile.write(data if data is not None else b"no such page")

    def log_message(self, *_):
        pass


def half(value):
    return struct.unpack("<e", struct.pack("<e", value))[0]


class Light:
    """A picture of half floats: rows[y][x] = (r, g, b, standard error)."""

    def __init__(self, width, height, pixel):
        self.width, self.height = width, height
        self.rows = [[tuple(half(v) for v in pixel(x, y)) for x in range(width)] for y in range(height)]

    def exr(self):
        """The bytes of an uncompressed OpenEXR file of it."""
        def attribute(name, kind, value):
            return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value
        channels = b"".join(c + b"\0" + struct.pack("<iBxxxii", 1, 0, 1, 1) for c in (b"B", b"G", b"R")) + b"\0"
        window = struct.pack("<4i", 0, 0, self.width - 1, self.height - 1)
        head = struct.pack("<II", 20000630, 2) + attribute("channels", "chlist", channels) + \
            attribute("compression", "compression", b"\0") + attribute("dataWindow", "box2i", window) + \
            attribute("displayWindow", "box2i", window) + attribute("lineOrder", "lineOrder", b"\0") + \
            attribute("pixelAspectRatio", "float", struct.pack("<f", 1)) + \
            attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)) + \
            attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0"
        lines = [struct.pack("<ii", y, 6 * self.width) +
                 b"".join(struct.pack("<%de" % self.width, *(p[c] for p in row)) for c in (2, 1, 0))
                 for y, row in enumerate(self.rows)]
        begin = len(head) + 8 * self.height
        offsets = [struct.pack("<Q", begin + y * len(lines[0])) for y in range(self.height)]
        return head + b"".join(offsets) + b"".join(lines)

    def tiles(self, watch=1, samples=lambda tile: 16, wanted=None):
        """One "AZL1" message with its tiles."""
        across, down, body, count = (self.width + 15) // 16, (self.height + 15) // 16, b"", 0
        for tile in range(across * down) if wanted is None else wanted:
            x, y = tile % across * 16, tile // across * 16
            rows = [row[x:x + 16] for row in self.rows[y:y + 16]]
            body += struct.pack("<IHHI", tile, len(rows[0]), len(rows), int(256 * samples(tile)))
            body += b"".join(struct.pack("<%de" % (4 * len(row)), *(v for p in row for v in p)) for row in rows)
            count += 1
        return b"AZL1" + struct.pack("<II", watch, count) + body


def wild_light(width, height, seed=1):
    """All that is difficult: twenty octaves, saturated colours, black, a sun."""
    random.seed(seed)

    def pixel(x, y):
        level = 2.0 ** random.uniform(-12, 5)
        color = [level * random.choice((1.0, 1.0, random.random(), 0.02, 0.0)) for _ in range(3)]
        if (x, y) == (3, 2):
            color = [3000.0, 2500.0, 900.0]
        if y == height - 1:
            color = [2.0 ** (-14 + 20 * x / width)] * 3  # greys
        return (*color, 0.1 * level)
    return Light(width, height, pixel)


# What shell's context.js is for the parts, without a coordinator. `stage` is what a test reads and changes.
CONTEXT = """(async () => {
  const listeners = new Map(), waiting = new Set();
  const stage = window.stage = {job: 1, frame: 1, said: [], acted: [], asked: [], answers: %s, watches: []};
  stage.emit = (event, data) => (listeners.get(event) || []).forEach(fn => fn(data));
  stage.info = %s;
  stage.send = base64 => { const watch = stage.watches.at(-1);
    watch.to.tiles(Uint8Array.from(atob(base64), c => c.charCodeAt(0)).buffer); };
  stage.begin = data => stage.watches.at(-1).to.picture(data);
  const get = async path => {
    stage.asked.push(path);
    const found = stage.answers[path.split('?')[0]];
    if (found === undefined) throw new Error('There is no ' + path + '.');
    return structuredClone(found);
  };
  stage.context = {
    api: {get, url: p => '/api/v1' + p, put: async () => '', ask: async p => { stage.asked.push(p);
      const r = await fetch('/api/v1' + p); if (!r.ok) throw new Error('It is not there.'); return r; }},
    live: {watch(want, to) { const w = {want, to}; stage.watches.push(w);
      return () => stage.watches.splice(stage.watches.indexOf(w), 1); }},
    state: {}, job: () => stage.job, frame: () => stage.frame, info: () => stage.info,
    shownFrame: () => stage.frame || 1, may: () => true, act: async (...what) => { stage.acted.push(what); return true; },
    say: w => stage.said.push(w), trouble: e => stage.said.push(e.message), tell: w => stage.said.push(w),
    frameLoop(fn) { if (!waiting.size) requestAnimationFrame(() => { const now = [...waiting]; waiting.clear(); now.forEach(f => f()); });
      waiting.add(fn); },
    on(event, fn) { (listeners.get(event) || listeners.set(event, new Set()).get(event)).add(fn);
      return () => listeners.get(event).delete(fn); },
    keys(map) { stage.keys = {...stage.keys, ...map}; return () => {}; },
  };
  for (const [id, file, mount] of [['picture', 'picture', 'mountPicture'], ['cost', 'job/cost', 'mountCost'], ['effects', 'job/effects', 'mountEffects']]) {
    const module = await import('/assets/' + file + '.js');
    stage[id] = module[mount](document.getElementById(id), stage.context);
  }
  return true;
})()"""


def context(info, answers):
    return CONTEXT % (json.dumps(answers), json.dumps(info))
