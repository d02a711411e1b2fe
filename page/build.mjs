// Builds dist/page.html, which trisplat carries, from src and the packages of package-lock.json.
// Usage: npm ci && npm run build [-- FOLDER]   (FOLDER: where to write; dist unless given)
import { build, transform } from 'esbuild';
import { mkdir, readFile, writeFile } from 'node:fs/promises';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';

const here = dirname(fileURLToPath(import.meta.url));
const out = process.argv[2] ?? join(here, 'dist');
const text = (path) => readFile(join(here, path), 'utf8');

const three = await text('node_modules/three/LICENSE');
const decoder = await text('node_modules/three/examples/jsm/libs/meshopt_decoder.module.js');
const meshopt = decoder.match(/Copyright \(C\) .*Kapoulkine.*/)[0];
const { version } = JSON.parse(await text('node_modules/three/package.json'));
const licences = [
  `This page holds software by others, under the MIT licence:\n`,
  `three.js ${version} (https://threejs.org)\n\n${three.trim()}\n`,
  `The decoder of meshoptimizer (https://github.com/zeux/meshoptimizer)\n${meshopt}\nunder the same terms.\n`,
].join('\n');

const bundle = await build({
  absWorkingDir: here,
  entryPoints: ['src/main.js'],
  bundle: true,
  minify: true,
  format: 'iife',
  target: ['chrome100', 'firefox100', 'safari15.4'],
  charset: 'ascii',
  legalComments: 'none',
  banner: { js: `/*\n${licences}*/` },
  write: false,
});
const style = await transform(await text('src/style.css'), { loader: 'css', minify: true });
const page = (await text('src/index.html'))
  .replace('@STYLE@', () => style.code.trim())
  .replace('@SCRIPT@', () => bundle.outputFiles[0].text.trim());
await mkdir(out, { recursive: true });
await writeFile(join(out, 'page.html'), page);
await writeFile(join(out, 'LICENSES.txt'), licences);
console.log(`${join(out, 'page.html')}: ${page.length} bytes, three.js ${version}`);
