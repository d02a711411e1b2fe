// The scene inside the page: base64 blocks, each decoded as soon as the browser has read it, into one GLB.
import { EquirectangularReflectionMapping, Mesh, SRGBColorSpace, TextureLoader } from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { MeshoptDecoder } from 'three/addons/libs/meshopt_decoder.module.js';
import { TrisplatSh } from './sh.js';

const HEADER_BYTES = 12;
const FRAME_MS = 30;

export class SceneFile {
  #bytes = null;
  #parser = null;
  #end = 0;
  #report;

  /** Calls `report(share)` with the share of the work that is done, 0 to 1. */
  constructor(report) {
    this.#report = report;
  }

  /** Takes the text of one block; the first one holds the length of all. */
  block(text) {
    const first = this.#bytes === null;
    if (first) this.#bytes = new Uint8Array(lengthOf(decoded(text.slice(0, 16))));
    this.#end += decodeInto(this.#bytes, this.#end, text);
    this.#report((0.5 * this.#end) / this.#bytes.length);
  }

  /** The scene, its meshes, its view-dependent colours, what the file says of itself, and the panorama behind it, once all blocks are there. */
  async meshes() {
    const bytes = this.#bytes;
    if (bytes === null || this.#end !== bytes.length) {
      throw new Error(`this page is cut short: it holds ${this.#end} of ${bytes?.length ?? 'its'} bytes of the scene`);
    }
    await MeshoptDecoder.ready;
    let sh = null;
    const loader = new GLTFLoader().register((parser) => (sh = new TrisplatSh(parser)));
    loader.setMeshoptDecoder(this.#decoder(packedBytes(bytes)));
    const { scene, asset, parser } = await loader.parseAsync(bytes.buffer, '');
    this.#parser = parser;
    scene.updateMatrixWorld(true);
    const meshes = [];
    scene.traverse((node) => node instanceof Mesh && meshes.push(node));
    this.#report(1);
    return { scene, meshes, sh, extras: asset.extras ?? {}, sky: await panorama() };
  }

  /** The GLB. */
  get glb() {
    return this.#bytes;
  }

  /** Numbers of a mesh and its primitive in the GLB. */
  numbersOf(mesh) {
    const { meshes, primitives } = this.#parser.associations.get(mesh);
    return { mesh: meshes, primitive: primitives };
  }

  // One array after the other, yielding to the event loop in between, so that the bar moves and the page responds.
  #decoder(total) {
    let queue = Promise.resolve();
    let yielded = performance.now();
    let done = 0;
    const one = async (...task) => {
      if (performance.now() - yielded > FRAME_MS) {
        await new Promise((resume) => setTimeout(resume));
        yielded = performance.now();
      }
      const array = await MeshoptDecoder.decodeGltfBufferAsync(...task);
      done += array.length;
      this.#report(0.5 + (0.5 * done) / total);
      return array;
    };
    return {
      ready: MeshoptDecoder.ready,
      supported: MeshoptDecoder.supported,
      decodeGltfBufferAsync: (...task) => (queue = queue.then(() => one(...task))),
    };
  }
}

/** The surroundings, or null: `--backdrop sky` puts them into a block of their own. */
async function panorama() {
  const block = document.getElementById('sky');
  if (!block) return null;
  const sky = await new TextureLoader().loadAsync(`data:${block.type},${block.textContent}`);
  block.remove();
  sky.mapping = EquirectangularReflectionMapping;
  sky.colorSpace = SRGBColorSpace;
  return sky;
}

/** Length of a GLB in bytes, from its header. */
function lengthOf(header) {
  const view = new DataView(header.buffer);
  if (header.length < HEADER_BYTES || view.getUint32(0, true) !== 0x46546c67) throw new Error('there is no GLB in this page');
  return view.getUint32(8, true);
}

/** Bytes that the compressed arrays of a GLB decode to. */
function packedBytes(bytes) {
  const length = new DataView(bytes.buffer).getUint32(HEADER_BYTES, true);
  const json = new TextDecoder().decode(bytes.subarray(HEADER_BYTES + 8, HEADER_BYTES + 8 + length));
  const packed = JSON.parse(json).bufferViews.map((view) => view.extensions?.EXT_meshopt_compression);
  return packed.reduce((sum, array) => sum + (array ? array.count * array.byteStride : 0), 0);
}

function decodeInto(bytes, at, text) {
  const room = bytes.subarray(at);
  if (room.setFromBase64) {
    const { read, written } = room.setFromBase64(text);
    if (read < text.length) throw new Error('this page holds more of the scene than it promised');
    return written;
  }
  const block = decoded(text);
  room.set(block);
  return block.length;
}

// For browsers before 2025.
function decoded(text) {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}
