/* tonemap: the operators of common/tonemap that need no other pixels, as fragment shaders.
 *
 *   pixel --white balance, exposure--> exposed --operator--> display light --sRGB--> codes 0..1
 *
 * A row: `glsl`, the body of vec3 tone(vec3 c) on exposed light, with p[0..7] for its numbers; `numbers`, which
 * makes them of the parameters' values and of what was measured; `codes`: the result is codes already.
 * The C files named like the operators have the sources and reasons.
 */
import { WEIGHTS, invert, multiply, toRec709, whiteBalance } from './color.js';

/* In GLSL `v * matrix` with a matrix written by rows is the matrix times the vector. */
const times = (m) => `mat3(${m.map((x) => x.toFixed(12))})`;

const ACES_WHITE = [0.32168, 0.33767];
const AP1_LUMINANCE = [0.2722287168, 0.6740817658, 0.0536895174];

function acesShader() {
  const fromAp0 = toRec709({ red: [0.7347, 0.2653], green: [0, 1], blue: [0.0001, -0.0770], white: ACES_WHITE });
  const fromAp1 = toRec709({ red: [0.713, 0.293], green: [0.165, 0.830], blue: [0.128, 0.044], white: ACES_WHITE });
  const desaturate = [0, 1, 2].flatMap((i) => [0, 1, 2].map((j) => 0.07 * AP1_LUMINANCE[j] + (i === j ? 0.93 : 0)));
  const grey = Math.log10(0.18), stop = Math.log10(2);
  return {
    before: `
const float rl[5] = float[](-4., -4., -3.1573765773, -.4852499958, 1.8477324706);
const float rh[5] = float[](-.7185482425, 2.0810307172, 3.6681241237, 4., 4.);
const float ol[9] = float[](-1.6989700043, -1.6989700043, -1.4779, -1.2291, -.8648, -.4480, .00518, .4511080334, .9113744414);
const float oh[9] = float[](.5154386965, .8470437783, 1.1358, 1.3802, 1.5197, 1.5985, 1.6467, 1.6746091357, 1.6878733390);
float knots(float a, float b, float c, float t) { return .5 * (a + b) + t * ((b - a) + t * .5 * (a - 2. * b + c)); }
float rrt(float x) {
  const float lo = ${grey - 15 * stop}, mid = ${grey}, hi = ${grey + 18 * stop};
  if (x <= lo) return -4.;
  if (x >= hi) return 4.;
  float u = 3. * (x < mid ? (x - lo) / (mid - lo) : (x - mid) / (hi - mid));
  int i = min(int(u), 2);
  return x < mid ? knots(rl[i], rl[i + 1], rl[i + 2], u - float(i)) : knots(rh[i], rh[i + 1], rh[i + 2], u - float(i));
}
float odt(float x) {
  float lo = rrt(${grey - 6.5 * stop}), hi = rrt(${grey + 6.5 * stop});
  const float mid = ${Math.log10(4.8)};
  if (x <= lo) return ${Math.log10(0.02)};
  if (x >= hi) return ${Math.log10(48)} + .04 * (x - hi);
  float u = 7. * (x < mid ? (x - lo) / (mid - lo) : (x - mid) / (hi - mid));
  int i = min(int(u), 6);
  return x < mid ? knots(ol[i], ol[i + 1], ol[i + 2], u - float(i)) : knots(oh[i], oh[i + 1], oh[i + 2], u - float(i));
}
float tone1(float x) {
  if (x < .002) return 0.;
  return (pow(10., odt(rrt(log(x) * ${Math.LOG10E}))) - .02) / 47.98;
}`,
    glsl: `
vec3 a = c * ${times(invert(fromAp0))};
float high = max(a.r, max(a.g, a.b)), low = min(a.r, min(a.g, a.b));
float saturation = (max(high, 1e-10) - max(low, 1e-10)) / max(high, 1e-2);
vec3 d = a - a.gbr;
float y = (a.r + a.g + a.b + 1.75 * sqrt(.5 * dot(d, d))) / 3.;
if (y < .16) {
  float x = (saturation - .4) / .2, t = max(1. - .5 * abs(x), 0.), gain = .025 * (x < 0. ? t * t : 2. - t * t);
  a *= 1. + (y <= .16 / 3. ? gain : gain * (.08 / y - .5));
}
float x = 2. * a.r - a.g - a.b;
if (x > 0.) {
  float u = abs(atan(sqrt(3.) * (a.g - a.b), x)) * ${180 / Math.PI / (135 / 4)};
  float red = u >= 2. ? 0. : u >= 1. ? .25 * (2. - u) * (2. - u) * (2. - u) : .25 * ((3. * u - 6.) * u * u + 4.);
  a.r += red * saturation * (.03 - a.r) * .18;
}
const vec3 weights = vec3(${AP1_LUMINANCE});
vec3 v = clamp(max(a, 0.) * ${times(multiply(invert(fromAp1), fromAp0))}, 0., 65504.);
v = mix(vec3(dot(weights, v)), v, .96);
v = vec3(tone1(v.r), tone1(v.g), tone1(v.b));
float l = max(dot(weights, v), 1e-9);
return max(v * ${times(multiply(fromAp1, desaturate))} * pow(l, -.0189), 0.);`,
  };
}

const AGX_INSET = [0.842479062253094, 0.0784335999999992, 0.0792237451477643, 0.0423282422610123, 0.878468636469772,
  0.0791661274605434, 0.0423756549057051, 0.0784336, 0.879142973793104];

const hable = (x) => x * (0.15 * x * (1 - 0.02 / 0.30) + 0.50 * (0.10 - 0.02 / 0.30)) / (x * (0.15 * x + 0.50) + 0.20 * 0.30);

export const OPERATORS = {
  linear: { glsl: 'return c;' },
  gamma: {
    codes: true, glsl: 'return p[1] * pow(c, vec3(p[0]));', numbers: (v) => [1 / v.gamma, v.gain],
  },
  normalize: {
    glsl: 'return c * p[0];',
    numbers: (v, of) => [of.largest(v.percentile) > 0 ? 1 / of.largest(v.percentile) : 1],
  },
  reinhard02: {
    local: (v) => v.scale === 1,
    glsl: 'float l = p[0] * luminance(c); return c * (p[0] * (1. + l * p[1]) / (1. + l));',
    numbers(v, of) {
      const scale = v.key / of.logMean, white = v.white > 0 ? v.white : scale * of.most;
      return [scale, white > 0 ? 1 / (white * white) : 0];
    },
  },
  drago03: {
    glsl: `
float y = luminance(c);
if (!(y > 0.)) return c;
float a = p[0] * y, l = a < 1e-3 ? 1. - a * (.5 - a / 3.) : log(1. + a) / a;
return c * (p[3] * p[0] * l / log(2. + 8. * pow(min(y / p[1], 1.), p[2])));`,
    numbers(v, of) {
      const most = of.brightest(v.percentile);
      if (!(most > 0)) return [1, 1, 1, 1];
      const adaptation = (1 + v.bias - 0.85) ** 5 / of.logMean;
      return [adaptation, most, Math.log(v.bias) / Math.log(0.5),
        v.display / 100 * Math.LN10 / Math.log1p(adaptation * most)];
    },
  },
  aces: acesShader(),
  'aces-hill': {
    glsl: `
vec3 v = c * ${times([0.59719, 0.35458, 0.04823, 0.07600, 0.90834, 0.01566, 0.02840, 0.13383, 0.83777])};
v = (v * (v + .0245786) - .000090537) / (v * (.983729 * v + .4329510) + .238081);
return v * ${times([1.60475, -0.53108, -0.07367, -0.10208, 1.10813, -0.00605, -0.00327, -0.07276, 1.07602])};`,
  },
  agx: {
    codes: true,
    before: `
float curve(float x) {
  float t = (clamp(log2(x), -12.47393, 4.026069) + 12.47393) / 16.499999 - ${20 / 33};
  return x <= ${2 ** -12.47393} ? 0. : .5 + 2. * t * (t < 0. ? pow(1. - 59.507875 * t * t * t, -1. / 3.)
    : pow(1. + 69.862789 * pow(t, 3.25), -4. / 13.));
}`,
    glsl: `
c = c * ${times(AGX_INSET)};
c = vec3(curve(c.r), curve(c.g), curve(c.b));
return p[0] == 0. ? c : c * ${times(invert(AGX_INSET))};`,
    numbers: (v) => [v.outset],
  },
  'pbr-neutral': {
    glsl: `
float low = min(c.r, min(c.g, c.b)), offset = low <= .08 ? low - low * low / .16 : .04;
float peak = max(c.r, max(c.g, c.b)) - offset;
if (peak <= .76) return c - offset;
float squeezed = 1. - .0576 / (peak - .52), keep = 1. / (.15 * (peak - squeezed) + 1.);
return (c - offset) * (squeezed / peak * keep) + squeezed * (1. - keep);`,
  },
  hable: {
    glsl: `
vec3 x = p[0] * c;
return p[1] * (x * (${0.15 * (1 - 0.02 / 0.30)} * x + ${0.50 * (0.10 - 0.02 / 0.30)}) / (x * (.15 * x + .5) + .06));`,
    numbers: (v) => [v.bias, 1 / hable(v.white)],
  },
  lut: {
    codes: true, file: true,
    before: `
uniform highp sampler2D line;
uniform highp sampler3D cube;
uniform ivec2 entries;
uniform vec3 domain[4];
float lineAt(int i, int ch) { int w = textureSize(line, 0).x; return texelFetch(line, ivec2(i % w, i / w), 0)[ch]; }
vec3 throughLine(vec3 c) {
  vec3 at = clamp((c - domain[0]) / (domain[1] - domain[0]) * float(entries.x - 1), 0., float(entries.x - 1));
  for (int ch = 0; ch < 3; ch++) {
    int i = min(int(at[ch]), entries.x - 2);
    float below = lineAt(i, ch);
    c[ch] = below + (at[ch] - float(i)) * (lineAt(i + 1, ch) - below);
  }
  return c;
}
vec3 throughCube(vec3 c) {
  vec3 at = clamp((c - domain[2]) / (domain[3] - domain[2]) * float(entries.y - 1), 0., float(entries.y - 1));
  ivec3 i = min(ivec3(at), ivec3(entries.y - 2));
  vec3 t = at - vec3(i);
  bool rg = t.r >= t.g, gb = t.g >= t.b, rb = t.r >= t.b;
  ivec3 first = rg && rb ? ivec3(1, 0, 0) : !rg && gb ? ivec3(0, 1, 0) : ivec3(0, 0, 1);
  ivec3 last = gb && rb ? ivec3(0, 0, 1) : rg && !gb ? ivec3(0, 1, 0) : ivec3(1, 0, 0);
  float a = max(t.r, max(t.g, t.b)), d = min(t.r, min(t.g, t.b)), b = t.r + t.g + t.b - a - d;
  return (1. - a) * texelFetch(cube, i, 0).rgb + (a - b) * texelFetch(cube, i + first, 0).rgb +
    (b - d) * texelFetch(cube, i + 1 - last, 0).rgb + d * texelFetch(cube, i + 1, 0).rgb;
}`,
    glsl: `
if (p[0] == 0.) c = srgb(c);
else if (p[0] == 2.) c = (log2(max(c, 1.1754944e-38)) - p[2]) * p[3];
if (entries.x > 0) c = throughLine(c);
if (entries.y > 0) c = throughCube(c);
return p[1] == 1. ? srgb(c) : c;`,
    numbers: (v) => [v.input, v.result, Math.log2(0.18) + v['log2-min'], 1 / (v['log2-max'] - v['log2-min'])],
  },
};

/* Can the page compute it, with these values? */
export const isHere = (name, values) => Boolean(OPERATORS[name]) && !OPERATORS[name].local?.(values);

/* What the farm's settings make of a picture: {exposure: matrix by rows, p: numbers}.
 * look: {operator, values, ev, metering, percentile, kelvin}. */
export function prepare(look, pixels) {
  const { operator, values, ev, metering, percentile, kelvin } = look, row = OPERATORS[operator];
  const balance = whiteBalance(kelvin);
  pixels.setBalance(balance);
  const raw = pixels.measured();
  let metered = 1;
  if (raw.count > 0 && metering === 'key') metered = 0.18 / raw.logMean;
  else if (raw.count > 0 && metering === 'percentile') metered = 1 / (pixels.percentile(percentile, false) || 1);
  const gain = 2 ** ev;
  const of = {
    logMean: raw.count > 0 ? raw.logMean * metered : 1, /* before the exposure, which acts on it */
    most: raw.most * metered * gain,
    brightest: (percent) => (percent < 100 ? pixels.percentile(percent, false) : raw.most) * metered * gain,
    largest: (percent) => pixels.percentile(percent, true) * metered, /* likewise */
  };
  return { exposure: balance.map((x) => x * gain * metered), p: row.numbers ? row.numbers(values, of) : [] };
}

const isNumber = (word) => /^[-+.0-9][-+.0-9eE]*$/.test(word) && Number.isFinite(Number(word));

/* A .cube file: {line, cube}, each {size, min, max, entries} (size 0: none), as common/tonemap/lut.c reads it. */
export function readCube(text, name) {
  const none = () => ({ size: 0, min: [0, 0, 0], max: [1, 1, 1], entries: new Float32Array(0) });
  const line = none(), cube = none();
  let count = 0, expected = 0, number = 0;
  const bad = (why) => new Error(`${name}, line ${number}: ${why}`);
  const numbers = (words, wanted) => {
    if (words.length !== wanted || !words.every(isNumber)) throw bad(`${wanted} numbers are wanted`);
    return words.map(Number);
  };
  const size = (table, words, most) => {
    const [n] = numbers(words, 1);
    if (!Number.isInteger(n) || n < 2 || n > most) throw bad(`a size must be a whole number from 2 to ${most}`);
    table.size = n;
  };
  const begin = () => {
    expected = line.size + cube.size ** 3;
    if (expected === 0) throw bad('numbers come before the size; LUT_1D_SIZE N or LUT_3D_SIZE N belongs above them');
    if (text.length < expected * 6 - 6) throw bad(`the size asks for ${expected} lines of numbers; the file is too short`);
    line.entries = new Float32Array(line.size * 3);
    cube.entries = new Float32Array(cube.size ** 3 * 3);
  };
  const keyword = ([word, ...rest]) => {
    if (word === 'TITLE') return;
    else if (word === 'LUT_1D_SIZE') size(line, rest, 65536);
    else if (word === 'LUT_3D_SIZE') size(cube, rest, 256);
    else if (word === 'DOMAIN_MIN') line.min = cube.min = numbers(rest, 3);
    else if (word === 'DOMAIN_MAX') line.max = cube.max = numbers(rest, 3);
    else if (/^LUT_[13]D_INPUT_RANGE$/.test(word)) {
      const table = word[4] === '1' ? line : cube, [low, high] = numbers(rest, 2);
      table.min = [low, low, low];
      table.max = [high, high, high];
    } else throw bad(`"${word.slice(0, 40)}" is not supported in .cube files`);
  };
  for (const row of text.replace(/^\ufeff/, '').split('\n')) {
    number++;
    const words = row.trim().split(/[ \t]+/);
    if (!words[0] || words[0][0] === '#') continue;
    if (/^[A-Za-z]/.test(words[0])) {
      if (expected > 0) throw bad('a keyword among the numbers');
      keyword(words);
      continue;
    }
    if (expected === 0) begin();
    if (count === expected) throw bad(`there are more than the ${expected} lines of numbers that the size tells of`);
    (count < line.size ? line : cube).entries.set(numbers(words, 3), 3 * (count < line.size ? count : count - line.size));
    count++;
  }
  if (expected === 0) throw new Error(`${name} holds no table; is it a .cube file?`);
  if (count < expected) throw new Error(`${name} ends after ${count} of ${expected} lines of numbers`);
  for (const { min, max } of [line, cube])
    if (!max.every((x, c) => x - min[c] >= 1e-6)) throw new Error(`${name}: its domain holds nothing`);
  return { line, cube };
}

