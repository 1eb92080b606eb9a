/* cost: a frame's error against what it cost, both logarithmic, and what a smaller error will cost.
 *
 * The coordinator sends points of the curve with the frame's history (CostCurve), so the page knows no law.
 */
import { h, text, show } from '../dom.js';
import { display, coreTime } from '../format.js';
import { frameCount } from '../state.js';

/* `to` where the curve's `from` is x: a straight line between two points, and beyond the ends. */
function along(curve, from, to, x) {
  const falls = curve.at(-1)[from] < curve[0][from];
  let i = 1;
  while (i < curve.length - 1 && (falls ? curve[i][from] > x : curve[i][from] < x)) i++;
  const a = curve[i - 1], b = curve[i];
  return a[to] * (b[to] / a[to]) ** (Math.log(x / a[from]) / Math.log(b[from] / a[from]));
}

export const errorAt = (curve, cost) => along(curve, 'core_seconds', 'error', cost);

export function costOf(curve, error) {
  const [value, lo, hi] = ['core_seconds', 'core_seconds_low', 'core_seconds_high'].map((key) => along(curve, 'error', key, error));
  return { value, lo, hi };
}

/* Measures by their words. `error` of a figure and back: a law falls, so decibels become codes. */
const same = (x) => x;
const MEASURES = {
  display: { name: 'display error', to: same, back: same, show: display },
  psnr: {
    name: 'PSNR', to: (db) => 255 * 10 ** (-db / 20), back: (codes) => -20 * Math.log10(codes / 255),
    show: (db) => `${db.toFixed(1)} dB`,
  },
  rmse: { name: 'RMSE of light', to: same, back: same, show: (percent) => `${Number(percent.toPrecision(2))} %` },
};
const KEYS = { display: ['display', 'display_low', 'display_high'], psnr: ['psnr_db', 'psnr_high', 'psnr_low'],
  rmse: ['rmse_percent', 'rmse_low', 'rmse_high'] };

export function pointsOf(history, measure) {
  const { to } = MEASURES[measure];
  return history.filter((p) => p.figures).map((p) => {
    const [error, lo, hi] = KEYS[measure].map((key) => typeof p.figures[key] === 'number' ? to(p.figures[key]) : NaN);
    return { cost: p.core_seconds, error, lo, hi };
  }).filter((p) => p.cost > 0 && p.error > 0);
}

/* "1:50", "2:03:10" */
export function clock(seconds) {
  const s = Math.round(seconds), pair = (n) => String(n).padStart(2, '0');
  if (s >= 359999) return `${Math.round(s / 3600)} hours`;
  return s >= 3600 ? `${Math.floor(s / 3600)}:${pair(Math.floor(s / 60) % 60)}:${pair(s % 60)}` : `${Math.floor(s / 60)}:${pair(s % 60)}`;
}
const two = (n) => Number(n.toPrecision(2));
const work = (s) => s < 0.95 ? 'under a core-second' : s < 60 ? `${two(s)} core-seconds` : s < 3600 ? `${two(s / 60)} core-minutes` : `${two(s / 3600)} core-hours`;

/* What a target costs one frame, in words: "2/255 in 1:50, 0.4 core-hours more (0.3 core-hours to 0.6 core-hours)". `stop`: a
 * frame that ends by a target ends at this share of it. */
export function priceWords({ points: curve, stop, width }, error, spent, cores, shown) {
  const { value, lo, hi } = costOf(curve, error * stop), [more, least, most] = [value, lo, hi].map((c) => Math.max(c - spent, 0));
  if (error >= errorAt(curve, spent)) return `${shown} is reached`;
  if (!(most <= width * least)) return `${shown}: too early to say, ${coreTime(least)} to ${coreTime(most)} more`;
  return `${shown} ${!(cores > 0) ? 'for ' : more < cores ? 'within a second, ' : `in ${clock(more / cores)}, `}${work(more)} more (${coreTime(least)} to ${coreTime(most)})`;
}

/* What is asked first where a job has no target: the farm's next round number, or about half the error. */
function next(info, measure, error) {
  const forecast = measure === 'display' && (info.forecasts || []).find((f) => !f.at_end && f.display < 0.95 * error);
  return forecast ? forecast.display : 2 ** Math.round(Math.log2(error / 2));
}

const W = 320, H = 200, LEFT = 44, RIGHT = 10, TOP = 10, BOTTOM = 30;

function s(tag, attributes, ...children) {
  const node = document.createElementNS('http://www.w3.org/2000/svg', tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

/* Round numbers 1, 2, 5 x 10^n between the ends; only powers of ten if there are many. */
function ticks(low, high) {
  const all = [];
  for (let n = Math.floor(Math.log10(low)); n <= Math.log10(high); n++)
    for (const m of [1, 2, 5]) if (m * 10 ** n >= low && m * 10 ** n <= high) all.push(m * 10 ** n);
  if (all.length <= 6) return all;
  const tens = all.filter((t) => Math.abs(Math.log10(t) - Math.round(Math.log10(t))) < 1e-9), step = Math.ceil(tens.length / 6);
  return tens.filter((_, i) => i % step === 0);
}
/* Round times. */
function timeTicks(low, high) {
  const all = [0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 60, 180, 600, 1800, 3600, 10800, 36000, 1e2 * 3600, 1e3 * 3600, 1e4 * 3600].filter((t) => t >= low && t <= high);
  return all.filter((_, i) => (all.length - 1 - i) % Math.ceil(all.length / 5) === 0);
}
const coreTick = (t) => t < 60 ? `${t} s` : t < 3600 ? `${t / 60} min` : `${t / 3600} h`;

class Cost {
  constructor(element, context) {
    Object.assign(this, { element, context, history: [], curves: [], measure: '', dragged: 0 });
    this.choice = h('select', { 'aria-label': 'Measure of the error', onchange: () => { this.measure = this.choice.value; this.dragged = 0; this.draw(); } },
      Object.entries(MEASURES).map(([value, { name }]) => h('option', { value }, name)));
    this.chart = s('svg', { viewBox: `0 0 ${W} ${H}`, class: 'cost-chart', role: 'group', 'aria-label': 'Error against core-seconds' });
    this.price = h('p', { class: 'price', role: 'status' });
    this.button = h('button', { onclick: () => this.apply() });
    this.back = h('button', { class: 'quiet', onclick: () => { this.dragged = 0; this.draw(); } }, 'Back');
    this.why = h('p', { class: 'quiet' });
    this.empty = h('p', { class: 'quiet' });
    this.body = h('div', null, this.chart, this.price, h('div', { class: 'row' }, this.button, this.back), this.why);
    element.replaceChildren(h('div', { class: 'row' }, h('h3', null, 'Error against cost'), this.choice), this.empty, this.body);
    element.classList.add('cost-part');
    const draw = () => this.draw();
    context.on('select', () => { this.dragged = 0; this.measure = ''; this.history = this.curves = []; this.load(); });
    context.on('job', () => { this.load(); context.frameLoop(draw); });
    this.chart.addEventListener('pointerdown', (event) => this.grab(event));
    this.chart.addEventListener('pointermove', (event) => this.holding && this.drag(event));
    for (const end of ['pointerup', 'pointercancel']) this.chart.addEventListener(end, () => { this.holding = false; });
    this.load();
  }

  get frame() { return this.context.shownFrame(); }

  /* Again when the frame has a tenth more samples, or its first figures. */
  async load() {
    const job = this.context.job(), info = this.context.info(), { frame } = this, key = `${job}/${frame}`;
    const samples = info?.now && info.now_frame === frame ? Number(info.now.samples) : 0;
    if (!job || !info || this.busy) { this.draw(); return; }
    if (this.key === key && samples <= this.samples * 1.1 && (this.curves.length || !info.now?.figures) && !(info.state === 'done' && this.stateThen !== 'done')) return;
    this.busy = true;
    try {
      const answer = await this.context.api.get(`/jobs/${job}/frames/${frame}/history`);
      [this.history, this.curves] = this.context.job() === job ? [answer.points || [], answer.curves || []] : [[], []];
    } catch { this.history = this.curves = []; }
    Object.assign(this, { busy: false, key, samples, stateThen: info.state });
    if (this.context.job() !== job) this.load(); else this.draw();
  }

  draw() {
    const info = this.context.info(), { frame } = this, stop = info?.stop || {};
    if (!this.measure) { this.measure = MEASURES[stop.measure] ? stop.measure : 'display'; this.choice.value = this.measure; }
    const history = [...this.history], now = info?.now;
    if (now?.figures && info.now_frame === frame && now.core_seconds > (history.at(-1)?.core_seconds || 0)) history.push(now);
    this.points = pointsOf(history, this.measure);
    const law = info && this.points.length ? this.curves.find((c) => c.measure === this.measure) : undefined;
    [this.curve, this.law] = [law?.points, law];
    show(this.empty, !this.curve && this.key === `${this.context.job()}/${frame}`);  // not before the answer
    text(this.empty, info?.state === 'done' ? 'No figures: the frame ended before it had the samples for them.' : 'No figures yet: they come with the first passes.');
    show(this.body, this.curve);
    if (!this.curve) return;
    const own = stop.measure === this.measure && stop.target > 0 ? MEASURES[this.measure].to(stop.target) : 0;
    this.own = own;
    this.spent = this.points.at(-1).cost;
    this.target = this.dragged || own || next(info, this.measure, this.points.at(-1).error);
    this.scale();
    this.paint();
    this.tell(info);
  }

  /* While the target is held the axes stay. */
  scale() {
    if (this.holding) return;
    const costs = this.points.map((p) => p.cost), errors = this.points.map((p) => p.error);
    const least = Math.min(this.target, ...errors), reach = costOf(this.curve, least / 1.6).value;
    this.x = [Math.log(Math.min(...costs) / 1.3), Math.log(Math.max(this.spent * 3, Math.min(reach, this.spent * 1e4)))];
    this.y = [Math.log(least / 2), Math.log(Math.max(...errors) * 1.3)];
  }

  at(cost, error) {
    const x = (Math.log(cost) - this.x[0]) / (this.x[1] - this.x[0]), y = (Math.log(error) - this.y[0]) / (this.y[1] - this.y[0]);
    return [LEFT + x * (W - LEFT - RIGHT), H - BOTTOM - y * (H - TOP - BOTTOM)];
  }

  paint() {
    const parts = [], { curve, points } = this, m = MEASURES[this.measure], line = (list) => list.map((p) => p.map((n) => n.toFixed(1)).join()).join(' ');
    const low = Math.exp(this.x[0]), high = Math.exp(this.x[1]);
    for (const t of timeTicks(low, high)) {
      const [x] = this.at(t, 1);
      parts.push(s('line', { class: 'grid', x1: x, x2: x, y1: TOP, y2: H - BOTTOM }), s('text', { x, y: H - BOTTOM + 12, 'text-anchor': 'middle' }, coreTick(t)));
    }
    for (const t of ticks(Math.exp(this.y[0]), Math.exp(this.y[1]))) {
      const [, y] = this.at(low, t);
      parts.push(s('line', { class: 'grid', x1: LEFT, x2: W - RIGHT, y1: y, y2: y }), s('text', { x: LEFT - 4, y: y + 3, 'text-anchor': 'end' }, m.show(m.back(t))));
    }
    parts.push(s('text', { x: W - RIGHT, y: H - 4, 'text-anchor': 'end' }, 'processor time of the frame'));
    const ends = s('clipPath', { id: 'cost-clip' }, s('rect', { x: LEFT, y: TOP, width: W - LEFT - RIGHT, height: H - TOP - BOTTOM }));
    const inside = s('g', { 'clip-path': 'url(#cost-clip)' });
    /* A bound that is 0 or unknown has no place on the axis. */
    const within = (cost) => Math.min(Math.max(cost ?? Infinity, this.spent), high * 10);
    const ahead = curve.filter((p) => p.core_seconds >= this.spent), known = points.filter((p) => p.lo > 0 && p.hi < Infinity);
    inside.append(s('polygon', { class: 'band', points: line([...known.map((p) => this.at(p.cost, p.hi)), ...known.map((p) => this.at(p.cost, p.lo)).reverse()]) }),
      s('polygon', { class: 'band ahead', points: line([...ahead.map((p) => this.at(within(p.core_seconds_high), p.error)), ...ahead.map((p) => this.at(within(p.core_seconds_low), p.error)).reverse()]) }),
      s('polyline', { class: 'fit', points: line([points[0].cost, this.spent].map((c) => this.at(c, errorAt(curve, c)))) }),
      s('polyline', { class: 'fit ahead', points: line([this.spent, high].map((c) => this.at(c, errorAt(curve, c)))) }),
      ...points.map((p) => { const [cx, cy] = this.at(p.cost, p.error); return s('circle', { cx, cy, r: 2.2 }); }));
    const [x, y] = this.at(this.spent, points.at(-1).error), [, ty] = this.at(low, this.target);
    inside.append(s('circle', { class: 'here', cx: x, cy: y, r: 5 }));
    parts.push(ends, inside, s('text', { class: 'here', x: Math.min(x + 8, W - 70), y: y - 6 }, 'you are here'));
    if (!this.line) {
      this.line = s('g', { class: 'target', role: 'slider', tabindex: 0, 'aria-label': 'Target error', 'aria-orientation': 'vertical' });
      this.line.addEventListener('keydown', (event) => this.step(event));
      this.chart.append(this.line);
    }
    this.line.replaceChildren(s('line', { class: 'hold', x1: LEFT, x2: W - RIGHT, y1: ty, y2: ty }), s('line', { x1: LEFT, x2: W - RIGHT, y1: ty, y2: ty }),
      s('text', { x: LEFT + 4, y: ty - 4 }, `${this.own === this.target ? 'target ' : ''}${m.show(m.back(this.target))}${this.own || this.dragged ? '' : '? drag to ask'}`));
    for (const node of [...this.chart.children]) if (node !== this.line) node.remove();
    this.chart.prepend(...parts);
  }

  tell(info) {
    const m = MEASURES[this.measure], words = m.show(m.back(this.target)), reached = this.target >= errorAt(this.curve, this.spent);
    const price = priceWords(this.law, this.target, this.spent, Number(info.cores), words), moved = this.dragged > 0;
    const is = (...states) => states.includes(info.state);
    this.line.setAttribute('aria-valuenow', m.back(this.target).toPrecision(3));
    this.line.setAttribute('aria-valuetext', price);
    const may = this.context.may('operate', info);
    const inWork = is('queued', 'running', 'paused', 'parked');
    const gone = is('done') && !(info.verbs || []).includes('extend'), frames = frameCount(info);
    this.verb = moved && may && !gone && (inWork || (is('done') && !reached)) ? 'extend' : '';
    text(this.button, !this.verb ? '' : `${inWork ? 'Set the target' : 'Extend'}${frames > 1 ? ` of all ${frames} frames` : ''} to ${words}`);
    text(this.price, frames > 1 ? `Frame ${this.frame} of ${frames}: ${price}` : price);
    show(this.button, this.verb);
    show(this.back, moved);
    text(this.why, inWork && this.verb && reached ? `This frame is better than that already, and ends ${is('running') ? 'now' : 'when the job goes on'}.`
      : !moved || this.verb || !may ? `Spent on this frame so far: ${coreTime(frames > 1 ? this.spent : Math.max(this.spent, info.core_seconds || 0))}.`
      : reached ? 'The picture is better than that already.'
        : gone ? 'Its film was not kept: submit the scene again for a better picture.'
          : `A job that is ${info.state} cannot be extended: retry it first.`);
  }

  apply() {
    const { back } = MEASURES[this.measure], target = Number(back(this.target).toPrecision(3));
    if (this.verb) this.context.act('extend', [this.context.job()], { spp: 0, stop: { measure: this.measure, target, adaptive: true } });
    this.dragged = 0;
  }

  /* Two digits are enough for a target. */
  setTarget(error) {
    const { to, back } = MEASURES[this.measure], digits = this.measure === 'psnr' ? 3 : 2;
    const lowest = costOf(this.curve, error).value > this.spent * 1e6 ? this.target : error;
    this.dragged = to(Number(back(lowest).toPrecision(digits)));
    this.draw();
  }

  grab(event) {
    if (!this.curve) return;
    this.holding = true;
    this.chart.setPointerCapture(event.pointerId);
    this.drag(event);
  }

  drag(event) {
    const box = this.chart.getBoundingClientRect(), y = (event.clientY - box.top) / box.height * H;
    this.setTarget(Math.exp(this.y[0] + Math.min(Math.max((H - BOTTOM - y) / (H - TOP - BOTTOM), 0.02), 1) * (this.y[1] - this.y[0])));
  }

  step(event) {
    const by = { ArrowUp: 1.05, ArrowRight: 1.05, ArrowDown: 1 / 1.05, ArrowLeft: 1 / 1.05, PageUp: 1.4, PageDown: 1 / 1.4 }[event.key];
    if (!by) return;
    event.preventDefault();
    this.setTarget(this.target * by);
  }
}

export function mountCost(element, context) {
  element.cost = new Cost(element, context);
  return element.cost;
}
