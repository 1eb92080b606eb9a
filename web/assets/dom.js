/* dom: making and changing elements. Text is always a text node, so what the farm says is never markup. */

/* h("button", {class: "x", onclick: fn, "aria-label": "...", disabled: false}, "text", node, ...) */
export function h(tag, props, ...children) {
  const node = document.createElement(tag);
  for (const [key, value] of Object.entries(props || {})) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith('on')) node.addEventListener(key.slice(2), value);
    else if (key === 'class') node.className = value;
    else if (key === 'value' || key === 'checked' || key === 'htmlFor' || key === 'selected') node[key] = value;
    else node.setAttribute(key, value === true ? '' : value);
  }
  node.append(...children.flat(9).filter((c) => c !== undefined && c !== null && c !== false));
  return node;
}

/* These touch the page only if something changes. */
export function text(node, value) {
  const now = String(value ?? '');
  if (node.textContent !== now) node.textContent = now;
}
export function attr(node, name, value) {
  const now = value === true ? '' : value;
  if (value === undefined || value === null || value === false) {
    if (node.hasAttribute(name)) node.removeAttribute(name);
  } else if (node.getAttribute(name) !== String(now)) node.setAttribute(name, now);
}
export const show = (node, yes) => { if (node.hidden === !!yes) node.hidden = !yes; };
export function property(node, name, value) {
  if (node.style.getPropertyValue(name) !== String(value)) node.style.setProperty(name, value);
}
/* The children become exactly these nodes; those that are in place stay untouched. */
export function children(node, wanted) {
  const keep = new Set(wanted);
  for (const child of [...node.childNodes]) if (!keep.has(child)) child.remove();
  let at = node.firstChild;
  for (const child of wanted) {
    if (child === at) at = at.nextSibling;
    else node.insertBefore(child, at);
  }
}

/* The coordinator's clock, which all moments are of; the browser's may be hours off, and may be set while the page is open.
 * Seconds since 1970. */
const running = () => performance.now() / 1000;
let ahead = Date.now() / 1000 - running();
export const setClock = (at) => { ahead = at - running(); };
export const clockNow = () => running() + ahead;

/* A moment (seconds since 1970): relative, with the absolute on hover. */
const absolute = new Intl.DateTimeFormat(undefined, { dateStyle: 'medium', timeStyle: 'medium' });
const clock = new Intl.DateTimeFormat(undefined, { hour: '2-digit', minute: '2-digit' });
export const clockText = (at) => (Math.abs(at - clockNow()) < 43200 ? clock : absolute).format(new Date(at * 1000));

function ago(at) {
  const s = clockNow() - at, size = Math.abs(s);
  if (size < 10) return 'just now';
  const words = size < 60 ? `${Math.round(size / 10) * 10} s` : size < 3570 ? `${Math.round(size / 60)} min` : size < 36 * 3600 ? `${Math.round(size / 3600)} h` : `${Math.round(size / 86400)} d`;
  return s > 0 ? `${words} ago` : `in ${words}`;
}

export function moment(at) {
  const node = h('time', { class: 'moment' });
  setMoment(node, at);
  return node;
}
export function setMoment(node, at) {
  if (node.dataset.at === String(at)) return;
  node.dataset.at = at;
  node.dateTime = new Date(at * 1000).toISOString();
  node.title = absolute.format(new Date(at * 1000));
  text(node, ago(at));
}
setInterval(() => {
  for (const node of document.querySelectorAll('time.moment')) text(node, ago(Number(node.dataset.at)));
}, 10000);

/* A command to copy. */
export function command(line) {
  const button = h('button', { class: 'quiet', onclick: () => copy(line, button) }, 'Copy');
  return h('div', { class: 'command' }, h('code', null, line), button);
}
export async function copy(line, button) {
  try {
    await navigator.clipboard.writeText(line);
    text(button, 'Copied');
  } catch {
    /* No clipboard without a secure context: select it, Ctrl+C does the rest. */
    const range = document.createRange();
    range.selectNodeContents(button.previousElementSibling);
    getSelection().removeAllRanges();
    getSelection().addRange(range);
    text(button, 'Press Ctrl+C');
  }
  setTimeout(() => text(button, 'Copy'), 2500);
}

/* A list of facts: [[name, text or node], ...]; those without a value are left out. */
export const facts = (rows) => h('dl', { class: 'facts' }, rows
  .filter(([, value]) => value !== undefined && value !== null && value !== '' && value !== false)
  .map(([name, value]) => [h('dt', null, name), h('dd', null, value)]));
