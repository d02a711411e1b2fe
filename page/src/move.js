// Mouse, fingers and keys. Orbit turns about a spot; fly is orbit about a spot just before one's nose.
import { Raycaster, Vector2, Vector3 } from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';

/** Distance to the spot that fly turns about, in radii of the scene. */
const NOSE = 1e-3;
/** Walking speed, radii of the scene a second. */
const SPEED = 0.5;
const WALK = {
  KeyW: [0, 0, 1], ArrowUp: [0, 0, 1], KeyS: [0, 0, -1], ArrowDown: [0, 0, -1],
  KeyA: [-1, 0, 0], ArrowLeft: [-1, 0, 0], KeyD: [1, 0, 0], ArrowRight: [1, 0, 0],
  KeyQ: [0, -1, 0], KeyE: [0, 1, 0],
};

export class Move {
  #orbit = null;
  #camera;
  #canvas;
  #radius;
  #down = new Set();
  #lens = null;
  #flying = false;
  #reach;

  constructor(camera, canvas, radius) {
    [this.#camera, this.#canvas, this.#radius, this.#reach] = [camera, canvas, radius, radius];
    addEventListener('keydown', (event) => this.#key(event, true));
    addEventListener('keyup', (event) => this.#key(event, false));
    addEventListener('blur', () => this.#down.clear());
    canvas.addEventListener('wheel', (event) => this.#wheel(event), { passive: true });
  }

  /** Stands where `view` says. */
  set({ eye, target, up, fov, pinhole }) {
    const camera = this.#camera;
    this.#orbit?.dispose();
    camera.position.copy(eye);
    camera.up.copy(up).normalize();
    this.#lens = { fov, pinhole };
    // OrbitControls learns the up axis when it is made.
    const orbit = new OrbitControls(camera, this.#canvas);
    Object.assign(orbit, { enableDamping: true, dampingFactor: 0.12, zoomToCursor: true, maxDistance: 1e3 * this.#radius });
    orbit.target.copy(target);
    this.#orbit = orbit;
    camera.lookAt(target);
    if (this.#flying) this.fly(true);
  }

  /** Where it stands now. */
  get view() {
    const { position: eye, up } = this.#camera;
    return { eye, target: this.#orbit.target, up, ...this.#lens };
  }

  get flying() {
    return this.#flying;
  }

  /** Turns on the spot, or about a spot as far ahead as before. */
  fly(on) {
    const orbit = this.#orbit;
    const eye = this.#camera.position;
    if (on) this.#reach = Math.max(orbit.target.distanceTo(eye), 2 * NOSE * this.#radius);
    this.#flying = on;
    orbit.target.copy(eye).addScaledVector(this.#ahead(), on ? NOSE * this.#radius : this.#reach);
    orbit.rotateSpeed = on ? -0.4 : 1;
    orbit.panSpeed = on ? 0.5 / NOSE : 1;
    orbit.enableZoom = !on;
  }

  /** Moves on by `seconds`; true when the camera is not where it was. */
  step(seconds) {
    const way = new Vector3();
    for (const code of this.#down) if (WALK[code]) way.add(new Vector3(...WALK[code]));
    const fast = this.#down.has('ShiftLeft') || this.#down.has('ShiftRight') ? 4 : 1;
    if (way.lengthSq() > 0) this.#walk(way.normalize(), SPEED * fast * this.#radius * seconds);
    const before = [this.#camera.position.clone(), this.#camera.quaternion.clone()];
    const moved = way.lengthSq() > 0;
    this.#orbit.update();
    return moved || this.#camera.position.distanceTo(before[0]) > 1e-6 * this.#radius || before[1].angleTo(this.#camera.quaternion) > 1e-6;
  }

  /** Turns about what lies under a point of the canvas; nothing there changes nothing. */
  focus(event, meshes) {
    const box = this.#canvas.getBoundingClientRect();
    const at = new Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
    const ray = new Raycaster();
    ray.setFromCamera(at, this.#camera);
    const [hit] = ray.intersectObjects(meshes, false);
    if (hit && !this.#flying) this.#orbit.target.copy(hit.point);
  }

  #ahead() {
    return new Vector3(0, 0, -1).applyQuaternion(this.#camera.quaternion);
  }

  #walk([right, up, ahead], distance) {
    const way = new Vector3(right, 0, -ahead).applyQuaternion(this.#camera.quaternion).addScaledVector(this.#camera.up, up);
    way.setLength(distance);
    this.#camera.position.add(way);
    this.#orbit.target.add(way);
  }

  #key(event, down) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (down) this.#down.add(event.code);
    else this.#down.delete(event.code);
  }

  #wheel(event) {
    if (this.#flying) this.#walk([0, 0, -Math.sign(event.deltaY)], 0.05 * this.#radius);
  }
}
