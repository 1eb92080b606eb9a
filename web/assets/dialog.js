/* dialog: questions that state what is lost, and small forms. */
import { h } from './dom.js';

/* Opens a <dialog> with these nodes; resolves with what `close(value)` got, null by Escape. `how`: its class; "secret": what
 * it says is nowhere else, so it stays when another asks who is there. */
export function open(title, build, how = '') {
  return new Promise((resolve) => {
    let value = null;
    const heading = h('h2', { id: 'dialog-title' }, title);
    const node = h('dialog', { 'aria-labelledby': 'dialog-title', class: how }, heading);
    const before = document.activeElement;
    const close = (v) => { value = v; node.close(); };
    node.append(...[build(close)].flat(9).filter(Boolean));
    node.addEventListener('close', () => { node.remove(); if (before && before.isConnected) before.focus(); resolve(value); });
    document.body.append(node);
    node.showModal();
  });
}

/* Questions that may not be answered any more. */
export function closeAll() {
  for (const node of document.querySelectorAll('dialog:not(.secret)')) node.close();
}

/* Lines say what is lost; `verb` names the button. */
export const confirm = (title, lines, verb) => open(title, (close) => [
  ...lines.map((line) => h('p', null, line)),
  h('div', { class: 'buttons' },
    h('button', { onclick: () => close(false), autofocus: true }, 'Keep'),
    h('button', { class: 'danger', onclick: () => close(true) }, verb)),
]).then(Boolean);

/* fields: [{name, label, value, type, hint, options, required}]. `check(values)` throws a sentence, or gives what the
 * promise resolves with. `send(that)`: until it is done the form stays, with all that was written, and is sent once; then
 * the promise resolves with its value. */
export const form = (title, lines, fields, verb, check = (v) => v, send = (v) => v) => open(title, (close) => {
  const problem = h('p', { class: 'problem', role: 'alert' }), button = h('button', { class: 'primary' }, verb);
  const inputs = fields.map((f) => field(f));
  let busy = false;
  const run = async (node) => {
    try {
      const value = check(values(node));
      problem.textContent = '';
      close(await send(value));
    } catch (why) { problem.textContent = why.message; }
  };
  return h('form', {
    onsubmit: async (event) => {
      event.preventDefault();
      if (busy) return;
      busy = button.disabled = true;
      await run(event.target);
      busy = button.disabled = false;
    },
  }, ...lines.map((line) => h('p', null, line)), ...inputs, problem,
  h('div', { class: 'buttons' },
    h('button', { type: 'button', onclick: () => close(null) }, 'Back'), button));
});

let fieldNumber = 0;
export function field({ name, label, value = '', type = 'text', hint, options, ...more }) {
  const id = `field-${name}-${++fieldNumber}`;
  const hintId = hint && `${id}-hint`;
  const input = options
    ? h('select', { id, name, 'aria-describedby': hintId, ...more }, options.map(([v, t]) => h('option', { value: v, selected: v === value }, t)))
    : h('input', { id, name, type, value: type === 'checkbox' ? undefined : value, checked: type === 'checkbox' && value, autocomplete: 'off', 'aria-describedby': hintId, ...more });
  return h('div', { class: `field ${type}` }, h('label', { htmlFor: id }, label), input, hint && h('small', { id: hintId }, hint));
}
export function values(formNode) {
  const out = {};
  for (const node of formNode.elements)
    if (node.name) out[node.name] = node.type === 'checkbox' ? node.checked : node.value.trim();
  return out;
}
