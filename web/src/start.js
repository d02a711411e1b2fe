// Starts the program in this thread and runs one job to its end, or is one of the threads of a job.
import { memoryOfProgram } from './memory.js';
import { serve, spawner } from './threads.js';
import { Exit, System } from './wasi.js';

const JOB = 'job.json';

function instance(module, memory, system, spawn) {
  const imports = { env: { memory }, wasi_snapshot_preview1: system.imports(), wasi: { 'thread-spawn': spawn } };
  return new WebAssembly.Instance(module, imports).exports;
}

/** Hears the program: its lines go to `line(object)`; keeps the error that it told, and what else it printed. */
function ear(line) {
  const heard = { error: null, rest: [] };
  heard.hear = (text, stream) => {
    if (stream !== 1) return heard.rest.push(text);
    const said = JSON.parse(text);
    if (said.error) heard.error = said.error;
    else line(said);
  };
  return heard;
}

/** The words for how a run ended. */
function reason(ended, { error, rest }) {
  if (error) return error;
  if (rest.some((text) => text.startsWith('memory allocation of'))) return 'out of memory; give fewer triangles, crop, or use the program, which may use more than 4 GB';
  if (ended instanceof RangeError) return 'this scene is nested too deeply for this browser; use the program';
  if (ended instanceof Exit) return rest.join(' ');
  return `trisplat has a fault: ${[ended.message, ...rest].join(' ')}; please report it with the file`;
}

/**
 * Runs `job` on `files`, bytes or blobs by name; `line(object)` gets what the program says on the way. `team`: what its other `threads` share
 * with this one; `shared`: whether the module's memory is. Returns the files that it wrote. Fails with the program's own words.
 */
export function start(module, { job, files, line, shared, threads = 1, memory = memoryOfProgram(shared), team }) {
  const text = new TextEncoder().encode(JSON.stringify(job));
  const heard = ear(line);
  const args = ['trisplat', JOB, String(threads)];
  const system = new System({ memory, files, more: { [JOB]: text }, args, line: heard.hear, reads: team?.files });
  try {
    instance(module, memory, system, team ? spawner(team) : () => -6)._start();
  } catch (ended) {
    if (!(ended instanceof Exit) || ended.code !== 0) throw new Error(reason(ended, heard));
  }
  return system.written();
}

/** Is thread `which` of a job, until it is ended from outside. Fails as [`start`] does. */
export function join(module, { files, line, memory, team, which }) {
  const heard = ear(line);
  serve(team, which, (number, argument) => {
    const system = new System({ memory, files, args: [], line: heard.hear, reads: team.files });
    try {
      instance(module, memory, system, spawner(team)).wasi_thread_start(number, argument);
    } catch (ended) {
      throw new Error(reason(ended, heard));
    }
  });
}
