/* pixels: a frame's linear pixels as they arrive by tiles, and what is measured of the whole picture.
 *
 * Half floats, RGBA: linear radiance, and the standard error of the luminance. What operators must know of the
 * picture is kept up to date tile by tile, in double, as common/tonemap/statistics.c measures it. A percentile is
 * exact to one part in 4096: values are counted by the upper bits of their floats.
 *
 * A picture of 8K takes 265 MB: a line of tiles is written to only when its first tile comes.
 */
import { WEIGHTS, IDENTITY } from './color.js';

export const TILE = 16;
/* Red of a pixel that has no samples yet. No light is that, and no normal. */
export const NOTHING = 0xfbff; /* -65504 */

const floats = new Float32Array(65536);
for (let i = 0; i < 65536; i++) {
  const exponent = (i >> 10) & 31, part = i & 1023;
  floats[i] = (i & 0x8000 ? -1 : 1) * (exponent === 0 ? part * 2 ** -24
    : exponent === 31 ? (part ? NaN : Infinity) : (1 + part / 1024) * 2 ** (exponent - 15));
}
export const halfToFloat = (half) => floats[half];

/* Calls fn({tile, width, height, samples, halves}) for each tile of an "AZL1" message. A message that is cut
 * short, or whose tiles are no tiles, is an error. */
export function eachTile(buffer, fn) {
  const view = new DataView(buffer), count = view.getUint32(8, true);
  let at = 12;
  for (let i = 0; i < count; i++) {
    const width = view.getUint16(at + 4, true), height = view.getUint16(at + 6, true);
    const size = width * height * 4;
    if (width > TILE || height > TILE) throw new RangeError(`a tile of ${width} x ${height} pixels`);
    fn({ tile: view.getUint32(at, true), width, height, samples: view.getUint32(at + 8, true) / 256,
      halves: new Uint16Array(buffer, at + 12, size) });
    at += 12 + size * 2;
  }
}

/* Bins of positive floats from 2^-60 on: 2048 an octave. */
const BINS = 2048 * 120, FIRST_BIN = (127 - 60) << 11;
const oneFloat = new Float32Array(1), itsBits = new Uint32Array(oneFloat.buffer);

function binOf(value) {
  oneFloat[0] = value;
  return Math.min(Math.max((itsBits[0] >>> 12) - FIRST_BIN, 0), BINS - 1);
}

function valueOf(bin, middle) {
  itsBits[0] = (bin + FIRST_BIN) << 12 | (middle ? 0x800 : 0);
  return oneFloat[0];
}

/* log2 in steps of 2^-12, within .09; and a value of it. */
function roughLog(value) {
  oneFloat[0] = value;
  return itsBits[0] >>> 11;
}

function valueOfLog(log) {
  itsBits[0] = log << 11;
  return oneFloat[0];
}

/* The nearest rank, as statistics.c finds it. */
function percentileOf(bins, percent, middle) {
  let total = 0;
  for (let i = 0; i < BINS; i++) total += bins[i];
  if (total === 0) return 0;
  let rank = Math.min(Math.floor(percent / 100 * (total - 1) + 0.5), total - 1);
  for (let i = 0; i < BINS; i++) {
    if (rank < bins[i]) return valueOf(i, middle);
    rank -= bins[i];
  }
  return 0;
}

/* The log-mean is that of the means of 9x9 pixels around those that are lit; a pixel counts at most as 2^6 times the
 * log-mean of those around it. statistics.c says why. It is measured by cells of tiles, with what their windows reach. */
const REACH = 4, SIDE = 2 * REACH + 1, MARGIN = 2 * REACH, BRIGHTEST = 6 << 12;
const CELL = 4 * TILE, AREA = CELL + 2 * MARGIN;
const light = new Float64Array(AREA * AREA), lines = new Float64Array(AREA * AREA);
/* Of a pixel, of a column, of a window: the sum of log2 in steps of 2^-12 (20 bits each), how many are lit, how many are there. */
const LIT = 2 ** 28, THERE = 2 ** 35;
const packed = new Float64Array(AREA * AREA), columns = new Float64Array(AREA);
const there = new Uint8Array(AREA * AREA); /* in a pixel's window */

/* light[] as far as windows are within the area: limited, and there[]. */
function limitLight() {
  columns.fill(0);
  for (let y = 0; y < AREA; y++) {
    const middle = y - REACH;
    for (let x = 0; x < AREA; x++) columns[x] += packed[y * AREA + x] - (y < SIDE ? 0 : packed[(y - SIDE) * AREA + x]);
    if (middle < REACH) continue;
    let sum = 0;
    for (let x = 0; x < SIDE - 1; x++) sum += columns[x];
    for (let x = REACH, i = middle * AREA + REACH; x < AREA - REACH; x++, i++) {
      sum += columns[x + REACH];
      const pixels = Math.floor(sum / THERE), lit = Math.floor((sum - pixels * THERE) / LIT), log = sum - pixels * THERE - lit * LIT;
      there[i] = pixels;
      if (light[i] > 0 && (packed[i] - THERE - LIT - BRIGHTEST) * lit > log) light[i] = valueOfLog(Math.floor(log / lit) + BRIGHTEST);
      sum -= columns[x - REACH];
    }
  }
}

/* lines[] of the cell's columns: the sums of so many pixels around each in its line. */
function sumLines() {
  for (let y = REACH; y < AREA - REACH; y++)
    for (let i = y * AREA + MARGIN, end = (y + 1) * AREA - MARGIN; i < end; i++)
      lines[i] = light[i - 4] + light[i - 3] + light[i - 2] + light[i - 1] + light[i]
        + light[i + 1] + light[i + 2] + light[i + 3] + light[i + 4];
}

export class Pixels {
  constructor(width, height) {
    this.width = width;
    this.height = height;
    this.across = Math.ceil(width / TILE);
    this.down = Math.ceil(height / TILE);
    this.tiles = this.across * this.down;
    this.data = new Uint16Array(width * height * 4);
    this.whole = new BigUint64Array(this.data.buffer);  /* a pixel each */
    this.begun = new Uint8Array(this.down);       /* lines of tiles: has `data` something there? */
    this.samples = new Float64Array(this.tiles);  /* a pixel, mean over the tile */
    this.cellsAcross = Math.ceil(width / CELL);
    const cells = this.cellsAcross * Math.ceil(height / CELL);
    this.changed = new Uint8Array(cells);         /* since it was measured: */
    this.logs = new Float64Array(cells);          /* of a cell: sum of ln Y, */
    this.least = new Float64Array(cells);         /* smallest */
    this.most = new Float64Array(cells);          /* and largest Y of the pixels that count, */
    this.counts = new Uint32Array(cells);         /* and how many they are */
    this.balance = IDENTITY;
    this.clear();
  }

  clear() {
    this.begun.fill(0);
    for (const of of [this.samples, this.changed, this.logs, this.least, this.most, this.counts]) of.fill(0);
    this.arrived = 0;
    this.luminances = this.largest = null;        /* bins; null: not asked for */
    this.known = null;
  }

  /* A tile's place, or null. */
  place(tile) {
    if (!(tile >= 0 && tile < this.tiles)) return null;
    const x = tile % this.across * TILE, y = Math.floor(tile / this.across) * TILE;
    return { x, y, width: Math.min(TILE, this.width - x), height: Math.min(TILE, this.height - y) };
  }

  /* Pixels without samples in a line of tiles. */
  begin(line) {
    if (this.begun[line]) return;
    this.begun[line] = 1;
    const pixels = TILE * this.width;
    this.whole.fill(BigInt(NOTHING), line * pixels, Math.min((line + 1) * pixels, this.whole.length));
  }

  /* False: not a tile of this picture. */
  take({ tile, width, height, samples, halves }) {
    const place = this.place(tile);
    if (!place || place.width !== width || place.height !== height) return false;
    this.begin(Math.floor(tile / this.across));
    if (this.luminances) this.countTile(tile, -1);
    for (let y = 0; y < height; y++)
      this.data.set(halves.subarray(y * width * 4, (y + 1) * width * 4), ((place.y + y) * this.width + place.x) * 4);
    if (this.samples[tile] === 0 && samples > 0) this.arrived++;
    this.samples[tile] = samples;
    this.markChanged(place);
    if (this.luminances) this.countTile(tile, 1);
    this.known = null;
    return true;
  }

  /* The cells whose windows see the place. */
  markChanged({ x, y, width, height }) {
    const last = Math.min(x + width - 1 + MARGIN, this.width - 1), bottom = Math.min(y + height - 1 + MARGIN, this.height - 1);
    for (let row = Math.floor(Math.max(y - MARGIN, 0) / CELL); row * CELL <= bottom; row++)
      for (let column = Math.floor(Math.max(x - MARGIN, 0) / CELL); column * CELL <= last; column++)
        this.changed[row * this.cellsAcross + column] = 1;
  }

  /* fn(luminance, largest channel, column, row) of the place's pixels that are there, after white balance. What is not
   * finite is made black or the brightest half, for those who read it later, too. */
  eachPixel({ x, y, width, height }, fn) {
    const m = this.balance, d = this.data, plain = m === IDENTITY;
    for (let row = y; row < y + height; row++) {
      if (!this.begun[Math.floor(row / TILE)]) continue;
      for (let i = (row * this.width + x) * 4, column = x; column < x + width; i += 4, column++) {
        if (d[i] === NOTHING) continue;
        let r = floats[d[i]], g = floats[d[i + 1]], b = floats[d[i + 2]];
        if (!(r - r === 0 && g - g === 0 && b - b === 0)) {
          for (let c = i; c < i + 3; c++) if ((d[c] & 0x7c00) === 0x7c00) d[c] = d[c] === 0x7c00 ? 0x7bff : 0;
          r = floats[d[i]]; g = floats[d[i + 1]]; b = floats[d[i + 2]];
        }
        r = r > 0 ? r : 0; g = g > 0 ? g : 0; b = b > 0 ? b : 0;
        if (!plain) {
          const red = m[0] * r + m[1] * g + m[2] * b, green = m[3] * r + m[4] * g + m[5] * b;
          b = Math.max(m[6] * r + m[7] * g + m[8] * b, 0);
          r = Math.max(red, 0); g = Math.max(green, 0);
        }
        fn(WEIGHTS[0] * r + WEIGHTS[1] * g + WEIGHTS[2] * b, Math.max(r, g, b), column, row);
      }
    }
  }

  measureCell(cell) {
    const x = cell % this.cellsAcross * CELL, y = Math.floor(cell / this.cellsAcross) * CELL;
    const left = Math.max(x - MARGIN, 0), top = Math.max(y - MARGIN, 0);
    const right = Math.min(x + CELL + MARGIN, this.width), bottom = Math.min(y + CELL + MARGIN, this.height);
    let least = Infinity, most = 0, count = 0, logs = 0, product = 1;
    light.fill(0);
    packed.fill(0);
    this.eachPixel({ x: left, y: top, width: right - left, height: bottom - top }, (luminance, largest, column, row) => {
      const i = (row - y + MARGIN) * AREA + column - x + MARGIN;
      packed[i] = luminance > 0 ? THERE + LIT + roughLog(luminance) : THERE;
      light[i] = luminance;
      if (!(luminance > 0 && column >= x && column < x + CELL && row >= y && row < y + CELL)) return;
      least = Math.min(least, luminance);
      most = Math.max(most, luminance);
    });
    limitLight();
    sumLines();
    for (let row = MARGIN; row < AREA - MARGIN; row++)
      for (let i = row * AREA + MARGIN, end = i + CELL; i < end; i++) {
        if (!(light[i] > 0)) continue;
        let sum = 0;
        for (let k = i - REACH * AREA; k <= i + REACH * AREA; k += AREA) sum += lines[k];
        product *= sum / there[i];
        if (++count % 8 > 0) continue; /* the exponents of eight halves' product fit a double */
        logs += Math.log(product);
        product = 1;
      }
    this.logs[cell] = logs + Math.log(product);
    this.counts[cell] = count;
    this.least[cell] = least;
    this.most[cell] = most;
  }

  countTile(tile, sign) {
    this.eachPixel(this.place(tile), (luminance, largest) => {
      if (!(luminance > 0)) return;
      this.luminances[binOf(luminance)] += sign;
      this.largest[binOf(largest)] += sign;
    });
  }

  /* Later measures are of the picture after this matrix. */
  setBalance(matrix) {
    const same = matrix.every((x, i) => x === this.balance[i]);
    if (same) return;
    this.balance = matrix.every((x, i) => x === IDENTITY[i]) ? IDENTITY : matrix;
    this.luminances = this.largest = this.known = null;
    this.changed.fill(1);
  }

  /* {count, logMean, least, most}; count 0: nothing is lit. */
  measured() {
    if (this.known) return this.known;
    let sum = 0, count = 0, least = Infinity, most = 0;
    for (let cell = 0; cell < this.counts.length; cell++) {
      if (this.changed[cell]) this.measureCell(cell);
      this.changed[cell] = 0;
      if (!this.counts[cell]) continue;
      sum += this.logs[cell];
      count += this.counts[cell];
      least = Math.min(least, this.least[cell]);
      most = Math.max(most, this.most[cell]);
    }
    this.known = { count, logMean: count ? Math.exp(sum / count) : 1, least: count ? least : 0, most };
    return this.known;
  }

  /* Of the luminance, or of the largest channel, of the pixels that count; 0: there is none. */
  percentile(percent, ofLargest) {
    if (!this.luminances) {
      this.luminances = new Int32Array(BINS);
      this.largest = new Int32Array(BINS);
      for (let tile = 0; tile < this.tiles; tile++) if (this.samples[tile] > 0) this.countTile(tile, 1);
    }
    return percentileOf(ofLargest ? this.largest : this.luminances, percent, !ofLargest || this.balance !== IDENTITY);
  }

  /* Linear red, green, blue and the luminance's standard error; null: no samples yet, or outside. */
  at(x, y) {
    if (!(x >= 0 && y >= 0 && x < this.width && y < this.height && this.begun[Math.floor(y / TILE)])) return null;
    const i = (y * this.width + x) * 4;
    return this.data[i] === NOTHING ? null : [0, 1, 2, 3].map((c) => floats[this.data[i + c]]);
  }
}
