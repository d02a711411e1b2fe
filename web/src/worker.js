// A worker: runs the job that it is sent, or is one of its threads; tells how it goes, and sends the files back.
import { join, start } from './start.js';

function serve(port) {
  const line = (line) => port.postMessage({ line });
  const hear = ({ module, work }) => {
    try {
      if ('which' in work) {
        port.postMessage({ joined: true });
        join(module, { ...work, line });
      } else {
        const written = start(module, { ...work, line });
        port.postMessage({ written }, Object.values(written).map((bytes) => bytes.buffer));
      }
    } catch (error) {
      port.postMessage({ error: error.message });
    }
  };
  if (port.on) port.on('message', hear);
  else port.addEventListener('message', ({ data }) => hear(data));
  port.postMessage({ ready: true });
}

if (globalThis.WorkerGlobalScope) serve(globalThis);
else import('node:worker_threads').then(({ parentPort }) => serve(parentPort));
