// Faces of the shown meshes, numbered through: which of them a part of the picture shows, and how they are hidden and marked.
import { BufferAttribute, BufferGeometry, DoubleSide, GLSL3, Mesh, MeshBasicMaterial, Scene, ShaderMaterial, Vector3 } from 'three';

const MARK = 0xff8a1f;
const VERTEX = `uniform uint first; flat out uint face;
void main() {
  face = first + uint(gl_VertexID / 3) + 1u;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;
const FRAGMENT = `precision highp int; flat in uint face; out vec4 color;
void main() { color = vec4(uvec4(face, face >> 8, face >> 16, face >> 24) & 255u) / 255.0; }`;

export class Faces {
  #parts = [];
  #numbered = new Scene();

  /** Takes the meshes of `scene`, which gets marks over them. */
  constructor(scene, meshes) {
    this.#numbered.matrixWorldAutoUpdate = false;
    let first = 0;
    for (const mesh of meshes) {
      const { geometry } = mesh;
      const plain = geometry.index ? geometry.index.array : Uint32Array.from({ length: geometry.attributes.position.count }, (_, i) => i);
      const corners = new Float32Array(3 * plain.length);
      const corner = new Vector3();
      plain.forEach((vertex, i) => corner.fromBufferAttribute(geometry.attributes.position, vertex).toArray(corners, 3 * i));
      const numbered = new Mesh(
        new BufferGeometry().setAttribute('position', new BufferAttribute(corners.slice(), 3)),
        new ShaderMaterial({ vertexShader: VERTEX, fragmentShader: FRAGMENT, glslVersion: GLSL3, uniforms: { first: { value: first } }, side: mesh.material.side }),
      );
      numbered.matrixWorld.copy(mesh.matrixWorld);
      numbered.frustumCulled = false;
      this.#numbered.add(numbered);
      const marks = new Mesh(new BufferGeometry(), new MeshBasicMaterial({ color: MARK, transparent: true, opacity: 0.7, side: DoubleSide, depthWrite: false }));
      marks.geometry.setAttribute('position', geometry.attributes.position);
      marks.matrixWorld.copy(mesh.matrixWorld);
      marks.frustumCulled = marks.matrixAutoUpdate = marks.matrixWorldAutoUpdate = false;
      scene.add(marks);
      geometry.setIndex(new BufferAttribute(Uint32Array.from(plain), 1));
      const count = plain.length / 3;
      this.#parts.push({ mesh, first, count, plain, corners, numbered, marks, flags: new Uint8Array(count) });
      first += count;
    }
  }

  /** Those of a picture of numbers, RGBA8, where `mask` is set. */
  static among(bytes, mask) {
    const found = new Set();
    const words = new Uint32Array(bytes.buffer);
    mask.forEach((on, i) => on && words[i] && found.add(words[i] - 1));
    return found;
  }

  /** The meshes that are shown, in a form whose picture is the numbers of the faces. */
  numbered() {
    for (const { mesh, numbered } of this.#parts) numbered.visible = mesh.visible;
    return this.#numbered;
  }

  /** Frees what the numbers took of the graphics; the marks go with the scene. */
  dispose() {
    for (const { numbered } of this.#parts) {
      numbered.geometry.dispose();
      numbered.material.dispose();
    }
  }

  /** Hides faces, or shows them again. */
  hide(faces, on) {
    for (const face of faces) {
      const part = this.#part(face);
      const i = face - part.first;
      part.flags[i] = on ? 1 : 0;
      part.mesh.geometry.index.array.set(on ? [0, 0, 0] : part.plain.subarray(3 * i, 3 * i + 3), 3 * i);
      part.numbered.geometry.attributes.position.array.set(on ? new Float32Array(9) : part.corners.subarray(9 * i, 9 * i + 9), 9 * i);
      part.mesh.geometry.index.needsUpdate = part.numbered.geometry.attributes.position.needsUpdate = true;
    }
  }

  /** Marks these faces and no others. */
  mark(faces) {
    const marked = new Map(this.#parts.map((part) => [part, []]));
    for (const face of faces) {
      const part = this.#part(face);
      marked.get(part).push(...part.plain.subarray(3 * (face - part.first), 3 * (face - part.first) + 3));
    }
    for (const [{ marks }, corners] of marked) {
      marks.geometry.setIndex(corners);
      marks.visible = corners.length > 0;
    }
  }

  /** Meshes with hidden faces. */
  get hidden() {
    return this.#parts.filter(({ flags }) => flags.includes(1)).map(({ mesh, flags }) => ({ mesh, flags }));
  }

  /** The corners of every hidden face. */
  get hiddenCorners() {
    return this.#parts.flatMap(({ corners, flags, mesh }) => {
      const at = (i) => new Vector3().fromArray(corners, 3 * i).applyMatrix4(mesh.matrixWorld).toArray();
      return Array.from(flags.keys()).filter((i) => flags[i]).map((i) => [0, 1, 2].map((corner) => at(3 * i + corner)));
    });
  }

  #part(face) {
    return this.#parts.findLast(({ first }) => first <= face);
  }
}
