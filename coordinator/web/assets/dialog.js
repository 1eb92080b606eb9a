/* dialog: questions that state what is lost, and small forms. */
import { h } from './dom.js';

/* Opens a <dialog> with these nodes; resolves with what `close(value)` got, null by Escape. */
export function open(title, build, wide) {
  return new Promise((resolve) => {
    let value = null;
    const heading = h('h2', { id: 'dialog-title' }, title);
    const node = h('dialog', { 'aria-labelledby': 'dialog-title', class: wide ? 'wide' : '' }, heading);
    const before = document.activeElement;
    const close = (v) => { value = v; node.close(); };
    node.append(...[build(close)].flat(9).filter(Boolean));
    node.addEventListener('close', () => { node.remove(); if (before && before.isConnected) before.focus(); resolve(value); });
    document.body.append(node);
    node.showModal();
  });
}

/* Lines say what is lost; `verb` names the button. */
export const confirm = (title, lines, verb) => open(title, (close) => [
  ...lines.map((line) => h('p', null, line)),
  h('div', { class: 'buttons' },
    h('button', { onclick: () => close(false), autofocus: true }, 'Keep'),
    h('button', { class: 'danger', onclick: () => close(true) }, verb)),
]).then(Boolean);

/* fields: [{name, label, value, type, hint, options: [[value, label]], required}]. `check(values)` throws a sentence, or
 * gives what the promise resolves with. */
export const form = (title, lines, fields, verb, check = (v) => v) => open(title, (close) => {
  const problem = h('p', { class: 'problem', role: 'alert' });
  const inputs = fields.map((f) => field(f));
  return h('form', {
    onsubmit: (event) => {
      event.preventDefault();
      try { close(check(values(event.target))); } catch (why) { problem.textContent = why.message; }
    },
  }, ...lines.map((line) => h('p', null, line)), ...inputs, problem,
  h('div', { class: 'buttons' },
    h('button', { type: 'button', onclick: () => close(null) }, 'Back'),
    h('button', { class: 'primary' }, verb)));
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
