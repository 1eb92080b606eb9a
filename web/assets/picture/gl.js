/* gl: draws a picture by WebGL 2: its pixels in a texture, an operator in the fragment shader, a colour a tile
 * over it. Throws where there is no WebGL 2.
 *
 *   screen = new Screen(canvas); screen.setPixels(pixels); screen.changed(tile) ...; screen.draw(panes, view, opacity, all)
 *
 * What was drawn stays on the canvas, so that only changed tiles need to be drawn: without a graphics card the
 * whole picture takes some 100 ms. All that the card holds is made again from `pixels` when its context was lost.
 */
import { OPERATORS } from './tonemap.js';
import { TILE, NOTHING, halfToFloat } from './pixels.js';

const NO_LIGHT = halfToFloat(NOTHING);
const UPLOADED_AT_ONCE = 2048;        /* tiles, 4 MB: between two of these people are served */

/* An instance is a rectangle: left, top, right and bottom in canvas pixels. */
const VERTEX = `#version 300 es
layout(location = 0) in vec4 place;
uniform vec2 room;
void main() {
  vec2 at = vec2((gl_VertexID & 1) == 0 ? place.x : place.z, (gl_VertexID & 2) == 0 ? place.y : place.w);
  gl_Position = vec4(at / room * vec2(2., -2.) + vec2(-1., 1.), 0., 1.);
}`;

/* What is not light is shown as it is: these are operators for layers. p: lowest and highest value. */
const LAYERS = {
  raw: { codes: true, glsl: 'return c;' },
  direction: { codes: true, signed: true, glsl: 'return length(c) > 0. ? .5 + .5 * c : vec3(0.);' },
  range: { codes: true, signed: true, glsl: 'return (c - p[0]) / (p[1] - p[0]);' },
  near: { codes: true, glsl: 'return c.r > 0. ? vec3(1. - .9 * log(c.r / p[0]) / log(p[1] / p[0])) : vec3(0.);' },
  number: {
    codes: true,
    glsl: 'uint h = uint(c.r) * 2654435769u; return c.r > 0. ? .25 + .7 * vec3(h >> 24, h >> 16 & 255u, h >> 8 & 255u) / 255. : vec3(0.);',
  },
};

/* `developed`: codes from the coordinator. `error`: the operator's answer to one standard error, on the scale. */
const source = (row, kind) => `#version 300 es
precision highp float;
precision highp int;
uniform highp sampler2D picture;
uniform highp sampler2D scale;
uniform sampler2D tints;
uniform mat3 exposure;
uniform float p[8];
uniform vec4 view; /* canvas coordinates of the picture's corner, canvas pixels a pixel, canvas height */
uniform vec2 tint; /* opacity; standard errors to add */
uniform vec3 empty, around;
uniform vec2 codes; /* of the error scale: ln of its ends */
out vec4 result;
const vec3 weights = vec3(.212656, .715158, .072186);
float luminance(vec3 c) { return dot(weights, c); }
vec3 srgb(vec3 c) {
  c = clamp(c, 0., 1.);
  return mix(1.055 * pow(c, vec3(1. / 2.4)) - .055, 12.92 * c, lessThanEqual(c, vec3(.0031308)));
}
${row.before || ''}
vec3 tone(vec3 c) {${row.glsl}
}
vec3 shown(vec3 light) {
  vec3 c = tone(${row.signed ? 'light' : 'clamp(exposure * max(light, 0.), 0., 3e38)'});
  return clamp(${row.codes ? 'c' : 'srgb(c)'}, 0., 1.);
}
vec3 nudged(vec4 raw, float by) { return raw.rgb * max(1. + by * raw.a / max(luminance(max(raw.rgb, 0.)), 1e-9), 0.); }
void main() {
  ivec2 size = textureSize(picture, 0);
  vec2 at = (vec2(gl_FragCoord.x, view.w - gl_FragCoord.y) - view.xy) / view.z;
  ivec2 pixel = ivec2(floor(at));
  if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, size))) { result = vec4(around, 1.); return; }
  /* A canvas pixel that covers several: their mean, in which bright ones weigh less, as on a display. */
  int n = view.z < 1. ? min(int(ceil(1. / view.z - .2)), 4) : 1;
  vec4 sum = vec4(0.);
  float all = 0.;
  for (int i = 0; i < n * n; i++) {
    vec2 off = n > 1 ? (vec2(i % n, i / n) + .5) / float(n) - .5 : vec2(0.);
    vec4 raw = texelFetch(picture, clamp(n > 1 ? ivec2(floor(at + off / view.z)) : pixel, ivec2(0), size - 1), 0);
    if (raw.r < -65000.) continue;
    float w = n > 1 ? 1. / (1. + luminance(abs(exposure * raw.rgb))) : 1.;
    sum += w * raw;
    all += w;
  }
  vec3 c = empty;
  if (all > 0.) {
    sum /= all;
    ${kind === 'developed' ? 'c = sum.rgb;' : kind === 'error' ? `
    vec3 d = abs(shown(nudged(sum, 1.)) - shown(sum.rgb)) * 255.;
    float e = (log(max(max(d.r, max(d.g, d.b)), 1e-6)) - codes.x) / (codes.y - codes.x);
    c = texture(scale, vec2(clamp(e, .002, .998), .5)).rgb;` : 'c = shown(tint.y == 0. ? sum.rgb : nudged(sum, tint.y));'}
  }
  vec4 over = texelFetch(tints, pixel / ${TILE}, 0);
  result = vec4(mix(c, over.rgb, over.a * tint.x), 1.);
}`;

export class Screen {
  constructor(canvas) {
    this.canvas = canvas;
    this.gl = canvas.getContext('webgl2', { alpha: false, antialias: false, depth: false, preserveDrawingBuffer: true, powerPreference: 'low-power' });
    if (!this.gl) throw new Error('this browser has no WebGL 2');
    this.colors = { around: [0.118, 0.118, 0.118], empty: [0.14, 0.14, 0.14] };
    this.begin();
    canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
    canvas.addEventListener('webglcontextrestored', () => { this.begin(); this.onrestored?.(); });
  }

  begin() {
    const { gl } = this;
    this.programs = new Map();
    this.textures = { picture: gl.createTexture(), tints: gl.createTexture(), scale: gl.createTexture() };
    this.files = new Map();            /* a cube's tables -> textures */
    this.images = new Map();           /* a developed picture -> texture */
    this.probe = this.fence = null;
    this.drawsFloats = gl.getExtension('EXT_color_buffer_float') || gl.getExtension('EXT_color_buffer_half_float');
    gl.bindVertexArray(gl.createVertexArray());
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 4, gl.FLOAT, false, 0, 0);
    gl.vertexAttribDivisor(0, 1);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    if (this.pixels) this.setPixels(this.pixels);
    if (this.ramp) this.setScale(this.ramp);
  }

  texture(target, texture, filter) {
    const { gl } = this;
    gl.bindTexture(target, texture);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(target, name, filter || gl.NEAREST);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(target, name, gl.CLAMP_TO_EDGE);
  }

  setPixels(pixels) {
    const { gl } = this;
    if (pixels.width > gl.getParameter(gl.MAX_TEXTURE_SIZE) || pixels.height > gl.getParameter(gl.MAX_TEXTURE_SIZE))
      throw new Error(`the picture is larger than this graphics card's textures`);
    this.pixels = pixels;
    this.waiting = new Set();
    this.beginPicture();
    for (let tile = 0; tile < pixels.tiles; tile++) if (pixels.samples[tile] > 0) this.waiting.add(tile);
    this.tiles = new Uint8Array(pixels.tiles * 4);
    this.setTints(this.tiles);
  }

  /* A picture without pixels, of which none goes to the card: one of 8K would keep the page from all else for seconds. */
  beginPicture() {
    const { gl, pixels, textures } = this, { width, height } = pixels;
    gl.deleteTexture(textures.picture);
    textures.picture = gl.createTexture();
    this.texture(gl.TEXTURE_2D, textures.picture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA16F, width, height);
    if (this.drawsFloats) {
      const buffer = gl.createFramebuffer();
      gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, textures.picture, 0);
      gl.clearBufferfv(gl.COLOR, 0, [NO_LIGHT, 0, 0, 0]);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      gl.deleteFramebuffer(buffer);
    } else for (let line = 0; line < pixels.down; line++) this.uploadLine(line);
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0); /* a question to the card would wait for it */
    gl.flush();
  }

  changed(tile) { this.waiting.add(tile); }

  /* More wait than are drawn at once? */
  get isFull() { return this.waiting.size >= UPLOADED_AT_ONCE; }

  /* RGBA of each tile. */
  setTints(tiles) {
    const { gl, pixels } = this;
    this.texture(gl.TEXTURE_2D, this.textures.tints);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, pixels.across, pixels.down, 0, gl.RGBA, gl.UNSIGNED_BYTE, tiles);
  }

  /* RGBA of the error scale, 256 colours. */
  setScale(ramp) {
    const { gl } = this;
    this.ramp = ramp;
    this.texture(gl.TEXTURE_2D, this.textures.scale, gl.LINEAR);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, ramp.length / 4, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, ramp);
  }

  uploadTile(tile) {
    const { gl, pixels } = this, { x, y, width, height } = pixels.place(tile);
    gl.pixelStorei(gl.UNPACK_ROW_LENGTH, pixels.width);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, x, y, width, height, gl.RGBA, gl.HALF_FLOAT, pixels.data, (y * pixels.width + x) * 4);
    gl.pixelStorei(gl.UNPACK_ROW_LENGTH, 0);
  }

  uploadLine(line) {
    const { gl, pixels } = this, y = line * TILE;
    pixels.begin(line);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, y, pixels.width, Math.min(TILE, pixels.height - y), gl.RGBA, gl.HALF_FLOAT, pixels.data, y * pixels.width * 4);
  }

  /* So many of the tiles that wait, those first that came first; the others wait on. Returns them. Many of a line: as one. */
  upload(most = this.waiting.size) {
    const { gl, pixels, waiting } = this, now = [], lines = new Map();
    for (const tile of waiting) {
      if (now.length >= most) break;
      const line = Math.floor(tile / pixels.across);
      if (!lines.has(line)) lines.set(line, []);
      lines.get(line).push(tile);
      now.push(tile);
    }
    if (!now.length) return now;
    gl.bindTexture(gl.TEXTURE_2D, this.textures.picture);
    for (const [line, tiles] of lines) {
      if (tiles.length > pixels.across / 4) { this.uploadLine(line); continue; }
      for (const tile of tiles) this.uploadTile(tile);
    }
    for (const tile of now) waiting.delete(tile);
    return now;
  }

  program(operator, kind) {
    const { gl } = this, key = `${operator} ${kind}`;
    if (this.programs.has(key)) return this.programs.get(key);
    const program = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, VERTEX],
      [gl.FRAGMENT_SHADER, source(OPERATORS[operator] || LAYERS[operator], kind)]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost())
        throw new Error(`the shader of ${operator}: ${gl.getShaderInfoLog(shader)}`);
    }
    gl.linkProgram(program);
    const made = { program, at: new Map() };
    for (let i = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) - 1; i >= 0; i--) {
      const { name } = gl.getActiveUniform(program, i);
      made.at.set(name.replace('[0]', ''), gl.getUniformLocation(program, name));
    }
    this.programs.set(key, made);
    return made;
  }

  fileTextures(file) {
    const { gl } = this;
    if (this.files.has(file)) return this.files.get(file);
    const made = { line: gl.createTexture(), cube: gl.createTexture() }, { line, cube } = file;
    const side = cube.size || 1, width = Math.min(line.size || 1, 1024), rows = Math.ceil((line.size || 1) / width);
    const padded = new Float32Array(width * rows * 3);
    padded.set(line.entries);
    this.texture(gl.TEXTURE_2D, made.line);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB32F, width, rows, 0, gl.RGB, gl.FLOAT, padded);
    this.texture(gl.TEXTURE_3D, made.cube);
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGB32F, side, side, side, 0, gl.RGB, gl.FLOAT, cube.size ? cube.entries : new Float32Array(3));
    this.files.set(file, made);
    return made;
  }

  imageTexture(image) {
    const { gl } = this;
    if (this.images.has(image)) return this.images.get(image);
    for (const old of this.images.values()) gl.deleteTexture(old);
    this.images.clear();
    const made = gl.createTexture();
    this.texture(gl.TEXTURE_2D, made);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, image);
    this.images.set(image, made);
    return made;
  }

  bind(unit, name, target, texture, at) {
    const { gl } = this;
    if (!at.has(name)) return;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(target, texture);
    gl.uniform1i(at.get(name), unit);
    gl.activeTexture(gl.TEXTURE0);
  }

  /* pane: {operator, exposure, p, file, image, kind}; view: {x, y, scale}; room: [width, height] of what is drawn to,
   * of which `places` are drawn, four numbers each; tint: [opacity, standard errors]. */
  pane(pane, view, room, tint, places = [0, 0, ...room]) {
    const { gl } = this, kind = pane.image ? 'developed' : pane.kind || 'light';
    const { program, at } = this.program(kind === 'developed' ? 'raw' : pane.operator, kind);
    const tables = pane.file && this.fileTextures(pane.file);
    const set = (name, how, ...value) => at.has(name) && gl[how](at.get(name), ...value);
    gl.useProgram(program);
    this.bind(0, 'picture', gl.TEXTURE_2D, pane.image ? this.imageTexture(pane.image) : this.textures.picture, at);
    this.bind(1, 'tints', gl.TEXTURE_2D, this.textures.tints, at);
    this.bind(2, 'scale', gl.TEXTURE_2D, this.textures.scale, at);
    if (tables) {
      const { line, cube } = pane.file;
      this.bind(3, 'line', gl.TEXTURE_2D, tables.line, at);
      this.bind(4, 'cube', gl.TEXTURE_3D, tables.cube, at);
      set('entries', 'uniform2i', line.size, cube.size);
      set('domain', 'uniform3fv', [line.min, line.max, cube.min, cube.max].flat());
    }
    set('exposure', 'uniformMatrix3fv', true, pane.exposure || [1, 0, 0, 0, 1, 0, 0, 0, 1]);
    set('p', 'uniform1fv', Float32Array.from({ length: 8 }, (_, i) => pane.p?.[i] ?? 0));
    set('room', 'uniform2f', ...room);
    set('view', 'uniform4f', view.x, view.y, view.scale, room[1]);
    set('tint', 'uniform2f', ...tint);
    set('codes', 'uniform2f', ...(pane.codes || [0, 1]).map(Math.log));
    set('empty', 'uniform3fv', this.colors.empty);
    set('around', 'uniform3fv', this.colors.around);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(places), gl.STREAM_DRAW);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, places.length / 4);
  }

  /* Where these canvas pixels are that pixels x to x + width, y to y + height have a part in; [] outside. */
  placeOf({ x, y, width, height }, view) {
    const { canvas } = this, least = (n) => Math.max(Math.floor(n - 0.01), 0), most = (n, size) => Math.min(Math.ceil(n + 0.01), size);
    const left = least(view.x + x * view.scale), right = most(view.x + (x + width) * view.scale, canvas.width);
    const top = least(view.y + y * view.scale), bottom = most(view.y + (y + height) * view.scale, canvas.height);
    return left < right && top < bottom ? [left, top, right, bottom] : [];
  }

  /* One pane, or two with view.split, the canvas column where the second begins. Not `all`: only the tiles that
   * changed since, as the same panes and the same view show them. */
  draw(panes, view, opacity, all) {
    const { gl, canvas, pixels } = this, split = panes.length > 1 ? Math.round(view.split) : canvas.width;
    if (gl.isContextLost()) return;
    const tiles = this.upload(UPLOADED_AT_ONCE);
    const places = all ? this.placeOf({ x: 0, y: 0, width: pixels.width, height: pixels.height }, view)
      : tiles.flatMap((tile) => this.placeOf(pixels.place(tile), view));
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, canvas.width, canvas.height);
    if (all) this.clear();
    gl.enable(gl.SCISSOR_TEST);
    panes.forEach((pane, i) => {
      gl.scissor(i ? split : 0, 0, i ? canvas.width - split : split, canvas.height);
      this.pane(pane, view, [canvas.width, canvas.height], [opacity, 0], places);
    });
    gl.disable(gl.SCISSOR_TEST);
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
  }

  clear() {
    const { gl } = this;
    gl.clearColor(...this.colors.around, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
  }

  /* Has all been drawn? Until then more would only wait in line, and the page's own drawing behind it. */
  get isDone() {
    const { gl } = this;
    if (!this.fence || gl.isContextLost()) return true;
    if (gl.getSyncParameter(this.fence, gl.SYNC_STATUS) !== gl.SIGNALED) return false;
    gl.deleteSync(this.fence);
    this.fence = null;
    return true;
  }

  target(width, height, isFloat) {
    const { gl } = this, texture = gl.createTexture(), made = { buffer: gl.createFramebuffer(), texture };
    this.texture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, isFloat ? gl.RGBA32F : gl.RGBA8, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, made.buffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    return made;
  }

  /* Codes 0..255 of one pixel with so many standard errors added: not rounded where the card can tell. */
  codesAt(pane, x, y, errors) {
    const { gl, pixels } = this, tile = Math.floor(y / TILE) * pixels.across + Math.floor(x / TILE);
    if (gl.isContextLost()) return null;
    gl.bindTexture(gl.TEXTURE_2D, this.textures.picture);
    if (this.waiting.has(tile)) this.uploadTile(tile); /* it goes on waiting: it is not drawn yet */
    if (!this.probe) {
      const isFloat = Boolean(gl.getExtension('EXT_color_buffer_float'));
      this.probe = { ...this.target(1, 1, isFloat), isFloat };
    }
    const { isFloat, buffer } = this.probe, out = isFloat ? new Float32Array(4) : new Uint8Array(4);
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    gl.viewport(0, 0, 1, 1);
    this.pane({ ...pane, kind: undefined }, { x: -x, y: -y, scale: 1 }, [1, 1], [0, errors]);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, isFloat ? gl.FLOAT : gl.UNSIGNED_BYTE, out);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return [0, 1, 2].map((c) => isFloat ? 255 * out[c] : out[c]);
  }

  /* The whole picture at 1:1 as RGBA bytes, rows from top to bottom, with so many standard errors added. */
  codes(pane, errors = 0) {
    const { gl } = this, { width, height } = pane.image || this.pixels, out = new Uint8ClampedArray(width * height * 4);
    for (const tile of this.upload()) this.waiting.add(tile); /* they are not drawn yet */
    const { buffer, texture } = this.target(width, height, false);
    gl.viewport(0, 0, width, height);
    this.pane({ ...pane, kind: undefined }, { x: 0, y: 0, scale: 1 }, [width, height], [0, errors]);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(out.buffer));
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(buffer);
    gl.deleteTexture(texture);
    for (let y = 0; y < height >> 1; y++) {
      const a = y * width * 4, b = (height - 1 - y) * width * 4, row = out.slice(a, a + width * 4);
      out.copyWithin(a, b, b + width * 4);
      out.set(row, b);
    }
    return new ImageData(out, width, height);
  }
}

/* How often something expensive may be done again.
 *
 *   begin ... end --took longer than an animation frame or two--> rests four times as long --> begin
 *
 * Without a graphics card the whole of a picture takes some 100 ms, during which the page cannot scroll: then that is done
 * for a fifth of the time at most.
 */
const SHORT_MS = 25, RESTS = 4;

export class Pace {
  /* `least`: milliseconds from one beginning to the next. */
  constructor(least = 0) { Object.assign(this, { least, begun: 0, until: 0 }); }

  begin() { this.begun = this.begun || performance.now(); }

  end() {
    if (!this.begun) return;
    const now = performance.now(), took = now - this.begun;
    this.until = took > SHORT_MS ? now + RESTS * took : this.begun + this.least;
    this.begun = 0;
  }

  /* Milliseconds to wait; 0: at once. */
  get rest() { return Math.max(this.until - performance.now(), 0); }
}
