/* format: numbers and words for people, as azulejo's commands print them. */

const digits = (v) => (v < 9.995 ? 2 : v < 99.95 ? 1 : 0);

export function count(value) {
  if (!Number.isFinite(value)) return '?';
  if (value < 999.5) return value.toFixed(Number.isInteger(value) ? 0 : digits(value));
  let step = 0;
  while (value >= 999.5 && step < 6) { value /= 1000; step++; }
  return `${value.toFixed(digits(value))} ${' kMGTPE'[step]}`;
}
export const samplesRate = (v) => `${count(v || 0)} samples/s`;
export const plural = (n, word, words = word + 's') => `${count(n)} ${n === 1 ? word : words}`;

export function bytes(value) {
  value = Number(value);
  if (!Number.isFinite(value)) return '?';
  let step = 0;
  while (value >= 1023.5 && step < 5) { value /= 1024; step++; }
  return `${step ? value.toFixed(value < 99.95 ? 1 : 0) : value} ${['B', 'KiB', 'MiB', 'GiB', 'TiB', 'PiB'][step]}`;
}

/* A name within a sentence: one that is written from right to left must not turn the rest around. */
const TURNS = /[\u0590-\u08ff\u200e\u200f\u202a-\u202e\u2066-\u2069\ufb1d-\ufdff\ufe70-\ufefc]|[\u{10800}-\u{10fff}\u{1e800}-\u{1efff}]/u;
export const isolated = (name) => (TURNS.test(name) ? `\u2068${name}\u2069` : name);

/* "9 s", "41 s", "9 min", "2.5 h", "3 d" */
export function span(s) {
  if (!(s >= 0) || !Number.isFinite(s)) return '?';
  if (s < 99.5) return `${s < 9.95 && s > 0 ? s.toFixed(1) : Math.round(s)} s`;
  if (s < 99.5 * 60) return `${Math.round(s / 60)} min`;
  if (s < 36 * 3600) return `${(s / 3600).toFixed(1)} h`;
  return `${(s / 86400).toFixed(1)} d`;
}
export const coreTime = (s) => (s < 99.5 ? `${s.toFixed(s < 9.95 ? 1 : 0)} core-s` : s < 5940 ? `${Math.round(s / 60)} core-min` : `${(s / 3600).toFixed(1)} core-h`);
export const percent = (share) => `${Math.floor(100 * Math.min(1, Math.max(0, share)))} %`;
/* An error in display codes: "3.1/255"; never rounded to none. */
export function display(e) {
  if (!(typeof e === 'number' && e >= 0)) return '?';
  if (e > 0 && e < 0.005) return 'under 0.01/255';
  return `${e > 0 && e < 0.995 ? e.toFixed(2) : e < 9.95 && !Number.isInteger(e) ? e.toFixed(1) : e.toFixed(0)}/255`;
}

/* "9.0 s", "41 s", "1:26", "2:03:10": a clock. */
export function duration(s) {
  if (!(s >= 0) || s > 1e12) return '?';
  if (s < 9.95) return `${s.toFixed(1)} s`;
  const whole = Math.round(s), pair = (n) => String(n).padStart(2, '0');
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)}:${pair(whole % 60)}`;
  if (whole < 2 * 86400) return `${Math.floor(whole / 3600)}:${pair(Math.floor(whole / 60) % 60)}:${pair(whole % 60)}`;
  return `${Math.floor(whole / 86400)} d ${pair(Math.floor(whole / 3600) % 24)} h`;
}
/* How a forecast's interval is shown: not where it is a mere width, nor where its ends are a factor of 10 apart (then it is too
 * early to say when). */
export const interval = (f) => !(f.seconds_high - f.seconds_low > 0.2 * f.seconds) ? 'narrow' : f.seconds_high <= 10 * f.seconds_low ? 'shown' : 'wide';
/* Of the forecasts the one at the end: a round number may never come. */
export const milestone = (job) => (job.forecasts || []).find((f) => f.at_end);
const trend = (slope) => typeof slope !== 'number' ? '' : slope < -0.1 ? '\u2198' : slope > 0.1 ? '\u2197' : '\u2192';
/* The words of azulejo's line: "36 s left  7/255 now -> 5/255 at 1:26" (client/follow/figures_view.c). */
export function lineWords(job) {
  const f = milestone(job), now = job.now?.figures, parts = [job.seconds_left >= 0 && `${duration(job.seconds_left)} left`];
  const at = (s) => { const then = job.seconds_active + s; return then < 3600 ? duration(then) : span(then); };
  if (now) {
    let words = `${display(now.display)}${now.reliable ? '' : '?'}${trend(job.error_slope)} now`;
    if (f && f.seconds >= 0) {
      words += ` -> ${display(f.display)}`;
      words += interval(f) === 'wide' ? ' (too early to say when)' : ` at ${at(f.seconds)}`;
      if (interval(f) === 'shown') words += ` (${at(f.seconds_low)} to ${at(f.seconds_high)})`;
    }
    parts.push(words);
  }
  return parts.filter(Boolean).join('  ');
}

/* Of a share, with two digits and no exponent: "12 %", "0.51 %". */
const finely = (share, digits) => `${share >= 0.095 ? Math.round(100 * share) : Number((100 * share).toPrecision(digits))} %`;
/* EndedByDepth in words, where it is above a half per cent (DEPTH_SHARE_TOLD); else "". */
export const endedByDepth = (d) => (d && d.share > 0.005 ? `${finely(d.share, 2)} of the picture${d.deeper ? `; a depth of ${d.deeper} would leave ${finely(d.deeper_share, 1)}` : ''}` : '');

/* StopRules' target in words; "" without one. */
export function target(stop) {
  if (!(stop?.target > 0)) return '';
  return stop.measure === 'display' ? display(stop.target) : stop.measure === 'psnr' ? `${stop.target} dB` : `${stop.target} %`;
}

/* "1,5,10-12" -> {frames: [1, 5, 10, 11, 12]}; "10-100x10" as the commands. Throws a sentence. */
export function frameList(words) {
  const frames = new Set();
  for (const part of words.split(',')) {
    const m = part.trim().match(/^(\d+)(?:-(\d+)(?:x(\d+))?)?$/);
    if (!m) throw new Error(`“${part.trim()}” is no frame: write them as 1,5,10-100x10.`);
    const first = Number(m[1]), last = Number(m[2] ?? m[1]), step = Number(m[3] ?? 1);
    if (last < first || step < 1) throw new Error(`“${part.trim()}” has no frames: the second number must not be smaller.`);
    if ((last - first) / step + frames.size > 1e5) throw new Error('These are more than 100,000 frames.');
    for (let f = first; f <= last; f += step) frames.add(f);
  }
  return [...frames].sort((a, b) => a - b);
}
/* A time as the commands take it: "90s", "10m", "2h", or seconds -> milliseconds. */
export function milliseconds(words) {
  const m = words.trim().match(/^(\d+(?:\.\d+)?)\s*(ms|s|m|min|h|d)?$/);
  if (!m) throw new Error(`“${words.trim()}” is no time: write 90s, 10m or 2h.`);
  return Math.round(Number(m[1]) * { ms: 1, s: 1e3, m: 6e4, min: 6e4, h: 3.6e6, d: 8.64e7 }[m[2] || 's']);
}
/* "2/255", "1%", "45dB" -> {measure, target} */
export function errorTarget(words) {
  const m = words.trim().match(/^(\d+(?:\.\d+)?)\s*(\/\s*255|%|dB)$/i);
  if (!m || !(Number(m[1]) > 0)) throw new Error(`“${words.trim()}” is no error: write 2/255, 1% or 45dB.`);
  return { measure: m[2] === '%' ? 'rmse' : /db/i.test(m[2]) ? 'psnr' : 'display', target: Number(m[1]) };
}
