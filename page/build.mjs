// Builds page.html, which crates/formats carries, from src and the packages of package-lock.json.
// Usage: npm ci && npm run build [-- FOLDER]   (FOLDER: where to write; crates/formats/page unless given)
import { build, transform } from 'esbuild';
import { createHash } from 'node:crypto';
import { mkdir, readFile, writeFile } from 'node:fs/promises';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';

const here = dirname(fileURLToPath(import.meta.url));
const out = process.argv[2] ?? join(here, '../crates/formats/page');
const text = (path) => readFile(join(here, path), 'utf8');
const version = async (name) => JSON.parse(await text(`node_modules/${name}/package.json`)).version;

const three = await text('node_modules/three/LICENSE');
const decoder = await text('node_modules/three/examples/jsm/libs/meshopt_decoder.module.js');
const meshopt = decoder.match(/Copyright \(C\) .*Kapoulkine.*/)[0];
const licencesOfPage = [
  `This page holds software by others, under the MIT licence:\n`,
  `three.js ${await version('three')} (https://threejs.org)\n\n${three.trim()}\n`,
  `The decoder of meshoptimizer (https://github.com/zeux/meshoptimizer)\n${meshopt}\nunder the same terms.\n`,
].join('\n');

/**
 * What a page may run and load: its own script and style, known by their hashes, the calls that stand behind the blocks of
 * the scene (crates/formats/src/html.rs writes them), and the decoder of compressed scenes, which is WebAssembly. Nothing from
 * anywhere else, whatever a title or a scene says.
 */
function policy(filled) {
  const BLOCK_CALL = 'trisplat.block()';
  const hash = (code) => `'sha256-${createHash('sha256').update(code).digest('base64')}'`;
  const inline = (tag) => [...filled.matchAll(new RegExp(`<${tag}>([^]*?)</${tag}>`, 'g'))].map((match) => hash(match[1]));
  return [
    `default-src 'none'`,
    `script-src ${[...inline('script'), hash(BLOCK_CALL)].join(' ')} 'wasm-unsafe-eval'`,
    `style-src ${inline('style').join(' ')}`,
    `img-src data: blob:`,
    `connect-src data: blob:`,
    `base-uri 'none'`,
    `form-action 'none'`,
  ].join('; ');
}

/** Puts the script of `source`/main.js and its style into its index.html, and writes that as `name`. */
async function page(source, name, licences) {
  const bundle = await build({
    absWorkingDir: here,
    entryPoints: [`${source}/main.js`],
    bundle: true,
    minify: true,
    format: 'iife',
    target: ['chrome100', 'firefox100', 'safari15.4'],
    charset: 'ascii',
    legalComments: 'none',
    banner: { js: `/*\n${licences}*/` },
    write: false,
  });
  const rules = (await text(`${source}/style.css`)) + (await text(`${source}/tools.css`));
  const style = await transform(rules, { loader: 'css', minify: true });
  const tools = await text(`${source}/tools.html`);
  const filled = (await text(`${source}/index.html`))
    .replace('@TOOLS@', () => tools.trim())
    .replace('@STYLE@', () => style.code.trim())
    .replace('@SCRIPT@', () => bundle.outputFiles[0].text.trim());
  const page = filled.replace('@POLICY@', () => policy(filled));
  await writeFile(join(out, name), page);
  console.log(`${join(out, name)}: ${page.length} bytes`);
}

await mkdir(out, { recursive: true });
await page('src', 'page.html', licencesOfPage);
await writeFile(join(out, 'LICENSES.txt'), licencesOfPage);
