/* layers: how what is not light is made visible. Names as in common/scene/settings.h. */
const WAYS = {
  normal: { operator: 'direction', note: 'world axes: red x, green y, blue z' },
  albedo: { operator: 'linear', note: 'reflectance' },
  alpha: { operator: 'raw', note: 'white: opaque' },
  depth: { operator: 'near', unit: 'm', lit: true, note: 'white is near' },
  position: { operator: 'range', unit: 'm', note: 'from the lowest to the highest coordinate' },
  uv: { operator: 'raw', note: 'red u, green v' },
  motion: { operator: 'range', unit: 'pixels', balanced: true, note: 'grey: none; red right, green down' },
  'object-id': { operator: 'number', note: 'a colour an object' },
  'material-id': { operator: 'number', note: 'a colour a material' },
  samples: { operator: 'range', lit: true, note: 'samples a pixel' },
  error: { operator: 'range', lit: true, note: 'standard error, linear' },
};

export const isLight = (layer) => layer === 'color';

/* The lowest and highest value of the layer's pixels; `lit`: of those above 0. Every 4th line is enough. */
function rangeOf(pixels, { lit, balanced }) {
  let low = Infinity, high = -Infinity;
  for (let y = 0; y < pixels.height; y += 4)
    for (let x = 0; x < pixels.width; x += 2) {
      const at = pixels.at(x, y);
      if (!at) continue;
      for (let c = 0; c < 3; c++) {
        if (lit && !(at[c] > 0)) continue;
        low = Math.min(low, at[c]);
        high = Math.max(high, at[c]);
      }
    }
  if (!(high >= low)) return [0, 1];
  if (balanced) high = Math.max(Math.abs(low), Math.abs(high));
  if (balanced) low = -high;
  return high > low ? [low, high] : lit ? [low / 2, high] : [low, low + 1];
}

/* {pane for gl.js, note for people}. */
export function layerPane(layer, pixels) {
  const way = WAYS[layer] || { operator: 'range' };
  const p = ['near', 'range'].includes(way.operator) ? rangeOf(pixels, way) : [];
  const span = p.length ? `${p.map((x) => Number(x.toPrecision(3))).join(' to ')} ${way.unit || ''}`.trim() : '';
  return { pane: { operator: way.operator, p }, note: [way.note, span].filter(Boolean).join('; ') };
}

export const layerUnit = (layer) => (WAYS[layer] || {}).unit || '';
