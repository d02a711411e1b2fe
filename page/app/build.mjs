// Builds the page of the program, one file that opens from disk: node page/app/build.mjs WASM OUT [MODULES]
// MODULES: a folder with node_modules of page/package-lock.json; page unless given.
import { createHash } from 'node:crypto';
import { mkdir, readFile, writeFile } from 'node:fs/promises';
import { createRequire } from 'node:module';
import { dirname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { gzipSync } from 'node:zlib';

const here = dirname(fileURLToPath(import.meta.url));
const [wasm, out, modules = join(here, '..')] = process.argv.slice(2);
const { build, transform } = createRequire(join(resolve(modules), 'build.mjs'))('esbuild');
const text = (path) => readFile(join(here, path), 'utf8');

const settings = {
  absWorkingDir: here,
  bundle: true,
  minify: true,
  format: 'iife',
  target: ['chrome100', 'firefox115', 'safari16.4'],
  charset: 'ascii',
  legalComments: 'none',
  external: ['node:*'],
  nodePaths: [join(resolve(modules), 'node_modules')],
  write: false,
};
const code = async (entry, more) => (await build({ ...settings, entryPoints: [entry], ...more })).outputFiles[0].text.trim();

const three = await readFile(join(modules, 'node_modules/three/LICENSE'), 'utf8');
const banner = { js: `/*\nThis page holds three.js (https://threejs.org), under the MIT licence:\n\n${three.trim()}\n*/` };
const worker = await code('../../web/src/worker.js');
const script = await code('main.js', { define: { WORKER_SCRIPT: JSON.stringify(worker) }, banner });
const rules = (await text('../src/tools.css')) + (await text('style.css'));
const style = (await transform(rules, { loader: 'css', minify: true })).code.trim();
const program = gzipSync(await readFile(wasm), { level: 9 }).toString('base64');

const hash = (of) => `'sha256-${createHash('sha256').update(of).digest('base64')}'`;
/** Content security policy of the page: it may run this script and its workers, show this style and pictures that it made. It reaches no network. */
const policy = [
  `default-src 'none'`,
  `script-src ${hash(script)} 'wasm-unsafe-eval'`,
  `worker-src blob:`,
  `style-src ${hash(style)}`,
  `img-src blob:`,
  `base-uri 'none'`,
  `form-action 'none'`,
].join('; ');
const tools = (await text('../src/tools.html')).trim();
const filled = { STYLE: style, TOOLS: tools, SCRIPT: script, PROGRAM: program, POLICY: policy };
const page = (await text('index.html')).replace(/@(\w+)@/g, (_, name) => filled[name]);
await mkdir(out, { recursive: true });
await writeFile(join(out, 'index.html'), page);
console.log(`${join(out, 'index.html')}: ${page.length} bytes`);
