/* preview: the scene as its camera sees it, small and denoised, before it is submitted. The farm renders it as a job of its
 * own, which goes before others and is removed when its picture is here.
 *
 *   none --submitted--> waiting --a worker takes it--> growing --done--> shown; a new one, or leaving: gone
 */
import { h, text, children, show, attr } from '../dom.js';
import { base, get, post, del, ask } from '../api.js';
import { ended, reason } from '../state.js';

const SIDE = 320, SAMPLES = 16, SECONDS = 10;
const PRIORITY = 100;                 /* what everybody who may submit may give */
const EVERY_MS = 300;
const WARNINGS_SHOWN = 6;
const CHANGED = 'From before a change: take another preview.';
/* Of the form's options those that a look is taken with. */
const SEEN = new Set(['size', 'camera', 'env', 'env-rotate', 'exposure', 'tonemap', 'require']);

/* Options of 'azulejo submit'. */
export function previewOptions(options, name, frame) {
  const out = ['--name', `${name} (preview)`, '--fit', `${SIDE}x${SIDE}`, '--spp', String(SAMPLES), '--time-limit', `${SECONDS}s`,
    '--denoise', 'on', '--format', 'png', '--priority', String(PRIORITY)];
  for (let i = 0; i < options.length; i += 2) if (SEEN.has(options[i].slice(2))) out.push(options[i], options[i + 1]);
  return frame ? [...out, '--frames', String(frame)] : out;
}

const rest = (signal) => new Promise((done) => { setTimeout(done, EVERY_MS); signal.addEventListener('abort', done); });
async function remove(job) {
  await post(`/jobs/${job}/cancel`, { discard: true }).catch(() => {}); /* it may have ended */
  await del(`/jobs/${job}`).catch(() => {});
}

export function makePreview() {
  const image = h('img', { alt: '' }), words = h('figcaption', { role: 'status' }), warnings = h('ul', { class: 'files' });
  const element = h('figure', { class: 'preview', hidden: true }, image, words, warnings);
  let watched = null, job = 0, address = '', closed = false, isOther = false;
  const leave = () => job && fetch(`${base}/jobs/${job}/cancel`, {
    method: 'POST', headers: { 'content-type': 'application/json' }, body: '{"discard":true}', keepalive: true,
  }).catch(() => {});
  addEventListener('pagehide', leave);

  async function picture(path, signal) {
    const bytes = await (await ask(path, { signal })).blob();
    URL.revokeObjectURL(address);
    address = URL.createObjectURL(bytes);
    attr(image, 'alt', 'What the camera sees');
    attr(image, 'src', address);
    await image.decode().catch(() => {}); /* what is said of it comes with it */
  }
  /* Shows what there is; whether that is all. */
  async function step(number, signal) {
    const info = (await get(`/jobs/${number}`, { signal })).jobs[0], why = reason(info), at = `/jobs/${number}/frames/${info.first_frame}`;
    if (info.state === 'done') {
      await picture(`${at}/png`, signal);
      text(words, isOther ? CHANGED : `Frame ${info.first_frame}, a first look: ${SAMPLES} samples a pixel, denoised.`);
    } else if (ended(info)) text(words, `There is no preview: ${why || info.state}.`);
    else {
      const begun = Number(info.samples_done) > 0, waits = /^waits/.test(why) || !begun;
      if (begun) await picture(`${at}/preview.png`, signal).catch(() => {}); /* the next one is not far */
      text(words, waits ? `The preview ${/^waits/.test(why) ? why : `waits${why ? `: ${why}` : ' for a worker'}`}.` : 'It is rendered…');
    }
    return ended(info);
  }
  function end() {
    if (watched) watched.abort();
    if (job) remove(job);
    watched = null;
    job = 0;
  }
  return {
    element,
    end,
    close() { closed = true; end(); removeEventListener('pagehide', leave); URL.revokeObjectURL(address); },
    /* Another one is made. */
    begin() {
      end();
      isOther = false;
      show(element, true);
      text(words, '');
      children(warnings, []);
      element.scrollIntoView({ block: 'nearest' }); /* the button may be far below, as on a phone */
    },
    /* What is shown is of other files or options. */
    isOld() {
      isOther = true;
      if (!job && image.src) text(words, CHANGED);
    },
    async watch(answer) {
      if (closed) { remove(answer.job); return; }
      const { signal } = watched = new AbortController(), mine = job = answer.job, more = answer.warnings.length - WARNINGS_SHOWN;
      children(warnings, answer.warnings.slice(0, WARNINGS_SHOWN).map((w) => h('li', null, w)).concat(more > 0 ? [h('li', null, `and ${more} more warnings`)] : []));
      for (let over = false; !over && !signal.aborted; await rest(signal)) {
        try {
          over = await step(mine, signal);
        } catch (why) {
          if (!signal.aborted) text(words, why.message);
          over = why.status !== 0; /* a coordinator that does not answer may come back */
        }
      }
      if (job === mine) end();
    },
  };
}
