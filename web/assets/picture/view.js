/* view: which part of a picture a canvas shows: wheel, pinch, drag, keys. In device pixels, so that at scale 1 a
 * pixel of the picture is one of the screen.
 *
 *   fitted --wheel, pinch, +, -, 1--> free --0--> fitted
 */
const LARGEST = 64;
const STEP = Math.SQRT2;

export class View {
  /* changed(): draw again; pointed(pixel or null, byKeys). */
  constructor(canvas, changed, pointed) {
    Object.assign(this, { canvas, changed, pointed, x: 0, y: 0, scale: 1, fitted: true, size: [0, 0], cursor: null });
    this.fingers = new Map();
    canvas.addEventListener('wheel', (event) => this.wheel(event), { passive: false });
    canvas.addEventListener('pointerdown', (event) => this.down(event));
    canvas.addEventListener('pointermove', (event) => this.move(event));
    for (const name of ['pointerup', 'pointercancel']) canvas.addEventListener(name, (event) => this.fingers.delete(event.pointerId));
    canvas.addEventListener('pointerleave', () => this.fingers.size || this.point(null));
    canvas.addEventListener('dblclick', (event) => { if (this.fitted) this.zoomTo(1, this.place(event)); else this.fit(); });
    canvas.addEventListener('keydown', (event) => this.key(event));
    const observer = new ResizeObserver((entries) => this.resized(entries.at(-1)));
    try { observer.observe(canvas, { box: 'device-pixel-content-box' }); } catch { observer.observe(canvas); }
  }

  /* The canvas has as many pixels as the screen has under it. */
  resized({ devicePixelContentBoxSize: exact, contentRect }) {
    const ratio = window.devicePixelRatio || 1;
    /* The browser's own number where it has one: a rounded one may be off by a pixel, which blurs all. */
    const pixels = (own, css) => Math.abs(own - css * ratio) < 1.01 ? own : Math.round(css * ratio);
    const width = pixels(exact?.[0].inlineSize, contentRect.width), height = pixels(exact?.[0].blockSize, contentRect.height);
    if (!width || !height) return;
    const before = [this.canvas.width, this.canvas.height];
    this.pixelRatio = width / contentRect.width;
    if (before[0] === width && before[1] === height) return; /* setting them again would empty it */
    this.canvas.width = width;
    this.canvas.height = height;
    if (this.fitted) this.fit();
    else { this.x += (width - before[0]) >> 1; this.y += (height - before[1]) >> 1; this.settle(); }
  }

  setSize(width, height) {
    if (this.size[0] === width && this.size[1] === height) return;
    this.size = [width, height];
    this.cursor = null;
    this.fit();
  }

  get ratio() { return this.pixelRatio || window.devicePixelRatio || 1; }
  get fitting() {
    const { width, height } = this.canvas;
    return Math.min(width / (this.size[0] || 1), height / (this.size[1] || 1)) || 1;
  }

  fit() {
    this.fitted = true;
    this.scale = this.fitting;
    this.x = this.y = 0;
    this.settle();
  }

  /* A picture that is smaller than the canvas is in its middle, a larger one leaves no margin. */
  settle() {
    const [width, height] = this.size.map((n) => n * this.scale), { canvas } = this;
    const keep = (at, room, size) => Math.round(size <= room ? (room - size) / 2 : Math.min(0, Math.max(room - size, at)));
    this.x = keep(this.x, canvas.width, width);
    this.y = keep(this.y, canvas.height, height);
    this.changed();
  }

  /* `at`: what stays in its place, in canvas pixels; else the middle. */
  zoomTo(scale, at = [this.canvas.width / 2, this.canvas.height / 2]) {
    const before = this.scale, least = Math.min(this.fitting, 1) / 2;
    this.scale = Math.min(Math.max(scale, least), Math.max(LARGEST, this.fitting));
    if (Math.abs(Math.log(this.scale)) < 0.04) this.scale = 1;
    this.fitted = false;
    this.x = at[0] - (at[0] - this.x) * this.scale / before;
    this.y = at[1] - (at[1] - this.y) * this.scale / before;
    this.settle();
  }

  zoom(by, at) { this.zoomTo(this.scale * by, at); }

  place(event) {
    const box = this.canvas.getBoundingClientRect();
    return [(event.clientX - box.left) * this.ratio, (event.clientY - box.top) * this.ratio];
  }

  pixel([x, y]) {
    const at = [Math.floor((x - this.x) / this.scale), Math.floor((y - this.y) / this.scale)];
    return at[0] >= 0 && at[1] >= 0 && at[0] < this.size[0] && at[1] < this.size[1] ? at : null;
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    this.zoom(Math.exp(-event.deltaY * lines * (event.ctrlKey ? 0.01 : 0.002)), this.place(event));
  }

  down(event) {
    if (event.button !== 0) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, this.place(event));
    if (event.pointerType === 'touch') this.point(this.pixel(this.place(event)));
  }

  move(event) {
    const at = this.place(event), before = this.fingers.get(event.pointerId);
    if (!before) return this.point(this.pixel(at));
    const others = [...this.fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    this.fingers.set(event.pointerId, at);
    if (others.length) {                     /* two fingers: what is between them follows */
      const other = others[0], far = (a) => Math.hypot(a[0] - other[0], a[1] - other[1]) || 1;
      this.zoom(far(at) / far(before), [(at[0] + other[0]) / 2, (at[1] + other[1]) / 2]);
      this.x += (at[0] - before[0]) / 2;
      this.y += (at[1] - before[1]) / 2;
    } else {
      this.fitted = this.fitted && this.scale <= this.fitting;
      this.x += at[0] - before[0];
      this.y += at[1] - before[1];
    }
    this.settle();
  }

  point(pixel, byKeys) {
    this.cursor = byKeys ? pixel : null;
    this.pointed(pixel, byKeys);
    if (byKeys) this.changed();
  }

  /* Arrows move a cursor by a pixel, with shift by a tile; the view follows. */
  key(event) {
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!steps || event.ctrlKey || event.altKey || event.metaKey || !this.size[0]) {
      if (event.key === 'Escape' && this.cursor) this.point(null, true);
      return;
    }
    event.preventDefault();
    const from = this.cursor || this.size.map((n) => n >> 1), by = event.shiftKey ? 16 : 1;
    const to = from.map((n, i) => Math.min(Math.max(n + (this.cursor ? steps[i] * by : 0), 0), this.size[i] - 1));
    const [x, y] = this.screen(to), { width, height } = this.canvas;
    if (x < 0 || x + this.scale > width) this.x += width / 2 - x;
    if (y < 0 || y + this.scale > height) this.y += height / 2 - y;
    this.settle();
    this.point(to, true);
  }

  /* A pixel's corner in canvas pixels. */
  screen([x, y]) { return [this.x + x * this.scale, this.y + y * this.scale]; }
}
