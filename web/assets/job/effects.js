/* effects: where a job's processor time goes, effect by effect, while it renders. */
import { h, text, show, property } from '../dom.js';
import { percent } from '../format.js';

const SHOWN = 6;

/* RenderStats.accounts and the effects' names -> [{name, share}], largest first. [0] belongs to no effect. */
export function sharesOf(accounts, names) {
  const counts = (accounts || []).map(Number), all = counts.reduce((sum, n) => sum + n, 0);
  return counts.map((n, i) => ({ name: i ? names[i - 1] || `effect ${i}` : 'tracing rays, geometry', share: all ? n / all : 0 }))
    .filter(({ share }) => share >= 0.001).sort((a, b) => b.share - a.share);
}

export function mountEffects(element, context) {
  const list = h('ul', { class: 'effects' }), rows = new Map();
  const more = h('button', { class: 'quiet', 'aria-expanded': 'false', onclick: () => {
    more.setAttribute('aria-expanded', more.getAttribute('aria-expanded') !== 'true');
    draw();
  } });
  const empty = h('p', { class: 'quiet' });
  let names = [];

  function row(name) {
    if (!rows.has(name)) {
      const share = h('span', { class: 'share' }), bar = h('i', { 'aria-hidden': 'true' });
      rows.set(name, { node: h('li', null, h('span', null, name), share, bar), share, bar });
    }
    return rows.get(name);
  }
  function draw() {
    const shares = sharesOf(context.info()?.stats?.accounts, names), all = more.getAttribute('aria-expanded') === 'true';
    const wanted = (all ? shares : shares.slice(0, SHOWN)).map(({ name, share }) => {
      const made = row(name);
      text(made.share, share < 0.01 ? 'under 1 %' : percent(share));
      property(made.bar, '--share', share.toFixed(3));
      return made.node;
    });
    if (wanted.some((node, i) => list.children[i] !== node) || wanted.length !== list.children.length) list.replaceChildren(...wanted);
    text(more, all ? 'Fewer' : `${shares.length - SHOWN} more`);
    show(more, shares.length > SHOWN);
    show(empty, !shares.length);
    text(empty, context.info()?.state === 'done' ? 'Nothing was measured: it took too little time.' : 'Nothing measured yet.');
  }

  element.classList.add('effects-part');
  element.replaceChildren(h('h3', null, 'Effects, by time'), list, empty, more);
  context.on('select', draw);
  context.on('job', () => context.frameLoop(draw));
  const load = () => names.length || context.api.get('/effects').then((answer) => { names = (answer.effects || []).map((name) => name.replaceAll('-', ' ')); draw(); }, context.trouble);
  context.on('connection', (how) => how === 'open' && load());
  load();
  draw();
}
