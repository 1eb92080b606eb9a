/* picture: a frame as it becomes right: pixels from live.js, an operator in the shader (gl.js), overlays, layers.
 *
 *   select --> watching --picture--> size known --tiles--> drawn, at most once an animation frame
 *
 * Tiles that came are drawn alone, twelve times a second at most. All is drawn when people change what they look at, and
 * as often as Pace lets it when what the operator measures of the picture changed: until then the new tiles are shown as
 * the others are. A change that could hardly be seen waits until no tiles come for a while.
 *
 * The last picture stays while a connection is lost. Without WebGL 2 the coordinator's preview is shown instead.
 */
import { h, text, show } from './dom.js';
import { Pixels, eachTile } from './picture/pixels.js';
import { Screen, Pace } from './picture/gl.js';
import { View } from './picture/view.js';
import { isHere, prepare, OPERATORS } from './picture/tonemap.js';
import { OVERLAYS, ownerOf, paint, legend, findFireflies, worstTiles, ramp, codesText, secondsText, samplesText } from './picture/overlays.js';
import { layerPane, layerUnit, isLight } from './picture/layers.js';
import { makeControls, lookOf, outputOf, sameLook } from './picture/controls.js';

const MAP_EVERY_MS = 3000;              /* who rendered what: asked while it is shown */
const MARKS_EVERY_MS = 1000, MARKS_MAX = 5000;
const DRAWN_AGAIN_MS = 4000;            /* a preview without WebGL */
const TILES_EVERY_MS = 80;
const QUIET_MS = 500;
/* An exposure or a white that differs by so much moves no code of a display by a whole one. */
const SMALL = 1 / 128;

/* Lists, or numbers, that differ by little. */
const isNear = (a, b) => (Array.isArray(a) ? a.length === b?.length && a.every((x, i) => isNear(x, b[i]))
  : a === b || Math.abs(a - b) <= SMALL * Math.max(Math.abs(a), Math.abs(b)));

class Picture {
  constructor(element, context) {
    Object.assign(this, { element, context, pixels: null, layer: 'color', layers: ['color'], overlay: 'none', opacity: 0.6,
      wipe: false, split: 0.5, map: null, mapAsked: 0, orders: new Map(), developed: new Map(), shown: {}, complete: false,
      drawn: {}, version: 0, tints: 0, pace: new Pace(), tilePace: new Pace(TILES_EVERY_MS), quietMs: QUIET_MS, takenAt: 0, timer: 0, soon: 0, settled: false });
    this.draw = this.draw.bind(this);
    this.canvas = h('canvas', { class: 'picture', tabindex: 0, role: 'img', 'aria-label': 'No picture yet', 'data-own-keys': true });
    this.rings = h('canvas', { class: 'rings', hidden: true, 'aria-hidden': 'true' });
    this.crosshair = h('i', { class: 'crosshair', hidden: true });
    this.handle = h('div', { class: 'wipe', role: 'slider', tabindex: 0, 'aria-label': 'Border between the two operators',
      'aria-valuemin': 0, 'aria-valuemax': 100, hidden: true });
    this.note = h('p', { class: 'picture-note', role: 'status' });
    this.stage = h('div', { class: 'stage' }, this.canvas, this.rings, this.crosshair, this.handle, this.note);
    this.reading = h('output', { class: 'reading', 'aria-live': 'off' });
    try {
      this.screen = new Screen(this.canvas);
    } catch (why) {
      this.withoutScreen(why);
    }
    this.controls = makeControls(this);
    element.classList.add('picture-part');
    this.stage.append(this.controls.changed);
    element.replaceChildren(this.stage, this.reading, this.controls.element);
    if (this.screen) this.prepareScreen();
    context.on('select', () => this.select());
    context.on('job', () => this.jobChanged());
    context.on('theme', () => this.takeTheme());
    context.on('connection', (how) => {
      if (how === 'open') { this.loadOperators(); this.withScreen(); }
      if (how === 'blocked' && this.screen) {
        this.resting = { screen: this.screen, canvas: this.canvas };
        this.withoutScreen(new Error('the live connection does not get through'));
      }
    });
    this.loadOperators();
    this.select();
  }

  async loadOperators() {
    if (this.controls.ready || this.loading) return;
    this.loading = true;
    try {
      this.controls.setOperators(await this.context.api.get('/operators'));
      this.jobChanged(true);
    } catch (why) { this.context.trouble(why); }
    this.loading = false;
  }

  prepareScreen() {
    this.screen.setScale(ramp());
    this.screen.onrestored = () => { this.paintOverlay(); this.renew(); };
    this.view = new View(this.canvas, () => this.redraw(), (pixel, byKeys) => this.pointed(pixel, byKeys));
    this.takeTheme();
    const drag = (event) => event.buttons && this.setSplit((event.clientX - this.stage.getBoundingClientRect().left) / this.stage.clientWidth);
    this.handle.addEventListener('pointerdown', (event) => this.handle.setPointerCapture(event.pointerId));
    this.handle.addEventListener('pointermove', drag);
    this.handle.addEventListener('keydown', (event) => {
      const to = { ArrowLeft: this.split - 0.02, ArrowRight: this.split + 0.02, Home: 0, End: 1 }[event.key];
      if (to === undefined) return;
      event.preventDefault();
      this.setSplit(to);
    });
    document.addEventListener('fullscreenchange', () => this.redraw());
    this.context.keys({
      '+': { text: 'zoom in', run: () => this.view.zoom(Math.SQRT2) },
      '=': { text: 'zoom in', hidden: true, run: () => this.view.zoom(Math.SQRT2) },
      '-': { text: 'zoom out', run: () => this.view.zoom(Math.SQRT1_2) },
      0: { text: 'fit the picture', run: () => this.view.fit() },
      1: { text: 'one pixel of the picture a pixel of the screen', run: () => this.view.zoomTo(1) },
      e: { text: 'brighter by a third of a stop', run: () => this.controls.nudge(1 / 3) },
      E: { text: 'darker by a third of a stop', run: () => this.controls.nudge(-1 / 3) },
      o: { text: 'next overlay', run: () => this.controls.nextOverlay() },
      w: { text: 'wipe between two operators', run: () => this.controls.toggleWipe() },
      F: { text: 'full screen', run: () => this.fullScreen() },
    }, 'Picture');
  }

  takeTheme() {
    if (!this.screen) return;
    const around = getComputedStyle(this.stage).backgroundColor.match(/[\d.]+/g)?.slice(0, 3).map((c) => c / 255);
    if (around?.length === 3) this.screen.colors = { around, empty: around.map((c) => c + (c > 0.5 ? -0.04 : 0.03)) };
    this.renew();
  }

  setSplit(split) {
    this.split = Math.min(Math.max(split, 0), 1);
    this.redraw();
  }

  fullScreen() {
    if (document.fullscreenElement) document.exitFullscreen();
    else this.element.requestFullscreen?.().catch((why) => this.context.trouble(why));
  }

  /* ---- what is watched ---- */

  select() {
    const job = this.context.job(), frame = this.context.frame();
    if (this.stop) this.stop();
    this.stop = null;
    if (job !== this.job) {
      /* Another job's picture is never shown under this one's name. */
      Object.assign(this, { map: null, layer: 'color', lookOfJob: null, pixels: null, layerLook: null });
      this.pointed(null);
    }
    if (job !== this.job || frame !== this.frame) this.developed.clear();
    Object.assign(this, { job, frame });
    this.renew();
    if (!job) return;
    if (this.screen)
      this.stop = this.context.live.watch({ job, frame, layer: this.layer }, {
        picture: (data) => this.begin(data), tiles: (buffer) => this.take(buffer), done: () => { this.complete = true; this.redraw(); },
      });
    this.jobChanged();
  }

  begin(data) {
    const same = this.pixels && data.width === this.pixels.width && data.height === this.pixels.height;
    const { job, frame, layer } = this.shown;
    if (!same) {
      try {
        const pixels = new Pixels(data.width, data.height);
        this.screen.setPixels(pixels);
        this.pixels = pixels;
      } catch (why) { this.withoutScreen(why); return; }
    } else if (job !== data.job || frame !== data.frame || layer !== this.layer) {
      this.pixels.clear();
      this.screen.setPixels(this.pixels);
    }
    if (job !== data.job || frame !== data.frame) { this.map = null; this.developed.clear(); }
    this.shown = { job: data.job, frame: data.frame, layer: this.layer };
    this.complete = !!data.complete;
    this.layers = data.layers?.length ? data.layers : ['color'];
    this.controls.setLayers(this.layers, this.layer);
    this.view.setSize(data.width, data.height);
    this.paintOverlay();
    this.describe();
    this.renew();
  }

  take(buffer) {
    if (!this.pixels) return;
    try {
      eachTile(buffer, (tile) => { if (this.pixels.take(tile)) this.screen.changed(tile.tile); });
    } catch (why) { this.context.trouble(why); }
    this.layerLook = null;
    this.taken = (this.taken || 0) + 1;
    this.takenAt = performance.now();
    if (this.overlay === 'samples') this.tintsOld = true;
    this.redraw();
  }

  jobChanged(force) {
    const info = this.context.info();
    if (info) this.known = info.job;
    const look = info && this.controls.ready && lookOf(info.output, this.controls.operators);
    if (look && (force || !this.lookOfJob || !sameLook(look, this.lookOfJob))) {
      this.lookOfJob = look;
      this.developed.clear(); /* made with the settings from before */
      this.controls.setLook(look, info.output?.camera_ev || 0);
      this.version++;
    }
    this.controls.refresh();
    if (!this.screen) this.showPreview();
    this.redraw();
  }

  setLayer(layer) {
    this.layer = layer;
    this.select();
  }

  /* ---- drawing ---- */

  redraw() {
    if (!this.screen) return;
    this.settled = false;
    this.context.frameLoop(this.draw);
  }

  /* All of it, though nothing that `chosen` names changed. */
  renew() {
    this.version++;
    this.redraw();
  }

  draw() {
    const { screen, pixels } = this;
    if (!screen) return;
    this.placeMarks();
    if (!pixels) {
      screen.clear();
      this.drawn = {};
      this.settled = true;
    } else if (!screen.isDone) {
      this.redraw();
      return;
    } else {
      this.pace.end();
      this.tilePace.end();
      this.askMap();
      this.settled = !this.drawWhat() && !this.timer;
    }
    this.describe();
  }

  /* Draw what is to be drawn now. False: it was all there. */
  drawWhat() {
    const { screen, view, pace, tilePace, drawn } = this, chosen = this.chosen(), isOther = chosen !== drawn.chosen;
    let all = false, { rest } = pace;
    if (isOther || !rest) {
      pace.begin();
      if (this.tintsOld) this.paintOverlay();
      const panes = this.panes(), { tints } = this, measures = panes.map((pane) => [pane.exposure, pane.p]);
      const isSame = !isOther && tints === drawn.tints && JSON.stringify(measures) === JSON.stringify(drawn.measures);
      const canWait = !isOther && !isSame && tints === drawn.tints && isNear(measures, drawn.measures);
      rest = canWait ? Math.max(this.takenAt + this.quietMs - performance.now(), 0) : 0;
      all = !isSame && !rest;
      if (!rest) this.drawn = { chosen, panes, tints, measures };
      if (!all) pace.end();
      clearTimeout(this.timer);
      this.timer = 0;
      if (this.at) this.readAt();
    } else if (this.at && this.at !== this.shownAt) this.readAt();
    if (rest && !this.timer) this.timer = setTimeout(() => { this.timer = 0; this.redraw(); }, rest);
    if (!all && !screen.waiting.size) return false;
    if (!all && !screen.isFull && tilePace.rest) {
      this.soon = this.soon || setTimeout(() => { this.soon = 0; this.redraw(); }, tilePace.rest);
      return true;
    }
    if (!all) tilePace.begin();
    screen.draw(this.drawn.panes, { x: view.x, y: view.y, scale: view.scale, split: this.split * this.canvas.width }, this.opacity, all);
    this.redraw(); /* to see when it is done, and whether it still is what it should be */
    return true;
  }

  /* What people chose and the page itself knows: when it changes, all is drawn at once. */
  chosen() {
    const { view, canvas } = this, look = (of) => of && { ...of, file: of.file?.readAt };
    return JSON.stringify([this.version, look(this.controls.look), this.wipe && [look(this.controls.second()), this.split], this.overlay, this.opacity,
      this.layer, view.x, view.y, view.scale, canvas.width, canvas.height]);
  }

  placeMarks() {
    const { view, handle, crosshair } = this, isTwo = this.pixels && this.wipe && isLight(this.layer);
    show(handle, isTwo);
    handle.style.left = `${this.split * 100}%`;
    handle.setAttribute('aria-valuenow', Math.round(this.split * 100));
    show(crosshair, this.pixels && view.cursor);
    if (!this.pixels) return;
    if (view.cursor) {
      const [x, y] = view.screen(view.cursor).map((n) => n / view.ratio), size = Math.max(view.scale / view.ratio, 3);
      Object.assign(crosshair.style, { left: `${x}px`, top: `${y}px`, width: `${size}px`, height: `${size}px` });
    }
    this.controls.setScale(view.scale);
    this.drawRings();
  }

  /* ---- fireflies, and the worst parts ---- */

  /* Found again when the picture changed, a second after the last time at the soonest: it reads all of it. */
  findMarks() {
    const key = `${this.version}/${this.taken || 0}`, now = performance.now();
    if (this.marksKey === key || !this.drawn.panes?.length || !isLight(this.layer)) return;
    clearTimeout(this.marksTimer);
    if (now < this.marksAgain) {
      this.marksTimer = setTimeout(() => this.redraw(), this.marksAgain - now);
      return;
    }
    const pane = this.drawn.panes[0];
    this.marksKey = key;
    this.marks = pane.image ? [] : findFireflies(this.screen.codes(pane), this.screen.codes(pane, -1));
    this.marksAgain = performance.now() + Math.max(MARKS_EVERY_MS, 10 * (performance.now() - now));
    this.marksWords = pane.image ? 'not in a picture that the coordinator developed' : `${this.marks.length} pixels stand out`;
    const words = this.controls.legend.querySelector('.fireflies');
    if (words) text(words, this.marksWords);
  }

  drawRings() {
    const on = this.pixels && OVERLAYS[this.overlay].marks && isLight(this.layer), { view, rings, canvas } = this;
    show(rings, on);
    if (!on) return;
    this.findMarks();
    const key = [this.marksKey, this.mapAsked, view.x, view.y, view.scale, canvas.width, canvas.height].join();
    if (this.ringsKey === key) return;
    this.ringsKey = key;
    rings.width = canvas.width;
    rings.height = canvas.height;
    const paper = rings.getContext('2d'), size = Math.max(view.scale, 4 * view.ratio);
    const stroke = (color, wide) => { paper.strokeStyle = color; paper.lineWidth = wide * view.ratio; paper.stroke(); };
    paper.beginPath();
    for (const [x, y] of (this.marks || []).slice(0, MARKS_MAX)) {
      const [left, top] = view.screen([x + 0.5, y + 0.5]);
      paper.moveTo(left + size, top);
      paper.arc(left, top, size, 0, 2 * Math.PI);
    }
    stroke('#000', 3);
    stroke('#ff5fd0', 1.5);
    paper.beginPath();
    for (const tile of worstTiles(this.map)) {
      const [left, top] = view.screen([tile % this.pixels.across * 16, Math.floor(tile / this.pixels.across) * 16]);
      paper.rect(left, top, 16 * view.scale, 16 * view.scale);
    }
    stroke('#000', 4);
    stroke('#fff', 2);
  }

  panes() {
    if (!isLight(this.layer)) {
      this.layerLook = this.layerLook || layerPane(this.layer, this.pixels);
      return [this.layerLook.pane];
    }
    const looks = this.wipe ? [this.controls.look, this.controls.second()] : [this.controls.look];
    return looks.filter(Boolean).map((look) => this.pane(look)).concat(this.controls.look ? [] : [{ operator: 'linear' }]);
  }

  pane(look) {
    const codes = OVERLAYS[this.overlay].codes, kind = codes && 'error';
    const here = isHere(look.operator, look.values) && (!OPERATORS[look.operator].file || look.file);
    const made = here && look.denoise === 'off' ? {} : this.develop(look);
    if (made.image) return { operator: 'raw', image: made.image };
    if (here) return { operator: look.operator, ...prepare(look, this.pixels), file: look.file?.tables, kind, codes };
    const instead = { ...look, operator: 'reinhard02', values: this.controls.presets('reinhard02') };
    return { operator: instead.operator, ...prepare(instead, this.pixels), kind, codes };
  }

  /* ---- pictures that the coordinator develops ---- */

  previewPath(look) {
    const query = new URLSearchParams({ tonemap: look.operator, exposure: look.ev });
    for (const [name, value] of Object.entries(look.values)) query.set(`param.${name}`, this.controls.word(look.operator, name, value));
    query.set('metering', look.metering);
    query.set('metering_percentile', look.percentile);
    query.set('white_kelvin', look.kelvin);
    query.set('denoise', look.denoise);
    const frame = this.pixels ? this.shown.frame : this.context.shownFrame();
    return `/jobs/${this.job}/frames/${frame}/preview.png?${query}`;
  }

  develop(look) {
    const path = this.previewPath(look), before = this.developed.get(path);
    if (before) return before;
    const made = { at: null };
    for (const [old] of [...this.developed].slice(0, -3)) this.developed.delete(old);
    this.developed.set(path, made);
    if (OPERATORS[look.operator]?.file && look.operator !== this.lookOfJob?.operator) {
      made.why = 'it needs a .cube file, to be chosen under \u201cMore of the operator\u201d.';
      return made;
    }
    clearTimeout(this.developTimer);
    /* Not at each step of a slider. */
    this.developTimer = setTimeout(() => this.ask(path, made), 250);
    return made;
  }

  async ask(path, made) {
    try {
      const answer = await this.context.api.ask(path);
      made.image = await createImageBitmap(await answer.blob(), { colorSpaceConversion: 'none', premultiplyAlpha: 'none' });
      made.at = new Date();
    } catch (why) { made.why = why.message; }
    this.renew();
  }

  developAgain() { this.developed.clear(); this.renew(); }

  /* What must be said about what is seen; a button if it can be made again. */
  describe() {
    const { pixels, shown } = this, info = this.context.info(), look = this.controls.look, notes = [];
    let again = false;
    if (pixels && !info && this.known === shown.job) notes.push('The job was removed: this is the last of its picture');
    for (const one of this.wipe ? [look, this.controls.second()] : [look]) {
      if (!one || !isLight(this.layer) || one.denoise === 'off' && isHere(one.operator, one.values) && (!OPERATORS[one.operator].file || one.file)) continue;
      const made = this.developed.get(this.previewPath(one)) || {};
      again = again || made.image || made.why;
      if (one.denoise !== 'off' && !made.image) {
        notes.push(made.why ? `denoised: ${made.why} Shown with its noise.` : 'asked the coordinator for the denoised picture, until then with its noise');
        continue;
      }
      notes.push(made.image ? `${one.denoise !== 'off' ? 'denoised, ' : ''}${one.operator}: developed by the coordinator at ${made.at.toLocaleTimeString()}`
        : made.why ? `${one.operator}: ${made.why} Shown as reinhard02.`
          : `${one.operator} needs the whole picture: asked the coordinator, until then as reinhard02`);
    }
    if (!isLight(this.layer) && this.layerLook) notes.push(`${this.layer}: ${this.layerLook.note}`);
    if (this.layers.includes('alpha') && isLight(this.layer)) notes.push('on black: what is seen behind everything is left out');
    if (pixels && pixels.arrived < pixels.tiles) notes.push(`${pixels.arrived} of ${pixels.tiles} tiles`);
    if (this.screen) this.say(notes.join('. '), again);
    const error = info?.now && info.now_frame === shown.frame ? info.now.figures?.display : null;
    const label = !pixels ? 'No picture' : `${info?.name || `Job ${shown.job}`}, frame ${shown.frame}, ${this.layer === 'color' ? 'picture' : this.layer}, `
      + `${pixels.width} by ${pixels.height} pixels${error > 0 ? `, error ${codesText(error)}` : ''}${this.complete ? ', finished' : ''}. `
      + 'Arrow keys read its pixels.';
    if (this.canvas.getAttribute('aria-label') !== label) this.canvas.setAttribute('aria-label', label);
  }

  say(words, again) {
    const key = `${words}${again ? 1 : 0}`;
    if (this.said === key) return;
    this.said = key;
    this.note.replaceChildren(words, ...(again ? [' ', h('button', { onclick: () => this.developAgain() }, 'Refresh')] : []));
    show(this.note, words);
  }

  /* ---- overlays ---- */

  setOverlay(name) {
    this.overlay = name;
    this.marksKey = this.ringsKey = '';
    this.marksAgain = 0;
    this.paintOverlay();
    this.redraw();
  }

  paintOverlay() {
    this.tintsOld = false;
    if (!this.pixels || !this.screen) return;
    const { job } = this.shown;
    if (!this.orders.has(job)) this.orders.set(job, []);
    const painted = paint(this.overlay, { pixels: this.pixels, map: this.map }, this.orders.get(job));
    if (painted.marks && this.marksKey) painted.found = this.marksWords;
    this.screen.setTints(painted.tiles);
    this.tints++;
    legend(this.controls.legend, this.overlay, painted, this.mapTrouble);
  }

  /* Large answers are asked for less often. */
  async askMap() {
    const { job, frame } = this.shown, wanted = OVERLAYS[this.overlay].needsMap || this.at;
    if (!wanted || this.mapBusy || performance.now() < this.mapAsked || (this.map && this.mapComplete)) return;
    this.mapBusy = true;
    const begun = performance.now();
    try {
      const map = await this.context.api.get(`/jobs/${job}/frames/${frame}/tiles?shares=true`);
      if (this.shown.job === job && this.shown.frame === frame) Object.assign(this, { map, mapComplete: this.complete, mapTrouble: '' });
    } catch (why) { this.mapTrouble = why.message; }
    this.mapBusy = false;
    const wait = Math.max(MAP_EVERY_MS, 10 * (performance.now() - begun));
    this.mapAsked = performance.now() + wait;
    clearTimeout(this.mapTimer);
    this.mapTimer = setTimeout(() => this.redraw(), wait);
    this.paintOverlay();
    this.redraw();
  }

  /* ---- one pixel ---- */

  pointed(pixel, byKeys) {
    this.at = pixel;
    this.reading.setAttribute('aria-live', byKeys ? 'polite' : 'off');
    this.redraw();
    if (!pixel) text(this.reading, '');
  }

  readAt() {
    if (!this.at) return;
    const [x, y] = this.at, linear = this.pixels.at(x, y), words = [`${x}, ${y}`], { panes } = this.drawn;
    this.shownAt = this.at;
    const pane = panes.at(this.view.screen(this.at)[0] < this.split * this.canvas.width ? 0 : -1);
    const short = (n) => Math.abs(n) >= 1e4 || (n !== 0 && Math.abs(n) < 1e-3) ? n.toExponential(2) : String(Number(n.toPrecision(3)));
    const tile = Math.floor(y / 16) * this.pixels.across + Math.floor(x / 16);
    if (!linear) words.push('no samples yet');
    else if (!isLight(this.layer)) words.push(`${linear.slice(0, 3).map(short).join(' ')} ${layerUnit(this.layer)}`.trim());
    else {
      words.push(`linear ${linear.slice(0, 3).map(short).join(' ')}`);
      const codes = this.screen.codesAt(pane, x, y, 0);
      if (codes) words.push(`display ${codes.map((c) => Math.round(c)).join(' ')}`);
      const more = codes && !pane.image && linear[3] >= 0 && this.screen.codesAt(pane, x, y, 1);
      if (more) words.push(`\u00b1 ${codesText(Math.max(...more.map((c, i) => Math.abs(c - codes[i]))))}`);
    }
    words.push(`tile ${tile}`, ...this.tileWords(tile));
    const all = words.join(' \u00b7 ');
    text(this.reading, all);
    this.reading.title = all;
  }

  tileWords(tile) {
    const known = this.map?.tiles[tile], samples = this.pixels.samples[tile], words = [];
    const owner = known ? ownerOf(known) : {}, worker = owner.worker > 0 && this.map.workers?.[owner.worker - 1];
    if (worker) words.push(`${worker.name}${owner.thread ? `, thread ${owner.thread}` : ''}${known.shares?.length > 1 ? ` and ${known.shares.length - 1} more` : ''}`);
    if (samples) words.push(`${samplesText(samples)} samples`);
    if (known?.error > 0) words.push(`tile's error ${codesText(known.error)}`);
    if (known?.units) words.push(`${known.units} passes`);
    if (Number(known?.cpu_ns) > 0) words.push(secondsText(known.cpu_ns / 1e9));
    return words;
  }

  /* ---- what people do ---- */

  async apply() {
    const { look } = this.controls, info = this.context.info();
    try {
      const output = await outputOf(look, info.output, this.context.api);
      await this.context.act('develop', [this.job], { output });
    } catch (why) { this.context.trouble(why); }
  }

  /* The picture as it is seen, at 1:1, in the first operator's look. */
  codes() { return this.screen.codes(this.panes()[0]); }

  async save() {
    if (!this.screen) { this.context.say('Only the preview is there: the menu of the browser saves it.'); return; }
    const image = this.codes(), canvas = h('canvas', { width: image.width, height: image.height });
    canvas.getContext('2d').putImageData(image, 0, 0);
    const url = URL.createObjectURL(await new Promise((done) => canvas.toBlob(done)));
    h('a', { href: url, download: `${this.context.info()?.name || 'picture'}-${this.shown.frame}-${this.controls.look.operator}.png` }).click();
    setTimeout(() => URL.revokeObjectURL(url), 10000);
  }

  /* ---- without WebGL 2 ---- */

  withoutScreen(why) {
    if (this.stop) this.stop();
    this.screen = this.stop = null;
    this.image = h('img', { class: 'picture', alt: '' });
    this.canvas.replaceWith(this.image);
    this.canvas = this.image;
    this.whyNot = why.message;
    this.showPreview();
  }

  /* The live connection is back. */
  withScreen() {
    if (!this.resting) return;
    this.canvas.replaceWith(this.resting.canvas);
    Object.assign(this, this.resting, { resting: null, pixels: null, previewShown: null });
    this.select();
  }

  /* Asked for, not named as src: the same address is another picture a moment later. */
  async fetchPreview(path, image) {
    let url;
    try { url = URL.createObjectURL(await (await this.context.api.ask(path)).blob()); } catch { return; } /* as before, until the next time */
    image.onload = image.onerror = () => URL.revokeObjectURL(url);
    if (path === this.previewShown) image.src = url;
  }

  showPreview() {
    const info = this.context.info(), now = performance.now(), look = this.controls?.look;
    this.note.textContent = `The coordinator's preview: ${this.whyNot}.`;
    if (!info || !look) return;
    const path = this.previewPath(look);
    if (path === this.previewShown && now < this.previewAgain) return;
    this.previewShown = path;
    this.previewAgain = now + DRAWN_AGAIN_MS;
    this.fetchPreview(path, this.image);
    this.image.alt = `${info.name}, frame ${this.context.shownFrame()}`;
  }
}

export function mountPicture(element, context) {
  const picture = new Picture(element, context);
  element.picture = picture;
  return picture;
}
