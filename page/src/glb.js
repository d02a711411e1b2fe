// A GLB without some of its faces. Arrays of other faces, pictures and everything else stay byte for byte.
import { MeshoptDecoder } from 'three/addons/libs/meshopt_decoder.module.js';
import { BACKDROP } from './view.js';

const BYTES = { 5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4 };
const NUMBERS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };
const ARRAYS = { 5120: Int8Array, 5121: Uint8Array, 5122: Int16Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array };
const MESHOPT = 'EXT_meshopt_compression';

/** `glb` without faces: `erased` has { mesh, primitive, flags }, a flag per face. */
export function withoutFaces(glb, erased) {
  const { json, views } = parts(glb);
  for (const { mesh, primitive, flags } of erased) {
    const { name, primitives } = json.meshes[mesh];
    if (BACKDROP.test(name)) json.asset.extras.backdrop -= flags.filter((flag) => flag).length;
    const corners = Array.from(flags, (flag, face) => (flag ? [] : [3 * face, 3 * face + 1, 3 * face + 2])).flat();
    if (corners.length > 0) keepCorners(json, views, primitives[primitive], corners);
    else primitives[primitive] = null;
  }
  return joined(json, withoutUnused(json, views));
}

/** Keeps these corners of a primitive, and the vertices that they use. */
function keepCorners(json, views, { attributes, indices }, corners) {
  let rows = corners;
  if (indices !== undefined) {
    const Kind = ARRAYS[json.accessors[indices].componentType];
    const vertices = new Kind(unpack(json, views, json.accessors[indices]).bytes.slice().buffer);
    rows = Uint32Array.from(new Set(corners.map((corner) => vertices[corner]))).sort();
    const place = new Map(Array.from(rows, (row, i) => [row, i]));
    const list = Kind.from(corners, (corner) => place.get(vertices[corner]));
    keepRows(json, views, indices, corners, new Uint8Array(list.buffer));
  }
  for (const accessor of Object.values(attributes)) keepRows(json, views, accessor, rows);
}

/** Keeps some rows of an accessor, or puts `bytes` in their place. */
function keepRows(json, views, index, rows, bytes) {
  const accessor = json.accessors[index];
  if (accessor.byteOffset || json.accessors.some((one) => one !== accessor && one.bufferView === accessor.bufferView)) {
    throw new Error('this page stores several arrays in one block: bake it again with this version of trisplat');
  }
  const { bytes: all, stride } = unpack(json, views, accessor);
  const kept = bytes ?? new Uint8Array(rows.length * stride);
  if (!bytes) rows.forEach((row, i) => kept.set(all.subarray(row * stride, (row + 1) * stride), i * stride));
  const view = json.bufferViews[accessor.bufferView];
  if (view.extensions) delete view.extensions[MESHOPT];
  if (view.extensions && Object.keys(view.extensions).length === 0) delete view.extensions;
  views[accessor.bufferView] = kept;
  accessor.count = rows.length;
  if (!accessor.min) return;
  const numbers = new ARRAYS[accessor.componentType](kept.buffer);
  const step = stride / BYTES[accessor.componentType];
  const bound = (pick, from, i) => rows.reduce((best, _, row) => pick(best, numbers[row * step + i]), from);
  accessor.min = accessor.min.map((_, i) => bound(Math.min, Infinity, i));
  accessor.max = accessor.max.map((_, i) => bound(Math.max, -Infinity, i));
}

/** The bytes of an accessor's view, and the length of a row. */
function unpack(json, views, { bufferView, componentType, type }) {
  const { extensions, byteStride } = json.bufferViews[bufferView];
  const packed = extensions?.[MESHOPT];
  const stride = packed?.byteStride ?? byteStride ?? BYTES[componentType] * NUMBERS[type];
  if (!packed) return { bytes: views[bufferView], stride };
  const bytes = new Uint8Array(packed.count * stride);
  MeshoptDecoder.decodeGltfBuffer(bytes, packed.count, stride, views[bufferView], packed.mode, packed.filter);
  return { bytes, stride };
}

/** Drops meshes without primitives, and accessors and views that nothing refers to; returns the views that stay. */
function withoutUnused(json, views) {
  for (const mesh of json.meshes) mesh.primitives = mesh.primitives.filter((primitive) => primitive);
  for (const node of json.nodes) if (json.meshes[node.mesh]?.primitives.length === 0) delete node.mesh;
  const referring = (list, key) => list.filter((one) => one[key] !== undefined).map((one) => [one, key]);
  json.meshes = renumbered(json.meshes, referring(json.nodes, 'mesh'));
  const primitives = json.meshes.flatMap((mesh) => mesh.primitives);
  const attributes = primitives.flatMap(({ attributes }) => Object.keys(attributes).map((name) => [attributes, name]));
  json.accessors = renumbered(json.accessors, [...attributes, ...referring(primitives, 'indices')]);
  const stored = json.bufferViews.map((view, i) => ({ view, bytes: views[i] }));
  const kept = renumbered(stored, referring([...json.accessors, ...(json.images ?? [])], 'bufferView'));
  json.bufferViews = kept.map(({ view }) => view);
  if (!json.bufferViews.some((view) => view.extensions?.[MESHOPT])) {
    json.buffers.length = 1;
    for (const key of ['extensionsUsed', 'extensionsRequired']) {
      json[key] = json[key]?.filter((name) => name !== MESHOPT);
      if (!json[key]?.length) delete json[key];
    }
  }
  return kept.map(({ bytes }) => bytes);
}

/** Those of a list to which references, [object, key], lead; references are changed to their new numbers. */
function renumbered(list, references) {
  const used = new Set(references.map(([object, key]) => object[key]));
  const numbers = [...list.keys()].filter((i) => used.has(i));
  for (const [object, key] of references) object[key] = numbers.indexOf(object[key]);
  return numbers.map((i) => list[i]);
}

/** JSON of a GLB, and the stored bytes of its views. */
function parts(glb) {
  const length = new DataView(glb.buffer, glb.byteOffset).getUint32(12, true);
  const json = JSON.parse(new TextDecoder().decode(glb.subarray(20, 20 + length)));
  const views = json.bufferViews.map((view) => {
    const { byteOffset = 0, byteLength } = view.extensions?.[MESHOPT] ?? view;
    return glb.subarray(28 + length + byteOffset, 28 + length + byteOffset + byteLength);
  });
  return { json, views };
}

/** The GLB of a document and the bytes of its views. */
function joined(json, views) {
  const padded = (bytes, fill) => {
    const all = new Uint8Array(Math.ceil(bytes.length / 4) * 4).fill(fill);
    all.set(bytes);
    return all;
  };
  const blocks = views.map((bytes) => padded(bytes, 0));
  let end = 0;
  json.bufferViews.forEach((view, i) => {
    Object.assign(view.extensions?.[MESHOPT] ?? view, { buffer: 0, byteOffset: end, byteLength: views[i].length });
    end += blocks[i].length;
  });
  json.buffers[0].byteLength = end;
  const text = padded(new TextEncoder().encode(JSON.stringify(json)), 0x20);
  const header = (...words) => new Uint8Array(new Uint32Array(words).buffer);
  return new Blob([header(0x46546c67, 2, 28 + text.length + end, text.length, 0x4e4f534a), text, header(end, 0x004e4942), ...blocks], { type: 'model/gltf-binary' });
}
