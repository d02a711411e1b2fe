// trisplat wherever there is WebAssembly: scenes of triangles become files that game engines draw. index.d.ts says how.
import { canShare, unshared } from './memory.js';
import { run as runIn } from './run.js';

const node = typeof process !== 'undefined' && !!process.versions?.node;
let compiled = null;

/** The program, compiled once. */
async function program() {
  const url = new URL('./trisplat.wasm', import.meta.url);
  if (node) return WebAssembly.compile(await (await import('node:fs/promises')).readFile(url));
  if (canShare()) return WebAssembly.compileStreaming(fetch(url));
  return WebAssembly.compile(unshared(await (await fetch(url)).arrayBuffer()));
}

async function worker() {
  const url = new URL('./worker.js', import.meta.url);
  if (!node) return new Worker(url, { type: 'module' });
  return new (await import('node:worker_threads')).Worker(url);
}

/** Runs one job on `files`, by name. */
export async function run(job, files, how = {}) {
  return runIn(await (compiled ??= program()), worker, job, files, how);
}

/** Bakes, and returns all that was written, by name, and the report. */
export async function bakeFiles(source, options = {}, how = {}) {
  const { files, first } = named(source);
  const { harden = false, max_bytes = null, ...rest } = options;
  // All files are written beside each other: the program gets the last name, and the folder is put before each again.
  const [, folder, output] = /^(.*\/)?(.*)$/s.exec(how.output ?? 'scene.glb');
  const done = await run({ command: 'bake', inputs: how.inputs ?? [first], output, options: rest, harden, max_bytes }, files, how);
  return { ...done, files: Object.fromEntries(Object.entries(done.files).map(([name, bytes]) => [(folder ?? '') + name, bytes])) };
}

/** Bakes, and returns the bytes of the file. */
export async function bake(source, options = {}, how = {}) {
  return (await bakeFiles(source, options, how)).files[how.output ?? 'scene.glb'];
}

/** Describes a file. */
export async function info(source, how = {}) {
  const { files, first } = named(source);
  return (await run({ command: 'info', input: first }, files, how)).info;
}

/** Input files by name; bytes or a blob alone are one file. */
function named(source) {
  const alone = ArrayBuffer.isView(source) || source instanceof ArrayBuffer || (typeof Blob !== 'undefined' && source instanceof Blob);
  const given = alone ? { [source.name ?? 'scene']: source } : source;
  const bytes = (one) => (one instanceof ArrayBuffer ? new Uint8Array(one) : one);
  const files = Object.fromEntries(Object.entries(given).map(([name, one]) => [name, bytes(one)]));
  return { files, first: Object.keys(files)[0] };
}
