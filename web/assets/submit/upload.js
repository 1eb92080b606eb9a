/* upload: a scene's files at the coordinator. They are sent once: a look at the scene and its submission take the same.
 *
 *   none --POST /imports--> open --PUT files, POST with keep--> open --POST--> its job is there: none
 *     ^------- cleared, not used for an hour, a restart, another token (404) --'
 */
import { base, post, put, del } from '../api.js';
import { plural } from '../format.js';

const AT_ONCE = 3;
let number = 0;
const sent = new Map(); /* path -> the File that is there */

function forget() {
  number = 0;
  sent.clear();
}
export function dropUpload() {
  if (number) del(`/imports/${number}`).catch(() => {});
  forget();
}
/* A closed page does not ask for its upload again. */
addEventListener('pagehide', () => {
  if (number) fetch(`${base}/imports/${number}`, { method: 'DELETE', keepalive: true }).catch(() => {});
  forget();
});

/* Browsers do not read a file that was written again since it was chosen. */
async function readable(files) {
  const changed = [];
  await Promise.all([...files].map(([path, file]) => file.slice(0, 1).arrayBuffer().catch(() => changed.push(path))));
  if (changed.length) throw new Error(`${changed.sort()[0]}${changed.length > 1 ? ` and ${plural(changed.length - 1, 'other file')}` : ''} changed since ${changed.length > 1 ? 'they were' : 'it was'} chosen: choose ${changed.length > 1 ? 'them' : 'it'} again.`);
}

/* Those that are not there, or are others now. */
async function send(files, signal, told) {
  if (!number) number = (await post('/imports', {}, { signal })).import;
  const to = number, left = [...files].filter(([path, file]) => sent.get(path) !== file), all = left.length, total = left.reduce((n, [, f]) => n + f.size, 0) || 1;
  let bytes = 0, done = 0;
  await Promise.all(Array.from({ length: AT_ONCE }, async () => {
    for (let next; number === to && (next = left.shift());) {
      const [path, file] = next;
      sent.delete(path);
      await put(`/imports/${to}/files/${path.split('/').map(encodeURIComponent).join('/')}`, file, { signal });
      if (number === to) sent.set(path, file);
      bytes += file.size;
      done++;
      told(bytes / total, `${done} of ${all} files sent`);
    }
  }));
}

/* Sends `files`, a Map of path -> File, and asks for the job that `body` describes; resolves with {job, warnings}. told(share or
 * null, words) says how far it is; asked() that the job may be there from now on. An upload that is gone is sent again. */
export async function submitFiles(files, body, signal, told, asked = () => {}) {
  for (let again = true; ; again = false) {
    let posted = false;
    try {
      if ([...sent.keys()].some((path) => !files.has(path))) dropUpload();
      await readable(files);
      await send(files, signal, told);
      told(null, 'The scene is read…');
      posted = true;
      asked();
      const answer = await post(`/imports/${number}`, body, { signal });
      if (!body.keep) forget();
      return answer;
    } catch (why) {
      if (!again || !(why.status === 404 || (why.status === 409 && !posted))) throw why;
      dropUpload();
    }
  }
}
