// Leaves out of a WebAssembly module what is for debuggers: node web/strip.mjs IN OUT
import { readFile, writeFile } from 'node:fs/promises';
import { gzipSync } from 'node:zlib';

const [from, to] = process.argv.slice(2);
const module = await readFile(from);
const HEADER = 8, CUSTOM = 0;

/** A number in LEB128 at `at`, and where it ends. */
function number(at) {
  let value = 0;
  for (let shift = 0; ; shift += 7) {
    const byte = module[at++];
    value += (byte & 0x7f) * 2 ** shift;
    if (byte < 0x80) return [value, at];
  }
}

const kept = [module.subarray(0, HEADER)];
for (let at = HEADER; at < module.length; ) {
  const [size, start] = number(at + 1);
  if (module[at] !== CUSTOM) kept.push(module.subarray(at, start + size));
  at = start + size;
}
const stripped = Buffer.concat(kept);
await WebAssembly.compile(stripped);
await writeFile(to, stripped);
console.log(`${to}: ${stripped.length} bytes, ${gzipSync(stripped, { level: 9 }).length} compressed`);
