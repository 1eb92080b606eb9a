/* color: matrices of colour spaces and white balance, as common/image/color.c and common/tonemap/white_balance.c
 * compute them. A matrix is nine numbers, by rows. */

export const WEIGHTS = [0.212656, 0.715158, 0.072186]; /* of luminance in linear Rec. 709 */
export const IDENTITY = [1, 0, 0, 0, 1, 0, 0, 0, 1];
export const KELVIN_MIN = 1667, KELVIN_MAX = 25000;

export function multiply(a, b) {
  return a.map((_, i) => {
    const row = i - i % 3, column = i % 3;
    return a[row] * b[column] + a[row + 1] * b[column + 3] + a[row + 2] * b[column + 6];
  });
}

export function apply(m, v) {
  return [0, 3, 6].map((row) => m[row] * v[0] + m[row + 1] * v[1] + m[row + 2] * v[2]);
}

export function invert(m) {
  const cofactors = m.map((_, i) => {
    const j = Math.floor(i / 3), k = i % 3; /* of the result: transposed */
    const r = (k + 1) % 3, s = (k + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
    return m[3 * r + c] * m[3 * s + d] - m[3 * r + d] * m[3 * s + c];
  });
  const determinant = m[0] * cofactors[0] + m[1] * cofactors[3] + m[2] * cofactors[6];
  return cofactors.map((c) => c / determinant);
}

const whiteXyz = ([x, y]) => [x / y, 1, (1 - x - y) / y];

/* To XYZ, the white's Y being 1; `space`: CIE 1931 x, y of {red, green, blue, white}. */
function toXyz({ red, green, blue, white }) {
  const m = [red[0], green[0], blue[0], red[1], green[1], blue[1],
    1 - red[0] - red[1], 1 - green[0] - green[1], 1 - blue[0] - blue[1]];
  const scale = apply(invert(m), whiteXyz(white));
  return m.map((x, i) => x * scale[i % 3]);
}

/* Bradford's cone responses (Lam 1985). */
const BRADFORD = [0.8951, 0.2664, -0.1614, -0.7502, 1.7135, 0.0367, 0.0389, -0.0685, 1.0296];

function adapt(from, to) {
  const a = apply(BRADFORD, whiteXyz(from)), b = apply(BRADFORD, whiteXyz(to));
  return multiply(invert(BRADFORD), BRADFORD.map((x, i) => x * b[Math.floor(i / 3)] / a[Math.floor(i / 3)]));
}

const REC709 = { red: [0.64, 0.33], green: [0.30, 0.60], blue: [0.15, 0.06], white: [0.3127, 0.3290] };
const D65 = REC709.white;

/* From a space to linear Rec. 709, whites adapted. */
export function toRec709(space) {
  return multiply(invert(toXyz(REC709)), multiply(adapt(space.white, D65), toXyz(space)));
}

/* The Planckian locus below 4000 K (Kim et al., US patent 7,024,034), the daylight locus above (CIE 15:2004). */
function locus(kelvin) {
  const t = 1000 / kelvin;
  if (kelvin < 4000) {
    const x = ((-0.2661239 * t - 0.2343589) * t + 0.8776956) * t + 0.179910;
    return [x, kelvin < 2222 ? ((-1.1063814 * x - 1.34811020) * x + 2.18555832) * x - 0.20219683
      : ((-0.9549476 * x - 1.37418593) * x + 2.09137015) * x - 0.16748867];
  }
  const x = kelvin <= 7000 ? ((-4.6070 * t + 2.9678) * t + 0.09911) * t + 0.244063
    : ((-2.0064 * t + 1.9018) * t + 0.24748) * t + 0.237040;
  return [x, (-3 * x + 2.870) * x - 0.275];
}

/* Makes a light of this colour temperature look like D65; 0: leaves all as it is. */
export function whiteBalance(kelvin) {
  if (!(kelvin > 0)) return IDENTITY;
  const to = toXyz(REC709);
  return multiply(invert(to), multiply(adapt(locus(kelvin), D65), to));
}
