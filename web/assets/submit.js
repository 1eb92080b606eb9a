/* submit: a scene by dropping its files or its folder onto the page. Options have the names of 'azulejo submit'. */
import { h, text, children, show, command, attr } from './dom.js';
import { get, post, put, del } from './api.js';
import { may, listOf } from './verbs.js';
import { state } from './state.js';
import { field, values } from './dialog.js';
import { say, trouble, tell } from './notice.js';
import { bytes, plural, frameList, errorTarget, milliseconds } from './format.js';
import { jobLink, go } from './router.js';
import { where } from './empty.js';

const SCENE = /\.(gltf|glb|pbrt|obj|ply)$/i;
const AT_ONCE = 3;
let chosen = new Map(); /* path -> File; kept while another view is looked at */
let redraw = () => {};

/* ---- files from a drop: folders are walked ------------------------------------------------------ */

const entriesOf = (reader) => new Promise((done, fail) => reader.readEntries(done, fail));
async function walk(entry, prefix, out) {
  const path = prefix + entry.name;
  if (entry.isFile) {
    out.set(path, await new Promise((done, fail) => entry.file(done, fail)));
    return;
  }
  const reader = entry.createReader();
  for (let some; (some = await entriesOf(reader)).length;) for (const e of some) await walk(e, `${path}/`, out);
}
async function dropped(transfer) {
  const out = new Map();
  const entries = [...transfer.items].filter((i) => i.kind === 'file').map((i) => i.webkitGetAsEntry?.() || i.getAsFile());
  for (const e of entries) if (e instanceof File) out.set(e.name, e); else if (e) await walk(e, '', out);
  return out;
}
function take(files) {
  for (const [path, file] of files) if (!/(^|\/)\./.test(path)) chosen.set(path, file);
  redraw();
}
export function beginDrops() {
  const veil = h('div', { class: 'veil', hidden: true }, h('p', null, 'Drop a scene’s files or its folder to submit it'));
  document.body.append(veil);
  const files = (e) => e.dataTransfer && [...e.dataTransfer.types].includes('Files') && may('submit');
  let depth = 0;
  addEventListener('dragenter', (e) => { if (files(e)) { depth++; show(veil, true); } });
  addEventListener('dragleave', (e) => { if (files(e) && --depth <= 0) { depth = 0; show(veil, false); } });
  addEventListener('dragover', (e) => { if (files(e)) e.preventDefault(); });
  addEventListener('drop', (e) => {
    if (!files(e)) return;
    e.preventDefault();
    depth = 0;
    show(veil, false);
    dropped(e.dataTransfer).then((got) => { take(got); go('#/submit'); }).catch(trouble);
  });
}

/* ---- the form -------------------------------------------------------------------------------------- */

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

export function submitView(node) {
  if (!may('submit')) {
    node.append(h('h1', null, 'Submit'), h('p', null, 'Your token may look, but not submit. Ask for one with the role submit.'));
    return undefined;
  }
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
  const start = h('button', { class: 'primary' }, 'Submit'), stop = h('button', { type: 'button', hidden: true, onclick: () => running && running.abort() }, 'Stop');
  const form = h('form', { class: 'submit', onsubmit: (e) => { e.preventDefault(); run(values(form)); } },
    h('div', { class: 'drop' }, h('p', null, 'Drop a scene’s files or its whole folder here: glTF, pbrt, OBJ or PLY, with its buffers, textures and environment.'),
      h('p', { class: 'buttons' }, h('button', { type: 'button', onclick: () => one.click() }, 'Files…'), h('button', { type: 'button', onclick: () => folder.click() }, 'Folder…'), one, folder), summary, list),
    sceneField, envField, h('div', { class: 'fields' }, FIELDS.map((f) => field(f)), after),
    h('details', null, h('summary', null, 'Picture, layers, machines'), h('div', { class: 'fields' }, operator, MORE.map((f) => field(f)))), problem, work,
    h('div', { class: 'buttons' }, start, stop, h('button', { type: 'button', onclick: () => { chosen.clear(); redraw(); } }, 'Clear')));
  node.append(h('h1', null, 'Submit a scene'), form, h('p', { class: 'hint' }, 'From a terminal, with all options:'), command(`azulejo submit scene.glb${where()}`));

  const fill = (select, paths, none) => { const now = select.value; children(select, [...(none ? [h('option', { value: '' }, none)] : []), ...paths.map((p) => h('option', { value: p }, p))]); if (paths.includes(now)) select.value = now; };
  redraw = () => {
    const paths = [...chosen.keys()].sort(), scenes = paths.filter((p) => SCENE.test(p)).sort((a, b) => a.split('/').length - b.split('/').length);
    const size = [...chosen.values()].reduce((n, f) => n + f.size, 0);
    text(summary, paths.length ? `${plural(paths.length, 'file')}, ${bytes(size)}` : '');
    children(list, paths.slice(0, 12).map((p) => h('li', null, p)).concat(paths.length > 12 ? [h('li', null, `and ${paths.length - 12} more`)] : []));
    fill(scene, scenes);
    fill(environment, paths.filter((p) => /\.(exr|hdr)$/i.test(p)), 'none');
    show(sceneField, scenes.length > 0);
    show(envField, environment.length > 1);
    text(problem, paths.length && !scenes.length ? 'None of these is a scene: one must end in .gltf, .glb, .pbrt, .obj or .ply.' : failed);
    attr(start, 'disabled', !scenes.length || !!running);
  };

  async function run(v) {
    let wanted, number = 0, asked = false;
    failed = '';
    try { wanted = options(v); } catch (why) { text(problem, why.message); return; }
    running = new AbortController();
    const { signal } = running;
    text(problem, '');
    show(work, true);
    show(stop, true);
    redraw();
    try {
      number = (await post('/imports', {}, { signal })).import;
      const all = [...chosen], total = all.reduce((n, [, f]) => n + f.size, 0) || 1;
      let sent = 0, files = 0;
      const left = [...all];
      await Promise.all(Array.from({ length: AT_ONCE }, async () => {
        for (let next; (next = left.shift());) {
          const [path, file] = next;
          await put(`/imports/${number}/files/${path.split('/').map(encodeURIComponent).join('/')}`, file, { signal });
          sent += file.size;
          files++;
          attr(bar, 'value', (sent / total).toFixed(4));
          text(word, `${files} of ${all.length} files sent`);
        }
      }));
      text(word, 'The scene is read…');
      attr(bar, 'value', null);
      asked = true;
      const answer = await post(`/imports/${number}`, { scene: v.scene, options: wanted }, { signal });
      number = 0;
      chosen = new Map();
      say(`Job ${answer.job} is in the queue.`);
      tell(`Submitted as job ${answer.job}`);
      go(jobLink(answer.job));
    } catch (why) {
      failed = why.name !== 'AbortError' ? why.message : asked ? 'Stopped. If the job is in the queue all the same, it was submitted before.' : 'Stopped. Nothing was submitted.';
      if (number) del(`/imports/${number}`).catch(() => {});
    } finally {
      running = null;
      show(work, false);
      show(stop, false);
      redraw();
    }
  }
  redraw();
  return () => { redraw = () => {}; if (running) running.abort(); };
}
