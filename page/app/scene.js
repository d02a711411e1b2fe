// The shown scenes: before and after the bake, on both sides of a line.
import { BoxGeometry, EdgesGeometry, Group, LineBasicMaterial, LineSegments, Matrix4, Mesh, Vector3, Vector4 } from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { Controls } from '../src/controls.js';
import { Renderer } from '../src/renderer.js';
import { TrisplatSh } from '../src/sh.js';
import { boundsOf, first, initial } from '../src/view.js';

/** Samples per pixel along each axis, once nothing moves. */
const GRID = 2;
const BACKGROUND = '#17181a';
/** Vertices for choosing the box of a crop. */
const SAMPLES = 20_000;
/** Share of them outside the first box, on each side. */
const OUTLIERS = 0.005;

/** The picture: both scenes in a frame whose unit is the radius of the first. */
export class Shown {
  #canvas;
  #renderer;
  #controls;
  #stage = new Group();
  #sides = { before: null, after: null };
  #split = 0.5;
  #wires = false;
  #unit = 1;
  #extras = {};
  #box = null;
  #rested = true;
  #onRest;

  /** Fails without WebGL 2. `onRest(atRest)`: called when the picture comes to rest, and when it moves again. */
  constructor(canvas, onRest) {
    this.#canvas = canvas;
    this.#onRest = onRest;
    this.#renderer = new Renderer(canvas, GRID, BACKGROUND);
    this.#controls = new Controls(this.#renderer.camera, canvas, 1);
    this.#renderer.show(this.#stage);
    this.#renderer.resize();
    this.#controls.set(first({ center: new Vector3(), radius: 1, behind: [] }, this.#aspect));
    canvas.addEventListener('dblclick', (event) => this.#controls.focus(event, this.#meshes(this.#sides.before)));
    this.#run();
  }

  get #aspect() {
    return this.#renderer.width / this.#renderer.height;
  }

  /** Shows a GLB as `side`. The first one decides the viewpoint and the unit. */
  async show(side, bytes, { keepView = false } = {}) {
    const { scene, asset } = await new GLTFLoader().register((parser) => new TrisplatSh(parser)).parseAsync(bytes.buffer, '');
    this.remove(side);
    scene.updateMatrixWorld(true);
    this.#sides[side] = scene;
    const meshes = this.#meshes(scene);
    meshes.forEach((mesh) => this.#cut(mesh, side));
    if (side === 'before') {
      this.#unit = boundsOf(meshes).radius;
      this.#extras = asset.extras ?? {};
    }
    this.#stage.add(scene);
    this.#stage.scale.setScalar(1 / this.#unit);
    this.#stage.updateMatrixWorld(true);
    this.wires(this.#wires);
    if (side === 'before' && !keepView) this.#look(meshes, asset.extras?.viewpoint);
    this.#renderer.restart();
  }

  #look(meshes, viewpoint) {
    const bounds = boundsOf(meshes);
    const scaled = (v) => v.map((x) => x / this.#unit);
    const from = viewpoint && {
      ...viewpoint, eye: scaled(viewpoint.eye), target: scaled(viewpoint.target), radius: viewpoint.radius && viewpoint.radius / this.#unit,
    };
    Object.assign(this.#renderer.camera, { near: 1e-3 * bounds.radius, far: 1e3 * bounds.reach });
    this.#controls.set(initial(from ?? null, bounds, this.#aspect));
  }

  remove(side) {
    const scene = this.#sides[side];
    if (!scene) return;
    this.#stage.remove(scene);
    this.#meshes(scene).forEach((mesh) => (mesh.geometry.dispose(), mesh.material.dispose()));
    this.#sides[side] = null;
    this.#renderer.restart();
  }

  /** What the tools of a page work with: the picture, and the scene of a side. */
  parts(side) {
    const scene = this.#sides[side];
    return { canvas: this.#canvas, renderer: this.#renderer, controls: this.#controls, scene, meshes: this.#meshes(scene) };
  }

  /** What the first scene's file says of itself. */
  get extras() {
    return this.#extras;
  }

  /** Size of the picture's unit in the frame of the scenes. */
  get unit() {
    return this.#unit;
  }

  #meshes(scene) {
    const meshes = [];
    scene?.traverse((node) => node instanceof Mesh && meshes.push(node));
    return meshes;
  }

  // Each side is drawn into its part of the picture only.
  #cut(mesh, side) {
    const viewport = new Vector4();
    mesh.onBeforeRender = ({ state }, _scene, _camera) => {
      if (!this.#sides.after || !this.#sides.before) return;
      const { z: width, w: height } = this.#viewportOf(viewport);
      const at = Math.round(this.#split * width);
      state.setScissorTest(true);
      state.scissor(side === 'before' ? viewport.set(0, 0, at, height) : viewport.set(at, 0, width - at, height));
    };
    mesh.onAfterRender = ({ state }) => state.setScissorTest(false);
  }

  #viewportOf(into) {
    return into.set(0, 0, this.#renderer.width, this.#renderer.height);
  }

  /** Position of the slider between before and after, 0 to 1. */
  set split(share) {
    this.#split = share;
    this.#renderer.restart();
  }

  wires(on) {
    this.#wires = on;
    for (const side of Object.values(this.#sides)) {
      for (const { material } of this.#meshes(side)) Object.assign(material, { wireframe: on });
    }
    this.#renderer.restart();
  }

  /** The view, in the frame of the scene's file, for the program to draw from. */
  get view() {
    const { eye, target, up, fov } = this.#controls.view;
    const back = (v) => v.toArray().map((x) => x * this.#unit);
    return { eye: back(eye), target: back(target), up: up.toArray(), fov };
  }

  get size() {
    return [this.#renderer.width, this.#renderer.height];
  }

  /** Lowest and highest corner of nearly all of the scene, in the coordinates that `toView`, 4 columns, comes from. */
  bounds(toView) {
    const back = matrix(toView).invert();
    const meshes = this.#meshes(this.#sides.before).filter((mesh) => mesh.name !== 'backdrop');
    const count = meshes.reduce((sum, mesh) => sum + mesh.geometry.attributes.position.count, 0);
    const step = Math.max(1, Math.floor(count / SAMPLES));
    const points = [];
    for (const mesh of meshes) {
      const { position } = mesh.geometry.attributes;
      for (let i = 0; i < position.count; i += step) {
        const point = new Vector3().fromBufferAttribute(position, i).applyMatrix4(mesh.matrixWorld).multiplyScalar(this.#unit);
        points.push(point.applyMatrix4(back));
      }
    }
    return ['x', 'y', 'z'].map((axis) => {
      const sorted = Float64Array.from(points, (point) => point[axis]).sort();
      const at = (share) => sorted[Math.round(share * (sorted.length - 1))] ?? 0;
      return [at(OUTLIERS), at(1 - OUTLIERS)];
    });
  }

  /** Draws the box from `low` to `high`, in the coordinates that `toView` comes from; none without them. */
  box(low, high, toView) {
    if (this.#box) this.#stage.remove(this.#box);
    this.#box = null;
    if (low) {
      const size = new Vector3(...high).sub(new Vector3(...low));
      const edges = new EdgesGeometry(new BoxGeometry(size.x, size.y, size.z));
      edges.translate(...new Vector3(...low).addScaledVector(size, 0.5).toArray());
      this.#box = new LineSegments(edges, new LineBasicMaterial({ color: '#ffd479', toneMapped: false, depthTest: false }));
      this.#box.renderOrder = 1;
      this.#box.applyMatrix4(matrix(toView));
      this.#stage.add(this.#box);
      this.#stage.updateMatrixWorld(true);
    }
    this.#renderer.restart();
  }

  #run() {
    let last = performance.now();
    const frame = (now) => {
      const moved = this.#controls.step(Math.min(0.1, (now - last) / 1000));
      last = now;
      if (this.#renderer.resize() || moved) this.#renderer.restart();
      const resting = !this.#renderer.unfinished;
      if (!resting) this.#renderer.draw(this.#controls.view);
      if (resting !== this.#rested) this.#onRest((this.#rested = resting));
      requestAnimationFrame(frame);
    };
    frame(last);
  }
}

/** A direction of the picture in the coordinates that `toView` comes from. */
export function sourceOf(direction, toView) {
  return direction.clone().transformDirection(matrix(toView).invert());
}

/** Triangles of a picture whose scene stood by `from`, where they are now that it stands by `to`. */
export function moved(triangles, from, to) {
  const change = matrix(to).multiply(matrix(from).invert());
  return triangles.map((corners) => corners.map((corner) => new Vector3(...corner).applyMatrix4(change).toArray()));
}

function matrix([x, y, z, origin]) {
  return new Matrix4().makeBasis(new Vector3(...x), new Vector3(...y), new Vector3(...z)).setPosition(new Vector3(...origin));
}
