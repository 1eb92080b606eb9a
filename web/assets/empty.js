/* empty: what an empty farm teaches: the one command to copy, with this coordinator's address. */
import { h, command } from './dom.js';
import { state } from './state.js';

/* Where the farm's programs connect to (HOST:PORT): the host as people reach it, at the farm's own port. */
export function address() {
  const port = (state.farm.address || '').match(/:(\d+)$/)?.[1] || 7420;
  return `${location.hostname}:${port}`;
}
/* The options that name it, and the farm's key on the machine where the command runs. */
export const where = () => `${address() === '127.0.0.1:7420' ? '' : ` -c ${address()}`} --key farm.key`;
export const emptyJobs = () => [
  h('p', null, 'No jobs yet. Send a scene (glTF, pbrt, OBJ or PLY) from a terminal:'),
  command(`azulejo submit scene.glb${where()}`),
  h('p', null, 'or drop its files onto this page.'),
];
export const emptyWorkers = () => [
  h('p', null, 'No worker is connected, so nothing renders. On each machine that shall render:'),
  command(`azulejo-worker --coordinator ${address()} --key farm.key`),
];
