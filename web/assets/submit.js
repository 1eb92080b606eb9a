/* submit: scenes by dropping their files or folders onto the page. The form is loaded when it is opened. */
import { h, show } from './dom.js';
import { may } from './verbs.js';
import { trouble } from './notice.js';
import { go } from './router.js';

/* What was chosen, path -> File: kept while another view is looked at. changed() is the form's. */
export const chosen = { files: new Map(), changed() {} };

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
export function take(files) {
  for (const [path, file] of files) if (!/(^|\/)\./.test(path)) chosen.files.set(path, file);
  chosen.changed();
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

export function submitView(node) {
  let leave = null, left = false;
  node.append(h('h1', null, may('submit') ? 'Submit a scene' : 'Submit'));
  if (!may('submit')) {
    node.append(h('p', null, 'Your token may look, but not submit. Ask for one with the role submit.'));
    return undefined;
  }
  import('./submit/form.js').then((module) => { if (!left) leave = module.submitForm(node); })
    .catch((why) => { node.append(h('p', { class: 'problem' }, `The form was not loaded: ${why.message}. Reload the page when the coordinator answers.`)); });
  return () => { left = true; if (leave) leave(); };
}
