// node example.mjs scene.ply scene.glb
import { readFile, writeFile } from 'node:fs/promises';
import { bakeFiles, info } from 'trisplat';

const [input, output] = process.argv.slice(2);
const bytes = await readFile(input);
const { kind, triangles } = await info(bytes);
console.log(`${input}: ${kind}, ${triangles} triangles`);

const onProgress = ({ finished }) => finished && console.log(`${finished.name}: ${finished.after.triangles} triangles`);
const { files, report } = await bakeFiles(bytes, { target: 'godot', max_triangles: 100_000 }, { output, onProgress });
for (const [name, content] of Object.entries(files)) await writeFile(name, content);
report.warnings.forEach((warning) => console.log(warning));
