// Runs jobs with the package for scripts: node web.mjs PACKAGE < JOBS
//
// JOBS is a JSON list of { files: { NAME: PATH }, options, output, folder } for a bake, whose files are written to the folder, or
// { files, info: true }; threads says how many, cancel in which stage it
// is ended, unshared that no memory is shared, as in some browsers. Prints one JSON line per job: { names, stages }, { info } or { error }.
import { readFile, writeFile } from "node:fs/promises";
import { join, resolve } from "node:path";
import { text } from "node:stream/consumers";
import { pathToFileURL } from "node:url";
import { Worker } from "node:worker_threads";

const part = (name) => import(pathToFileURL(resolve(process.argv[2], name)).href);
const trisplat = await part("index.js");
for (const job of JSON.parse(await text(process.stdin))) {
  try {
    console.log(JSON.stringify(await run(job)));
  } catch (error) {
    console.log(JSON.stringify({ error: error.message }));
  }
}

async function run({ files: paths, options, output, folder, info, cancel, threads, unshared }) {
  const files = {};
  for (const [name, path] of Object.entries(paths)) files[name] = await readFile(path);
  if (info) return { info: await trisplat.info(files) };
  if (unshared) return withoutSharing(files, options, output, folder);
  const stages = [];
  const controller = new AbortController();
  const onProgress = ({ stage, finished }) => {
    if (finished) stages.push(stage);
    if (cancel && stage === cancel) controller.abort(new Error("cancelled"));
  };
  const baked = await trisplat.bakeFiles(files, options, { output, onProgress, signal: controller.signal, threads });
  for (const [name, bytes] of Object.entries(baked.files)) await writeFile(join(folder, name), bytes);
  return { names: Object.keys(baked.files), stages, warnings: baked.report.warnings };
}

async function withoutSharing(files, options, output, folder) {
  const [{ run: runIn }, memory] = [await part("run.js"), await part("memory.js")];
  const module = await WebAssembly.compile(memory.unshared(await readFile(resolve(process.argv[2], "trisplat.wasm"))));
  const worker = () => new Worker(resolve(process.argv[2], "worker.js"));
  const job = { command: "bake", inputs: Object.keys(files), output, options };
  const baked = await runIn(module, worker, job, files, { memory: false });
  for (const [name, bytes] of Object.entries(baked.files)) await writeFile(join(folder, name), bytes);
  return { names: Object.keys(baked.files), stages: ["all"] };
}
