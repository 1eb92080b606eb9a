/* overlays: what can be seen over the picture tile by tile, its colours, and its legend. */

/* Okabe and Ito's colours for all eyes; later workers get them lighter and darker. */
const COLORS = [[230, 159, 0], [86, 180, 233], [0, 158, 115], [240, 228, 66], [0, 114, 178], [213, 94, 0], [204, 121, 167]];
const SHADES = [0, 0.3, -0.3, 0.55, -0.5];       /* towards white, towards black */

function shade(color, by) {
  return color.map((c) => Math.round(by >= 0 ? c + (255 - c) * by : c * (1 + by)));
}

/* A worker's colour; its threads are shades of it. */
export function workerColor(worker, thread = 0) {
  const color = shade(COLORS[worker % COLORS.length], SHADES[Math.floor(worker / COLORS.length) % SHADES.length] * 0.7);
  return thread > 0 ? shade(color, ((thread - 1) % 8 - 3.5) / 3.5 * 0.28) : color;
}

/* Viridis (van der Walt and Smith, CC0) at ten points. */
const VIRIDIS = ['440154', '482878', '3e4989', '31688e', '26828e', '1f9e89', '35b779', '6ece58', 'b5de2b', 'fde725']
  .map((hex) => [0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16)));

export function viridis(t) {
  const at = Math.min(Math.max(t, 0), 1) * (VIRIDIS.length - 1), i = Math.min(Math.floor(at), VIRIDIS.length - 2);
  return VIRIDIS[i].map((c, k) => Math.round(c + (at - i) * (VIRIDIS[i + 1][k] - c)));
}

export function ramp() {
  const out = new Uint8Array(256 * 4);
  for (let i = 0; i < 256; i++) out.set([...viridis(i / 255), 255], 4 * i);
  return out;
}

export const css = (color) => `rgb(${color.join(' ')})`;

const figure = (value, digits = 2) => Number(value.toPrecision(digits)).toLocaleString('en', { maximumSignificantDigits: 3 });
export const codesText = (codes) => `${figure(codes)}/255`;
export const secondsText = (s) => s >= 90 ? `${figure(s / 60)} min` : s >= 1 ? `${figure(s)} s` : `${figure(s * 1000)} ms`;
export const samplesText = (n) => n >= 10 ? String(Math.round(n)) : figure(n);

/* What each shows: value(tile number, of) -> number or undefined; `of`: {pixels, map (the API's tiles, or null)}. */
export const OVERLAYS = {
  none: { text: 'picture' },
  workers: { text: "workers' tiles", needsMap: true },
  samples: { text: 'samples a pixel', value: (i, of) => of.pixels.samples[i] || undefined, show: samplesText },
  error: { text: 'error by tile', needsMap: true, value: (i, of) => of.map?.tiles[i]?.error, show: codesText },
  pixels: { text: 'error by pixel', codes: [0.25, 32], show: codesText },
  fireflies: { text: 'fireflies', marks: true, needsMap: true },
  time: { text: 'time by tile', needsMap: true, value: (i, of) => of.map?.tiles[i]?.cpu_ns / 1e9, show: secondsText },
};

/* ---- marks: fireflies, and the worst parts ---- */

const FIREFLY_CODES = 24, FIREFLY_SPREADS = 8;

/* Pixels that stand out of their neighbourhood by noise, [x, y], by the rule of common/accuracy/fireflies.h: `mean` are the
 * codes of the picture (ImageData), `darker` the same less one standard error, which is the darker of its two groups. */
export function findFireflies(mean, darker) {
  const { width, height, data } = mean, found = [], around = [];
  const code = (pixels, p) => Math.max(pixels[4 * p], pixels[4 * p + 1], pixels[4 * p + 2]);
  for (let y = 0; y < height; y++)
    for (let x = 0; x < width; x++) {
      const p = y * width + x, shown = code(data, p), dark = code(darker.data, p);
      if (shown - dark < FIREFLY_CODES) continue;
      around.length = 0;
      for (let v = Math.max(y - 1, 0); v <= Math.min(y + 1, height - 1); v++)
        for (let u = Math.max(x - 1, 0); u <= Math.min(x + 1, width - 1); u++) if (u !== x || v !== y) around.push(code(data, v * width + u));
      around.sort((a, b) => a - b);
      const n = around.length, median = n ? (around[(n - 1) >> 1] + around[n >> 1]) / 2 : 0, above = shown - median;
      const spread = around.reduce((sum, c) => sum + Math.abs(c - median), 0) / Math.max(n, 1);
      if (n && above >= FIREFLY_CODES && above >= FIREFLY_SPREADS * spread && dark - median < above / 2) found.push([x, y]);
    }
  return found;
}

/* The tiles whose error is beyond that of 99 % of them: the worst parts. */
export function worstTiles(map) {
  const errors = (map?.tiles || []).map((t) => t.error).filter((e) => e > 0 && e < Infinity).sort((a, b) => a - b);
  if (!errors.length) return [];
  const least = errors[Math.min(Math.floor(0.99 * errors.length), errors.length - 1)];
  return map.tiles.flatMap((t, i) => (t.error >= least ? [i] : []));
}

/* Whose a tile is, {worker, thread}: who sent most of its samples, as `azulejo owners` says (FrameTile.shares). */
export const ownerOf = (tile) => tile.shares?.[0] || tile;

/* Colours of all tiles, RGBA, and what the legend says: {tiles, range: [low, high] | workers: [{name, color, tiles}]}.
 * `order`: names of workers in the order in which they came to the job; it grows. */
export function paint(name, of, order) {
  const overlay = OVERLAYS[name], tiles = new Uint8Array(of.pixels.tiles * 4);
  if (name === 'workers') return { tiles, workers: paintWorkers(tiles, of, order) };
  if (!overlay.value) return { tiles, range: overlay.codes, marks: overlay.marks };
  let low = Infinity, high = 0;
  const values = Array.from({ length: of.pixels.tiles }, (_, i) => {
    const value = overlay.value(i, of);
    if (!(value > 0 && value < Infinity)) return 0;
    low = Math.min(low, value);
    high = Math.max(high, value);
    return value;
  });
  const span = Math.log(high / low) || 1;
  values.forEach((value, i) => value > 0 && tiles.set([...viridis(high > low ? Math.log(value / low) / span : 0.5), 255], 4 * i));
  return { tiles, range: high > 0 ? [low, high] : null };
}

function paintWorkers(tiles, { map }, order) {
  if (!map) return [];
  const places = (map.workers || []).map(({ name }) => {
    if (!order.includes(name)) order.push(name);
    return order.indexOf(name);
  });
  const counts = new Map();
  map.tiles.forEach((tile, i) => {
    const { worker, thread } = ownerOf(tile);
    if (!(worker > 0) || 4 * i >= tiles.length) return;
    const place = places[worker - 1] ?? 0;
    tiles.set([...workerColor(place, thread), 255], 4 * i);
    counts.set(place, (counts.get(place) || 0) + 1);
  });
  return [...counts].sort((a, b) => b[1] - a[1]).map(([place, count]) => (
    { name: order[place], color: workerColor(place), tiles: count }));
}

/* The one place for legends. */
export function legend(element, name, { range, workers, marks, found }, note) {
  const overlay = OVERLAYS[name], parts = [];
  const add = (tag, className, text) => {
    const node = document.createElement(tag);
    node.className = className;
    if (text) node.textContent = text;
    parts.push(node);
    return node;
  };
  if (workers) {
    for (const worker of workers.slice(0, 12)) {
      add('i', 'swatch').style.background = css(worker.color);
      add('span', '', `${worker.name} ${worker.tiles}`);
    }
    if (workers.length > 12) add('span', '', `and ${workers.length - 12} more`);
    if (workers.length === 0) add('span', 'quiet', 'no tile yet');
  } else if (range) {
    add('span', '', overlay.show(range[0]));
    add('i', 'ramp').style.background = `linear-gradient(to right, ${VIRIDIS.map(css).join()})`;
    add('span', '', overlay.show(range[1]));
  } else if (marks) {
    add('i', 'ring');
    add('span', 'fireflies', found || 'being looked for');
    add('i', 'part');
    add('span', '', 'worst parts');
  } else if (name !== 'none') add('span', 'quiet', 'not known yet');
  if (note) add('span', 'quiet', note);
  element.replaceChildren(...parts);
}
