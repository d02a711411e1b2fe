// The program inside the page, and the workers that run it.
import { canShare, unshared } from '../../web/src/memory.js';
import { run as runIn } from '../../web/src/run.js';

/** The script of a worker, put here when the page is built. */
const SCRIPT = WORKER_SCRIPT;

let compiled = null;
let address = null;

/** Unpacks and compiles the program, once. */
async function program() {
  const element = document.getElementById('program');
  const packed = Uint8Array.from(atob(element.textContent), (c) => c.charCodeAt(0));
  element.remove();
  const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'));
  const bytes = await new Response(unpacked).arrayBuffer();
  return WebAssembly.compile(canShare() ? bytes : unshared(bytes));
}

/** Names features that this browser lacks. */
export function missing() {
  const update = 'Update this browser, or open the page in another.';
  const has = (test) => {
    try {
      return !!test();
    } catch {
      return false;
    }
  };
  if (!has(() => document.createElement('canvas').getContext('webgl2'))) {
    return `This browser does not draw in three dimensions: WebGL 2 is off or not there. Turn on hardware acceleration in its settings. ${update}`;
  }
  if (!has(() => WebAssembly.compile)) return `This browser does not run programs: WebAssembly is off or not there. ${update}`;
  if (!has(() => DecompressionStream && Worker)) return `This browser cannot unpack the program of this page. ${update}`;
  return null;
}

/** Runs one job; web/src/run.js says how. */
export async function run(job, files, how) {
  const module = await (compiled ??= program());
  address ??= URL.createObjectURL(new Blob([SCRIPT], { type: 'text/javascript' }));
  return runIn(module, () => new Worker(address), job, files, how);
}
