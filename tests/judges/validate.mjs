// Prints, for every glTF or GLB file, one JSON line of what the Khronos validator finds.
// Usage: node validate.mjs JUDGES FILE...   (JUDGES holds node_modules)
import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { basename, dirname, join, resolve } from "node:path";

const [judges, ...files] = process.argv.slice(2);
const validator = createRequire(join(resolve(judges), "judge.js"))("gltf-validator");
for (const file of files) {
  const { issues, info } = await validator.validateBytes(await readFile(file), {
    uri: basename(file),
    maxIssues: 50,
    externalResourceFunction: (uri) => readFile(join(dirname(file), decodeURIComponent(uri))),
  });
  const { numErrors, numWarnings, numInfos, numHints, messages } = issues;
  const first = messages.slice(0, 3).map((m) => `${m.code} ${m.pointer ?? ""}: ${m.message}`);
  const { totalTriangleCount: triangles, totalVertexCount: vertices } = info;
  console.log(JSON.stringify({ file, numErrors, numWarnings, numInfos, numHints, triangles, vertices, first }));
}
