// One job in a worker of its own, which ends with it: so memory comes back, and a job can be cancelled.
import { canShare, memoryOfProgram } from './memory.js';
import { shared } from './threads.js';

/** Threads of a dependency that wait for pictures, beside those that compute. */
const WAITING = 2;
/** Files that the program unpacks are read by the thread that unpacks them. */
const UNPACKED = /\.(gz|html?)$/i;

/**
 * Runs `job` on `files`, by name, in workers that `worker()` makes from the compiled `module`. Returns the files that it wrote by name,
 * as `files`, and what else it found. `memory`: whether that of the module is shared.
 */
export async function run(module, worker, job, files, { signal, onProgress, threads = mayShare(), memory = canShare() } = {}) {
  signal?.throwIfAborted();
  const workers = [];
  const result = {};
  try {
    return await new Promise((resolve, reject) => {
      signal?.addEventListener('abort', () => reject(signal.reason), { once: true });
      const fail = (error) => reject(new Error(`a worker of trisplat could not run: ${error.message ?? 'its script is not there'}`));
      const hire = async (work, joined) => {
        const hired = await worker();
        workers.push(hired);
        const hear = ({ ready, joined: has, line, written, error }) => {
          if (ready) hired.postMessage({ module, work });
          if (has) joined();
          if (error) reject(new Error(error));
          if (written) resolve({ ...result, files: written });
          if (line) tell(line, result, onProgress);
        };
        if (hired.on) hired.on('message', hear).on('error', fail);
        else Object.assign(hired, { onmessage: ({ data }) => hear(data), onerror: fail, onmessageerror: fail });
      };
      const alone = threads < 2 || !memory || Object.keys(files).some((name) => UNPACKED.test(name));
      if (alone) return hire({ job, files, shared: memory }).catch(fail);
      const others = threads - 1 + WAITING;
      const team = { memory: memoryOfProgram(true), team: shared(others), files: sharedFiles(files) };
      const there = Array.from({ length: others }, (_, which) => new Promise((joined) => hire({ ...team, which }, joined).catch(fail)));
      Promise.all(there).then(() => hire({ ...team, job, threads })).catch(fail);
    });
  } finally {
    workers.forEach((hired) => hired.terminate());
  }
}

/** Number of threads that may share memory: a page must be cross-origin isolated. */
function mayShare() {
  return globalThis.crossOriginIsolated && globalThis.document ? Math.min(navigator.hardwareConcurrency ?? 1, 16) : 1;
}

/** The same files, their bytes where all threads see them. */
function sharedFiles(files) {
  const moved = (bytes) => {
    const copy = new Uint8Array(new SharedArrayBuffer(bytes.byteLength));
    copy.set(new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength));
    return copy;
  };
  return Object.fromEntries(Object.entries(files).map(([name, file]) => [name, ArrayBuffer.isView(file) ? moved(file) : file]));
}

/** Keeps what a line says that is a result, and tells of what is progress. */
function tell({ stage, fraction, finished, ...results }, result, onProgress) {
  Object.assign(result, results);
  if (stage) onProgress?.({ stage, fraction: 0 });
  if (fraction !== undefined) onProgress?.({ fraction });
  if (finished) onProgress?.({ stage: finished.name, fraction: 1, finished });
}
