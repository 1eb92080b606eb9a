/* controls: operator, exposure, white balance, overlay, layer, zoom. Operators and their parameters come from the
 * coordinator's tables (GET /operators). */
import { h, text, show } from '../dom.js';
import { OVERLAYS } from './overlays.js';
import { readCube } from './tonemap.js';

const NEUTRAL_KELVIN = 6500;          /* the slider's middle: no white balance */
const EXPOSURE_RANGE = 10;            /* stops, either way */
const FILE_MAX = 64 << 20;

/* Choices are words in messages, and numbers in a look. */
const valuesOf = (operator, parameters) => Object.fromEntries(Object.entries(parameters || {}).map(([name, value]) =>
  [name, typeof value === 'string' ? operator.parameters.find((p) => p.name === name)?.choices?.indexOf(value) ?? value : value]));

export function presetsOf(operator) {
  return Object.fromEntries((operator?.parameters || []).map((p) => [p.name, p.choices ? Math.max(p.choices.indexOf(p.default), 0) : p.default]));
}

/* A job's OutputSettings as a look: {operator, values, ev, metering, percentile, kelvin, denoise}. */
export function lookOf(output, operators) {
  const operator = operators.find((o) => o.name === output?.tonemap) || operators[0];
  return {
    operator: operator.name,
    values: { ...presetsOf(operator), ...(operator.name === output?.tonemap ? valuesOf(operator, output.parameters) : {}) },
    ev: output?.exposure_ev || 0, metering: output?.metering || 'off', percentile: output?.metering_percentile || 99,
    kelvin: output?.white_kelvin || 0, denoise: output?.denoise || 'off', file: null,
  };
}

export const sameLook = (a, b) => JSON.stringify({ ...a, file: null }) === JSON.stringify({ ...b, file: null });

const hex = (bytes) => [...new Uint8Array(bytes)].map((b) => b.toString(16).padStart(2, '0')).join('');

/* The look as a job's OutputSettings; its file becomes a blob of the farm. */
export async function outputOf(look, output, api) {
  const out = {
    ...output, tonemap: look.operator, parameters: { ...look.values }, exposure_ev: look.ev, metering: look.metering,
    metering_percentile: look.percentile, white_kelvin: look.kelvin, denoise: look.denoise,
  };
  if (look.operator !== output.tonemap) Object.assign(out, { tonemap_file: '', tonemap_file_name: '' });
  if (look.operator === 'lut' && look.file) {
    const digest = hex(await crypto.subtle.digest('SHA-256', look.file.bytes));
    await api.put(`/blobs/${digest}`, look.file.bytes);
    Object.assign(out, { tonemap_file: digest, tonemap_file_name: look.file.name });
  }
  return out;
}

let labels = 0;
function labelled(words, control, ...more) {
  control.id = control.id || `look-${++labels}`;
  return h('span', { class: 'knob' }, h('label', { for: control.id }, words), control, ...more);
}

const options = (select, rows) => select.replaceChildren(...rows.map(([value, words, title]) => h('option', { value, title }, words)));

class Controls {
  constructor(picture) {
    Object.assign(this, { picture, operators: [], look: null, of: new Map(), secondOperator: '', cameraEv: 0, ready: false });
    const changed = () => picture.redraw();
    const range = (min, max, step, value, label, run) => h('input', { type: 'range', min, max, step, value, 'aria-label': label, oninput: run });
    const button = (words, title, run) => h('button', { type: 'button', title, 'aria-label': title, onclick: run }, words);
    this.overlay = h('select', { 'aria-label': 'Shown over the picture', onchange: () => { show(this.opacity, this.overlay.value !== 'none' && !OVERLAYS[this.overlay.value].marks); picture.setOverlay(this.overlay.value); } });
    options(this.overlay, Object.entries(OVERLAYS).map(([name, { text: words }]) => [name, words]));
    this.opacity = range(0, 1, 0.05, picture.opacity, 'Opacity of the overlay', () => { picture.opacity = Number(this.opacity.value); changed(); });
    this.opacity.hidden = true;
    this.layer = h('select', { onchange: () => picture.setLayer(this.layer.value) });
    this.layerField = labelled('layer', this.layer);
    this.layerField.hidden = true;
    this.scale = h('output', { class: 'scale' });
    this.operator = h('select', { 'aria-label': 'Operator', onchange: () => this.choose(this.operator.value) });
    this.other = h('select', { 'aria-label': 'Second operator', hidden: true, onchange: () => { this.secondOperator = this.other.value; changed(); } });
    this.wipe = h('button', { type: 'button', 'aria-pressed': 'false', title: 'Wipe between two operators', onclick: () => this.toggleWipe() }, 'A|B');
    this.denoise = h('button', { type: 'button', 'aria-pressed': 'false', title: 'Without noise, by the coordinator', onclick: () => this.toggleDenoise() }, 'Denoise');
    this.exposure = range(-EXPOSURE_RANGE, EXPOSURE_RANGE, 0.1, 0, '', () => this.setExposure(Number(this.exposure.value)));
    this.exposure.removeAttribute('aria-label');
    this.exposureOut = h('output');
    this.white = range(-500, -50, 1, -1e6 / NEUTRAL_KELVIN, '', () => this.setWhite());
    this.white.removeAttribute('aria-label');
    this.whiteOut = h('output');
    this.reset = h('button', { type: 'button', title: 'As the job has it', onclick: () => this.setLook(this.jobLook, this.cameraEv) }, 'Reset');
    this.apply = h('button', { type: 'button', title: "Make the job's pictures again like this", onclick: () => picture.apply() }, 'Apply to the job');
    this.metering = h('select', { onchange: () => this.change({ metering: this.metering.value }) });
    this.percentile = h('input', { type: 'number', min: 0, max: 100, step: 'any', 'aria-label': 'Percentile that becomes white',
      oninput: () => this.percentile.validity.valid && this.percentile.value !== '' && this.change({ percentile: Number(this.percentile.value) }) });
    this.parameters = h('div', { class: 'parameters' });
    this.source = h('p', { class: 'quiet' });
    const view = (run) => () => picture.view && run(picture.view);
    /* Over the picture, so that nothing moves when it comes. */
    this.changed = h('p', { class: 'look-changed', hidden: true }, 'Not as the job has it: ', this.reset, ' ', this.apply);
    this.legend = h('div', { class: 'legend' });
    this.element = h('div', { class: 'picture-controls' },
      h('div', { class: 'row' }, this.overlay, this.opacity, this.layerField, this.legend,
        picture.screen && h('span', { class: 'zoom' }, this.scale, button('\u2212', 'Zoom out (-)', view((v) => v.zoom(Math.SQRT1_2))),
          button('+', 'Zoom in (+)', view((v) => v.zoom(Math.SQRT2))), button('1:1', 'Pixel by pixel, 1:1 (1)', view((v) => v.zoomTo(1))),
          button('fit', 'Fit (0)', view((v) => v.fit())), button('\u2922', 'Full screen (F)', () => picture.fullScreen()))),
      this.lookRow = h('div', { class: 'row' }, this.operator, picture.screen && this.wipe, this.other, this.denoise,
        labelled('exposure', this.exposure, this.exposureOut), labelled('white', this.white, this.whiteOut),
        h('details', { class: 'more', onkeydown: (event) => { if (event.key === 'Escape') event.currentTarget.open = false; } }, h('summary', null, 'More'), h('div', { class: 'popover' }, this.source, this.parameters,
          h('div', { class: 'row' }, labelled('automatic exposure', this.metering), this.percentile,
            picture.screen && h('button', { type: 'button', onclick: () => picture.save() }, 'Save what is seen'))))));
  }

  setOperators(answer) {
    this.operators = Array.isArray(answer) ? answer : answer.operators;
    options(this.metering, (answer.metering || ['off', 'key', 'percentile']).map((m) => [m, m]));
    this.ready = true;
    const rows = this.operators.map((o) => [o.name, o.name, o.summary]);
    options(this.operator, rows);
    options(this.other, rows);
    this.secondOperator = rows.find(([name]) => name === 'aces') ? 'aces' : rows[0][0];
    this.other.value = this.secondOperator;
  }

  presets(name) { return presetsOf(this.operators.find((o) => o.name === name)); }

  /* A parameter's value as the commands write it: choices are words. */
  word(operator, name, value) {
    return this.operators.find((o) => o.name === operator)?.parameters.find((p) => p.name === name)?.choices?.[value] ?? value;
  }

  /* The values that were used with an operator last. */
  remembered(name) { return this.of.get(name) || { values: this.presets(name), file: null }; }

  second() {
    return this.look && this.secondOperator ? { ...this.look, operator: this.secondOperator, ...this.remembered(this.secondOperator) } : null;
  }

  setLook(look, cameraEv) {
    if (!look) return;
    this.jobLook = look;
    this.cameraEv = cameraEv;
    this.look = { ...look, values: { ...look.values } };
    this.remember();
    this.refresh();
    this.picture.redraw();
  }

  remember() { this.of.set(this.look.operator, { values: this.look.values, file: this.look.file }); }

  change(part) {
    this.look = { ...this.look, ...part };
    this.remember();
    this.refresh();
    this.picture.redraw();
    if (!this.picture.screen) this.picture.showPreview();
  }

  choose(name) { this.change({ operator: name, ...this.remembered(name) }); }
  setExposure(stops) { this.change({ ev: Number((stops + this.cameraEv).toFixed(6)) }); }
  nudge(by) { if (this.look) this.setExposure(this.look.ev - this.cameraEv + by); }

  setWhite() {
    const kelvin = -1e6 / Number(this.white.value);
    this.change({ kelvin: Math.abs(Number(this.white.value) + 1e6 / NEUTRAL_KELVIN) < 1.5 ? 0 : Math.round(kelvin / 10) * 10 });
  }

  nextOverlay() {
    const names = Object.keys(OVERLAYS);
    this.overlay.value = names[(names.indexOf(this.overlay.value) + 1) % names.length];
    this.overlay.dispatchEvent(new Event('change'));
  }

  toggleWipe() {
    this.picture.wipe = !this.picture.wipe;
    this.wipe.setAttribute('aria-pressed', this.picture.wipe);
    show(this.other, this.picture.wipe);
    this.picture.redraw();
  }

  /* What the job's own pictures are made with, or else the best there is. */
  toggleDenoise() {
    if (!this.look) return;
    const own = this.jobLook?.denoise || 'off';
    this.change({ denoise: this.look.denoise !== 'off' ? 'off' : own === 'off' ? 'on' : own });
  }

  setLayers(layers, layer) {
    const key = layers.join();
    if (this.layerKey !== key) options(this.layer, layers.map((name) => [name, name === 'color' ? 'picture' : name]));
    this.layerKey = key;
    this.layer.value = layer;
    this.lookRow.inert = layer !== 'color';  /* operators are for light */
    show(this.layerField, layers.length > 1);
  }

  setScale(scale) { text(this.scale, `${Math.round(scale * 100)} %`); }

  refresh() {
    const { look, picture } = this, info = picture.context.info();
    show(this.element, look);
    if (!look) return;
    const operator = this.operators.find((o) => o.name === look.operator), ev = look.ev - this.cameraEv;
    const said = `${ev > 0 ? '+' : ev < 0 ? '\u2212' : ''}${Math.abs(ev).toFixed(1)} EV`;
    this.operator.value = look.operator;
    this.exposure.value = ev;
    this.exposure.setAttribute('aria-valuetext', `${said.replace('EV', 'stops')}`);
    text(this.exposureOut, said);
    this.white.value = -1e6 / (look.kelvin || NEUTRAL_KELVIN);
    const white = look.kelvin ? `${look.kelvin} K` : 'as rendered';
    this.white.setAttribute('aria-valuetext', white);
    text(this.whiteOut, white);
    this.denoise.setAttribute('aria-pressed', String(look.denoise !== 'off'));
    this.metering.value = look.metering;
    show(this.percentile, look.metering === 'percentile');
    if (document.activeElement !== this.percentile) this.percentile.value = look.percentile;
    const asJob = sameLook(look, this.jobLook) && !look.file;
    show(this.changed, !asJob);
    show(this.apply, info && picture.context.may('operate', info));
    text(this.source, operator ? `${operator.summary} ${operator.source}` : '');
    this.showParameters(operator);
  }

  showParameters(operator) {
    if (this.parametersOf !== operator) {
      this.parametersOf = operator;
      this.fields = (operator?.parameters || []).map((p) => {
        const choice = p.choices?.length > 0;
        const set = () => (choice || field.validity.valid && field.value !== '') && this.change({ values: { ...this.look.values, [p.name]: Number(field.value) } });
        const field = choice ? h('select', { onchange: set })
          : h('input', { type: 'number', min: p.min, max: p.max, step: p.kind === 'integer' ? 1 : 'any', oninput: set });
        if (choice) options(field, p.choices.map((word, i) => [i, word]));
        field.title = p.help;
        return { name: p.name, field, node: labelled(p.name, field) };
      });
      const file = operator?.file === 'required' && h('input', { type: 'file', accept: '.cube', onchange: () => this.takeFile(file) });
      this.parameters.replaceChildren(...this.fields.map(({ node }) => node), ...(file ? [labelled('.cube file', file)] : []));
    }
    for (const { name, field } of this.fields)
      if (document.activeElement !== field) field.value = this.look.values[name];
  }

  async takeFile(input) {
    const [file] = input.files;
    if (!file) return;
    try {
      if (file.size > FILE_MAX) throw new Error(`${file.name} is larger than ${FILE_MAX >> 20} MiB`);
      const bytes = await file.arrayBuffer();
      this.change({ file: { name: file.name, readAt: Date.now(), bytes, tables: readCube(new TextDecoder().decode(bytes), file.name) } });
    } catch (why) { this.picture.context.trouble(why); }
  }
}

export const makeControls = (picture) => new Controls(picture);
