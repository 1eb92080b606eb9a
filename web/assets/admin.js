/* admin: what takes the store's room, and who may do what. */
import { h, children, moment, facts, copy, property, clockNow } from './dom.js';
import { get, post, del } from './api.js';
import { state, ended, loadOlder, nameOf } from './state.js';
import { context } from './context.js';
import { may, act, listOf } from './verbs.js';
import { bytes, span, plural, count } from './format.js';
import { say, trouble } from './notice.js';
import { confirm, form, open } from './dialog.js';
import { table, cell, verbCell } from './workers.js';
import { jobLink } from './router.js';

/* ---- the store ------------------------------------------------------------------------------------ */

const STORE_EVERY_MS = 5000;
const KINDS = [['pictures', 'pictures'], ['films', 'films: samples of unfinished and kept frames'], ['blobs', 'blobs: scenes and textures'], ['database', 'database'], ['reserve', 'reserve for a full disk'], ['trash', 'being freed'], ['other', 'other']];

export function storeView(node) {
  const body = h('div');
  node.append(h('h1', null, 'Store'), body);
  const draw = (s) => {
    const used = KINDS.map(([k]) => Number(s[k]) || 0), disk = Number(s.disk) || 1;
    const bars = KINDS.map(([key, name], i) => used[i] > 0 && h('li', { class: key }, h('span', null, name), h('span', { class: 'bar', 'aria-hidden': 'true' }, h('i')), h('b', null, bytes(used[i])))).filter(Boolean);
    const most = Math.max(...used, 1);
    KINDS.filter((_, i) => used[i] > 0).forEach(([key], i) => property(bars[i].querySelector('i'), '--share', (Number(s[key]) / most).toFixed(4)));
    children(body, [
      h('p', null, `${bytes(s.free)} of ${bytes(disk)} are free on the disk; the store takes ${bytes(used.reduce((a, b) => a + b, 0))}${Number(s.store_limit) ? ` of at most ${bytes(s.store_limit)}` : ''}.`),
      h('ul', { class: 'kinds' }, bars),
      facts([['kept', s.keep_s < 0 ? 'until somebody removes it' : span(Number(s.keep_s))], ['failed jobs', s.keep_failed_s >= 0 && span(Number(s.keep_failed_s))], ['limit an owner', Number(s.owner_limit) > 0 && bytes(s.owner_limit)], ['held back', s.held],
        ['read again', Number(s.scrub_files) > 0 && `${count(Number(s.scrub_files))} files while nothing was rendered; ${count(Number(s.scrub_faults))} were damaged`], ['last damage', s.scrub_last],
        ['wall', s.wall && `uploaded scenes are read behind it: ${s.wall}`], ['wall lacks', s.wall_lacks && `this kernel cannot keep them from: ${s.wall_lacks}`],
        ['events', s.on_event && `for ${s.on_event}: ${count(Number(s.events_taken))} taken, ${count(s.events_waiting)} wait, ${count(Number(s.events_failed))} failed, ${count(Number(s.events_dropped))} dropped`], ['last trouble', s.events_trouble]]),
      h('div', { class: 'buttons' },
        may('admin') && h('button', { onclick: collect, title: 'gc: remove what may go: by the policies, and blobs that no job needs' }, 'Collect'),
        may('operate') && h('button', { class: 'danger', onclick: prune, title: 'prune: remove old jobs that have ended' }, 'Prune')),
      h('h2', null, 'Jobs that take the most'),
      !(s.jobs || []).length ? h('p', null, 'No job takes room.') : table(['job', 'owner', 'state', 'films', 'pictures', ''], (s.jobs || []).map((j) => h('tr', null,
        h('th', { scope: 'row' }, h('a', { href: jobLink(j.job) }, nameOf(j.name, j.job))), cell('owner', j.owner), cell('state', j.state), cell('films', bytes(j.films)), cell('pictures', bytes(j.pictures)),
        verbCell(state.job(j.job) && ended(state.job(j.job)) && may('operate', j) && h('button', { class: 'danger', onclick: () => act('remove', j.job).then((d) => d && read()) }, 'Remove')))), 'Jobs'),
      Number(s.more_jobs) > 0 && h('p', null, `and ${plural(Number(s.more_jobs), 'smaller one')}`),
      (s.owners || []).length > 0 && h('h2', null, 'Owners'),
      (s.owners || []).length > 0 && table(['owner', 'jobs', 'films', 'pictures'], (s.owners || []).map((o) => h('tr', null, h('th', { scope: 'row' }, o.owner || 'not known'), cell('jobs', count(Number(o.jobs))), cell('films', bytes(o.films)), cell('pictures', bytes(o.pictures)))), 'Owners'),
    ].filter(Boolean));
  };
  const read = () => get('/store').then(draw).catch((why) => children(body, [h('p', { class: 'problem' }, why.message)]));
  const collect = () => post('/store/collect').then((s) => {
    draw(s);
    say(`Removed ${plural(Number(s.removed_jobs), 'job')}, the films of ${plural(Number(s.removed_films), 'job')} and ${plural(Number(s.removed_blobs), 'blob')} (${bytes(s.removed_bytes)}).`);
  }).catch(trouble);
  const prune = async () => {
    const want = await form('Prune: remove old jobs', ['Their pictures, films, settings and logs are lost; the next question says how many these are.'], [
      { name: 'days', label: 'Ended more than this many days ago', type: 'number', min: 0, step: 'any', value: '30', required: true },
      { name: 'state', label: 'State', options: [['', 'done, failed or cancelled'], ['done', 'done'], ['failed', 'failed'], ['cancelled', 'cancelled']] }], 'Show which', (v) => v);
    if (!want) return;
    /* The oldest jobs are those that the page has not loaded. */
    try { while (state.older) await loadOlder(); } catch (why) { trouble(why); return; }
    const old = [...state.jobs.values()].filter((j) => ended(j) && may('operate', j) && (!want.state || j.state === want.state) && j.finished_at && j.finished_at < clockNow() - want.days * 86400);
    if (!old.length) say('No such job is that old.');
    else if (await act('remove', old.map((j) => j.job))) read();
  };
  read();
  const inUse = () => body.contains(document.activeElement) || !getSelection().isCollapsed;
  const timer = setInterval(() => document.hidden || inUse() || read(), STORE_EVERY_MS);
  const off = context.on('jobs', (c) => c.loaded && read());
  return () => { clearInterval(timer); off(); };
}

/* ---- who may do what -------------------------------------------------------------------------------- */

const ROLES = [['view', 'view: look at everything'], ['submit', 'submit: and submit jobs, steer its own'], ['operate', 'operate: and steer all jobs and workers'], ['admin', 'admin: and tokens, the store']];
const OWN = 1; /* the coordinator's own token: it can be renewed, not revoked */
/* A secret that is stored nowhere. */
function once(title, words, secret) {
  const button = h('button', { onclick: () => copy(secret, button) }, 'Copy');
  return open(title, (close) => [h('p', null, `${words} It is shown only now.`), h('div', { class: 'command' }, h('code', null, secret), button),
    h('div', { class: 'buttons' }, h('button', { class: 'primary', onclick: () => close(true) }, 'I have it'))], 'secret');
}
/* Behind the form that asked for it; also if somebody closed that meanwhile. */
const shown = (fn) => setTimeout(fn);
const when = (at) => (Number(at) > 0 ? moment(Number(at)) : 'never');

export function accessView(node) {
  if (!may('admin')) {
    node.append(h('h1', null, 'Access'), h('p', null, 'Tokens are for the role admin.'));
    return;
  }
  const tokens = h('div');
  node.append(h('h1', null, 'Access'));
  const show = () => node.append(h('h2', null, 'Tokens'),
    h('p', null, 'A token opens this page and its API. Each person and each script gets its own, with no more than it needs.'),
    h('div', { class: 'buttons' }, h('button', { class: 'primary', onclick: () => create() }, 'Create a token')), tokens);
  const read = () => get('/tokens').then((answer) => children(tokens, [table(['token', 'role', 'owner', 'created', 'used', 'expires', ''], listOf(answer, 'tokens').map((t) => h('tr', null,
    h('th', { scope: 'row' }, t.name || `token ${t.token}`), cell('role', t.role), cell('owner', t.owner || '–'), cell('created', when(t.made_at)), cell('used', when(t.used_at)), cell('expires', when(t.expires_at)),
    verbCell(Number(t.token) !== OWN && h('button', { class: 'danger', onclick: () => revoke(t) }, 'Revoke'), h('button', { onclick: () => renew(t) }, 'Renew')))), 'Tokens')])).catch((why) => children(tokens, [h('p', { class: 'problem' }, why.message)]));
  const revoke = async (t) => {
    const own = t.token === state.session.token;
    if (await confirm(`Revoke ${t.name || `token ${t.token}`}?`, ['Pages and scripts that use it lose access at once, and it cannot be brought back.', own ? 'You are signed in with it: you will be signed out.' : ''].filter(Boolean), 'Revoke'))
      del(`/tokens/${t.token}`).then(() => { say('The token is revoked.'); read(); }).catch(trouble);
  };
  const renew = async (t) => {
    if (await confirm(`Renew ${t.name || `token ${t.token}`}?`, ['Its old secret is refused at once: pages and scripts that use it lose access until they have the new one.', t.token === state.session.token ? 'You are signed in with it: sign in again with the new one.' : ''].filter(Boolean), 'Renew'))
      post(`/tokens/${t.token}/renew`).then((made) => once('The new token', 'It replaces the old one.', made.secret)).catch(trouble);
  };
  const create = () => form('Create a token', [], [
    { name: 'name', label: 'Name', hint: 'for people: whose, or what for', required: true },
    { name: 'role', label: 'Role', options: ROLES, value: 'submit' },
    { name: 'owner', label: 'Owner of its jobs', value: state.session.who, hint: 'user@host' },
    { name: 'days', label: 'Expires after days', type: 'number', min: 1, hint: 'empty: never' }], 'Create',
  (v) => ({ name: v.name, role: v.role, owner: v.owner, expires_at: v.days ? Math.round(clockNow() + Number(v.days) * 86400) : 0 }),
  (want) => post('/tokens', want).then((made) => { read(); shown(() => once('The token', 'Anyone who has it can do what its role may.', made.secret)); }));
  read().then(show); /* no button moves away under the pointer */
  return context.on('jobs', (c) => c.loaded && read());
}
