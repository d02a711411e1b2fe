// Mouse, touch and keys. Orbit goes around a pivot; flying is an orbit around a pivot just in front of the camera.
import { MathUtils, MOUSE, Quaternion, Raycaster, Spherical, Vector2, Vector3 } from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';

/** Distance to the pivot while flying, in radii of the scene. */
const FLY_PIVOT = 1e-3;
/** Speed of movement per second, as a share of the distance to what is seen. */
const SPEED = 0.5;
/** How far a drag pulls beyond the limits of the orbit, radians. */
const GIVE = 0.15;
/** Rate at which the orbit returns to its limits, 1/s. */
const RETURN = 8;
/** The slowest glide, radians or radii of the scene per step. What is left of a slower one is below a tenth of a pixel. */
const GLIDE = 1e-5;
/** From here, in radii of everything, all of it is as high as the picture: farther away it is a dot in the dark. */
const FARTHEST = 2.5;
const DIRECTIONS = {
  KeyW: [0, 0, 1], ArrowUp: [0, 0, 1], KeyS: [0, 0, -1], ArrowDown: [0, 0, -1],
  KeyA: [-1, 0, 0], ArrowLeft: [-1, 0, 0], KeyD: [1, 0, 0], ArrowRight: [1, 0, 0],
  KeyQ: [0, -1, 0], KeyE: [0, 1, 0],
};

/** The direction of an eye from its target, with `up` as the pole: angles as OrbitControls counts them. */
function direction(eye, target, up) {
  const upright = new Quaternion().setFromUnitVectors(up, new Vector3(0, 1, 0));
  return new Spherical().setFromVector3(eye.clone().sub(target).applyQuaternion(upright));
}

/** The angle, by whole turns where it is nearest to another. */
function around(angle, middle) {
  return MathUtils.euclideanModulo(angle - middle + Math.PI, 2 * Math.PI) - Math.PI + middle;
}

export class Controls {
  #orbit = null;
  #camera;
  #canvas;
  #radius;
  #reach;
  #pressed = new Set();
  #intrinsics = null;
  #flying = false;
  #pivotDistance;
  #viewpoint;
  #range = null;
  #unlimited = false;
  #dragging = false;
  #buttons = null;
  /** Told whenever a drag pulls beyond the limits of the orbit. */
  onLimit = () => {};
  /** The distance to what is seen, for the speed of movement. */
  seenDistance;
  /** Where the camera was at the end of the last step: events move it between steps too. */
  #last = { position: new Vector3(), quaternion: new Quaternion() };

  /** `viewpoint` is the file's, or null: it says how far photos look around. `reach` is the radius of everything. */
  constructor(camera, canvas, radius, viewpoint, reach = 400 * radius) {
    [this.#camera, this.#canvas, this.#radius, this.#reach, this.#pivotDistance] = [camera, canvas, radius, reach, radius];
    this.#viewpoint = viewpoint;
    this.seenDistance = () => radius;
    addEventListener('keydown', (event) => this.#key(event, true));
    addEventListener('keyup', (event) => this.#key(event, false));
    addEventListener('blur', () => this.#pressed.clear());
    canvas.addEventListener('wheel', (event) => this.#wheel(event), { passive: true });
  }

  /** Sets the camera to `view`. */
  set({ eye, target, up, fov, pinhole }) {
    const camera = this.#camera;
    this.#orbit?.dispose();
    camera.position.copy(eye);
    camera.up.copy(up).normalize();
    this.#intrinsics = { fov, pinhole };
    // OrbitControls reads the up axis in its constructor.
    const orbit = new OrbitControls(camera, this.#canvas);
    const maxDistance = Math.max(FARTHEST * this.#reach, eye.distanceTo(target));
    Object.assign(orbit, { enableDamping: true, dampingFactor: 0.12, zoomToCursor: true, maxDistance });
    orbit.target.copy(target);
    orbit.mouseButtons = this.#buttons ?? orbit.mouseButtons;
    orbit.addEventListener('start', () => (this.#dragging = true));
    orbit.addEventListener('end', () => (this.#dragging = false));
    this.#orbit = orbit;
    this.#dragging = false;
    camera.lookAt(target);
    if (this.#flying) this.fly(true);
    this.#limit();
    orbit.update();
    this.#stay();
  }

  /** What the buttons of the mouse do, as OrbitControls names it; null for the usual. */
  set buttons(buttons) {
    this.#buttons = buttons;
    this.#orbit.mouseButtons = buttons ?? { LEFT: MOUSE.ROTATE, MIDDLE: MOUSE.DOLLY, RIGHT: MOUSE.PAN };
  }

  /** Lifts the limits of the orbit. */
  lookAnywhere() {
    this.#unlimited = true;
    this.#limit();
  }

  /** The view of the camera now. */
  get view() {
    const { position: eye, up } = this.#camera;
    return { eye, target: this.#orbit.target, up, ...this.#intrinsics };
  }

  /** True while keys move the camera. */
  get walking() {
    return [...this.#pressed].some((code) => DIRECTIONS[code]);
  }

  get flying() {
    return this.#flying;
  }

  /** Switches to flying, or back to an orbit around a pivot as far ahead as before. */
  fly(on) {
    const orbit = this.#orbit;
    const eye = this.#camera.position;
    if (on) this.#pivotDistance = Math.max(orbit.target.distanceTo(eye), 2 * FLY_PIVOT * this.#radius);
    this.#flying = on;
    orbit.target.copy(eye).addScaledVector(this.#ahead(), on ? FLY_PIVOT * this.#radius : this.#pivotDistance);
    orbit.rotateSpeed = on ? -0.4 : 1;
    orbit.panSpeed = on ? 0.5 / FLY_PIVOT : 1;
    orbit.enableZoom = !on;
    this.#limit();
  }

  /** Advances by `seconds`; true when the camera has moved since the last step. */
  step(seconds) {
    const direction = new Vector3();
    for (const code of this.#pressed) if (DIRECTIONS[code]) direction.add(new Vector3(...DIRECTIONS[code]));
    const fast = this.#pressed.has('ShiftLeft') || this.#pressed.has('ShiftRight') ? 4 : 1;
    if (direction.lengthSq() > 0) this.#translate(direction.normalize(), SPEED * fast * this.seenDistance() * seconds);
    this.#pull(seconds);
    this.#glide();
    const { position, quaternion } = this.#camera;
    const moved = position.distanceTo(this.#last.position) > 1e-6 * this.#radius || quaternion.angleTo(this.#last.quaternion) > 1e-6;
    // Only a move that is drawn is the new start, so that slow ones add up.
    if (moved) this.#stay();
    return moved;
  }

  /** Takes the present place of the camera as that of the last step. */
  #stay() {
    this.#last.position.copy(this.#camera.position);
    this.#last.quaternion.copy(this.#camera.quaternion);
  }

  /** Lets the orbit glide, and ends a glide that nobody sees: otherwise the picture at rest would begin again and again. */
  #glide() {
    const orbit = this.#orbit;
    const [from, turned] = [this.#camera.position.clone(), this.#camera.quaternion.clone()];
    orbit.update();
    const step = Math.max(this.#camera.position.distanceTo(from) / this.#radius, this.#camera.quaternion.angleTo(turned));
    if (step === 0 || step > GLIDE) return;
    orbit.enableDamping = false;
    orbit.update();
    orbit.enableDamping = true;
  }

  /** Sets the pivot to what is hit at a point of the canvas, and returns it; null if nothing is. */
  focus(event, meshes) {
    const hit = this.hit(event, meshes);
    if (!hit || this.#flying) return null;
    this.#orbit.target.copy(hit);
    this.#limit();
    return hit;
  }

  /** The nearest point of the meshes that is drawn at a point of the canvas, or null. */
  hit(event, meshes) {
    const box = this.#canvas.getBoundingClientRect();
    const at = new Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
    const ray = new Raycaster();
    ray.setFromCamera(at, this.#camera);
    ray.near = this.#camera.near / ray.ray.direction.dot(this.#ahead());
    const shown = meshes.filter((mesh) => mesh.visible);
    return ray.intersectObjects(shown, false)[0]?.point ?? null;
  }

  /** Finds the range of the orbit: where photos looked, and where the view is if that is beyond. Flying goes anywhere. */
  #limit() {
    const [orbit, camera] = [this.#orbit, this.#camera];
    this.#range = null;
    Object.assign(orbit, { minAzimuthAngle: -Infinity, maxAzimuthAngle: Infinity, minPolarAngle: 0, maxPolarAngle: Math.PI });
    if (this.#flying || this.#unlimited || !this.#viewpoint?.orbit) return;
    const [eye, target, up] = ['eye', 'target', 'up'].map((word) => new Vector3(...this.#viewpoint[word]));
    if (up.normalize().angleTo(camera.up) > 1e-3) return;
    const { turn, elevation } = this.#viewpoint.orbit;
    const [start, here] = [direction(eye, target, up), direction(camera.position, orbit.target, up)];
    const [low, high] = elevation.map((degrees) => Math.PI / 2 - MathUtils.degToRad(degrees));
    this.#range = { polar: [Math.min(high, here.phi), Math.max(low, here.phi)], turn: null };
    if (turn) {
      const [least, most] = turn.map(MathUtils.degToRad);
      // The turn of the view, by whole turns where it is nearest to the range.
      const turned = around(here.theta - start.theta, (least + most) / 2);
      const [from, to] = [Math.min(least, turned), Math.max(most, turned)];
      if (to - from < 2 * Math.PI) this.#range.turn = [start.theta + from, start.theta + to];
    }
    this.#pull(0);
  }

  /** Lets a drag pull a little beyond the range, ever harder, and brings the orbit back once it is let go. */
  #pull(seconds) {
    const [orbit, range] = [this.#orbit, this.#range];
    if (!range) return;
    const beyond = ([from, to], angle) => Math.max(0, from - angle, angle - to);
    const turnBeyond = range.turn ? beyond(range.turn, around(orbit.getAzimuthalAngle(), (range.turn[0] + range.turn[1]) / 2)) : 0;
    const excess = Math.max(turnBeyond, beyond(range.polar, orbit.getPolarAngle()));
    const left = excess * Math.exp(-RETURN * seconds);
    const give = this.#dragging ? GIVE : left > 1e-4 ? left : 0;
    orbit.minPolarAngle = Math.max(0, range.polar[0] - give);
    orbit.maxPolarAngle = Math.min(Math.PI, range.polar[1] + give);
    if (range.turn) {
      const isWhole = range.turn[1] - range.turn[0] + 2 * give >= 2 * Math.PI;
      orbit.minAzimuthAngle = isWhole ? -Infinity : around(range.turn[0] - give, 0);
      orbit.maxAzimuthAngle = isWhole ? Infinity : around(range.turn[1] + give, 0);
    }
    orbit.rotateSpeed = Math.max(0.1, 1 - excess / GIVE);
    if (this.#dragging && excess > 0.2 * GIVE) this.onLimit();
  }

  #ahead() {
    return new Vector3(0, 0, -1).applyQuaternion(this.#camera.quaternion);
  }

  #translate([right, up, ahead], distance) {
    const direction = new Vector3(right, 0, -ahead).applyQuaternion(this.#camera.quaternion).addScaledVector(this.#camera.up, up);
    direction.setLength(distance);
    this.#camera.position.add(direction);
    this.#orbit.target.add(direction);
  }

  #key(event, down) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (down) this.#pressed.add(event.code);
    else this.#pressed.delete(event.code);
  }

  #wheel(event) {
    if (this.#flying) this.#translate([0, 0, -Math.sign(event.deltaY)], 0.1 * this.seenDistance());
  }
}
