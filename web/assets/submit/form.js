/* form: what is submitted of the files that were chosen. Options have the names of 'azulejo submit'. */
import { h, text, children, show, command, attr } from '../dom.js';
import { get } from '../api.js';
import { chosen, take } from '../submit.js';
import { submitFiles, dropUpload } from './upload.js';
import { makePreview, previewOptions } from './preview.js';
import { listOf } from '../verbs.js';
import { state } from '../state.js';
import { field, values } from '../dialog.js';
import { say, trouble, tell } from '../notice.js';
import { bytes, plural, frameList, errorTarget, milliseconds } from '../format.js';
import { jobLink, go } from '../router.js';
import { where } from '../empty.js';

const SCENE = /\.(gltf|glb|pbrt|obj|ply)$/i;

const FIELDS = [
  { name: 'name', label: 'Name', hint: 'empty: the scene file’s' },
  { name: 'size', label: 'Size', placeholder: '1920x1080', hint: 'empty: the file’s own' },
  { name: 'target-error', label: 'Error to reach', placeholder: '2/255', hint: '2/255, 1% or 45dB; empty: all samples' },
  { name: 'spp', label: 'Samples a pixel, at most', type: 'number', min: 1 },
  { name: 'time-limit', label: 'Time limit a frame', placeholder: '10m' },
  { name: 'frames', label: 'Frames', placeholder: '1-48', hint: 'as in 1,5,10-100x10' },
  { name: 'camera', label: 'Camera', hint: 'name or number; empty: the first' },
  { name: 'exposure', label: 'Exposure, in stops', type: 'number', step: 'any' },
  { name: 'priority', label: 'Priority', type: 'number', step: 1, hint: 'higher goes first' },
];
/* Below the others, folded up. The operator's list is asked for. */
const MORE = [
  { name: 'denoise', label: 'Denoise', options: [['', 'off'], ['on', 'on'], ['fast', 'fast, less well']] },
  { name: 'denoise-around', label: 'Frames that help to denoise', options: [['', 'each by itself'], ['1', 'one before and after'], ['2', 'two before and after']], hint: 'an animation flickers less' },
  { name: 'env-rotate', label: 'Rotation of the environment', type: 'number', step: 'any', hint: 'in degrees' },
  { name: 'aov', label: 'Layers of the EXR', placeholder: 'depth,normal,cryptomatte' },
  { name: 'require', label: 'Tags', hint: 'only workers with all of these render it' },
];
function options(v) {
  if (v.size && !/^\d+x\d+$/.test(v.size)) throw new Error(`“${v.size}” is no size: write 1920x1080.`);
  if (v['target-error']) errorTarget(v['target-error']);
  if (v['time-limit']) milliseconds(v['time-limit']);
  if (v.frames) frameList(v.frames);
  if (v['denoise-around'] && !v.denoise) throw new Error('Frames help to denoise only where Denoise is on.');
  const out = [];
  for (const [name, value] of Object.entries(v)) if (value && name !== 'scene') out.push(`--${name}`, value);
  return out;
}

/* Returns what leaves it. */
export function submitForm(node) {
  let running = null, failed = ''; /* why the last try came to nothing */
  const input = (more) => h('input', { type: 'file', multiple: true, class: 'hidden', ...more, onchange: (e) => { take(new Map([...e.target.files].map((f) => [f.webkitRelativePath || f.name, f]))); e.target.value = ''; } });
  const one = input({ id: 'pick-files', 'aria-label': 'Files' }), folder = input({ id: 'pick-folder', webkitdirectory: true, 'aria-label': 'Folder' });
  const list = h('ul', { class: 'files' }), summary = h('p'), scene = h('select', { name: 'scene', id: 'scene' }), sceneField = h('div', { class: 'field' }, h('label', { htmlFor: 'scene' }, 'Scene'), scene);
  const after = field({ name: 'after', label: 'After', options: [['', 'at once'], ...state.active().map((j) => [String(j.job), `${j.name} (job ${j.job})`])] });
  const environment = h('select', { name: 'env', id: 'env' }), envField = h('div', { class: 'field' }, h('label', { htmlFor: 'env' }, 'Environment'), environment);
  const operator = field({ name: 'tonemap', label: 'Operator', options: [['', 'the usual one']] });
  get('/operators').then((answer) => {
    const [usual, ...others] = listOf(answer, 'operators').map((o) => o.name), select = operator.querySelector('select');
    text(select.options[0], usual); /* the first is what a job has that names none */
    select.append(...others.map((name) => h('option', { value: name }, name)));
  }).catch(trouble);
  const problem = h('p', { class: 'problem', role: 'alert' }), bar = h('progress', { max: 1, value: 0, 'aria-label': 'Upload' }), word = h('span'), work = h('p', { class: 'line', hidden: true }, bar, word);
  const preview = makePreview();
  const start = h('button', { class: 'primary' }, 'Submit'), look = h('button', { type: 'button', title: 'The farm renders a small picture of it', onclick: () => run(values(form), true) }, 'Preview'), stop = h('button', { type: 'button', hidden: true, onclick: () => running && running.abort() }, 'Stop');
  const form = h('form', { class: 'submit', oninput: () => preview.isOld(), onsubmit: (e) => { e.preventDefault(); run(values(form)); } },
    h('div', { class: 'drop' }, h('p', null, 'Drop a scene’s files or its whole folder here: glTF, pbrt, OBJ or PLY, with its buffers, textures and environment.'),
      h('p', { class: 'buttons' }, h('button', { type: 'button', onclick: () => one.click() }, 'Files…'), h('button', { type: 'button', onclick: () => folder.click() }, 'Folder…'), one, folder), summary, list),
    preview.element, sceneField, envField, h('div', { class: 'fields' }, FIELDS.map((f) => field(f)), after),
    h('details', null, h('summary', null, 'Picture, layers, machines'), h('div', { class: 'fields' }, operator, MORE.map((f) => field(f)))), problem, work,
    h('div', { class: 'buttons' }, start, look, stop, h('button', { type: 'button', onclick: () => { if (running) running.abort(); chosen.files = new Map(); dropUpload(); redraw(true); } }, 'Clear')));
  node.append(form, h('p', { class: 'hint' }, 'From a terminal, with all options:'), command(`azulejo submit scene.glb${where()}`));

  const fill = (select, paths, none) => { const now = select.value; children(select, [...(none ? [h('option', { value: '' }, none)] : []), ...paths.map((p) => h('option', { value: p }, p))]); if (paths.includes(now)) select.value = now; };
  const redraw = (isOther) => {
    if (isOther) {
      failed = '';
      preview.isOld();
    }
    const paths = [...chosen.files.keys()].sort(), scenes = paths.filter((p) => SCENE.test(p)).sort((a, b) => a.split('/').length - b.split('/').length);
    const size = [...chosen.files.values()].reduce((n, f) => n + f.size, 0);
    text(summary, paths.length ? `${plural(paths.length, 'file')}, ${bytes(size)}` : '');
    children(list, paths.slice(0, 12).map((p) => h('li', null, p)).concat(paths.length > 12 ? [h('li', null, `and ${paths.length - 12} more`)] : []));
    fill(scene, scenes);
    fill(environment, paths.filter((p) => /\.(exr|hdr)$/i.test(p)), 'none');
    show(sceneField, scenes.length > 0);
    show(envField, environment.length > 1);
    text(problem, paths.length && !scenes.length ? 'None of these is a scene: one must end in .gltf, .glb, .pbrt, .obj or .ply.' : failed);
    for (const button of [start, look]) attr(button, 'disabled', !scenes.length || !!running);
  };

  /* `first`: only a look at it. */
  async function run(v, first) {
    let body, asked = false, answer = null;
    failed = '';
    try {
      body = { scene: v.scene, options: options(v), keep: !!first };
      if (first) body.options = previewOptions(body.options, v.name || v.scene.replace(/^.*\//, '').replace(SCENE, ''), v.frames && frameList(v.frames)[0]);
    } catch (why) { text(problem, why.message); return; }
    running = new AbortController();
    if (first) preview.begin(); else preview.end();
    text(problem, '');
    show(work, true);
    show(stop, true);
    redraw();
    try {
      answer = await submitFiles(chosen.files, body, running.signal, (share, words) => { attr(bar, 'value', share?.toFixed(4)); text(word, words); }, () => { asked = !first; });
      if (!first) {
        chosen.files = new Map();
        say(`Job ${answer.job} is in the queue.${answer.warnings.length ? ` ${plural(answer.warnings.length, 'warning')}, the first: ${answer.warnings[0]}` : ''}`);
        tell(`Submitted as job ${answer.job}`);
        go(jobLink(answer.job));
      }
    } catch (why) {
      if (first) preview.isOld();
      failed = why.name !== 'AbortError' ? why.message : asked ? 'Stopped. If the job is in the queue all the same, it was submitted before.' : 'Stopped. Nothing was submitted.';
    } finally {
      running = null;
      show(work, false);
      show(stop, false);
      redraw();
    }
    if (answer && first) preview.watch(answer);
  }
  chosen.changed = () => redraw(true);
  redraw();
  return () => { chosen.changed = () => {}; preview.close(); if (running) running.abort(); };
}
