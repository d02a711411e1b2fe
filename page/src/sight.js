// What stands between the camera and the subject: it is cut away by the near plane, so that an orbit never ends behind it.
import { Vector3 } from 'three';
import { applyView } from './view.js';

/** Width and height of the depth picture that looks for it. */
const SIZE = 32;
/** Part of the subject, around its center, that stays in sight. */
const WITHIN = 0.8;
/** Share of it that is hidden when something is in the way. */
const HIDDEN = 0.5;
/** Things nearer than this part of the way to the subject are in the way. */
const BEFORE = 0.85;
/** Layers that are cut away at most. */
const LAYERS = 6;
/** Milliseconds between two looks during a motion. */
const INTERVAL = 120;
/** Rate at which the near plane reaches its place, 1/s. */
const RATE = 12;

export class Sight {
  #renderer;
  #near;
  #goal;
  #subject;
  #looked = 0;
  #waiting = false;
  #distance;

  /** `subject` has a `center` and a `radius`; `near` is the plane while nothing is in the way. */
  constructor(renderer, near, subject) {
    [this.#renderer, this.#near, this.#goal, this.#distance] = [renderer, near, near, subject.radius];
    this.subject = subject;
  }

  /** What stays in sight. */
  set subject({ center, radius }) {
    this.#subject = { center: center.clone(), radius };
  }

  /** The near plane if it cuts something away, or null. */
  get cut() {
    return this.#renderer.camera.near > this.#near ? this.#renderer.camera.near : null;
  }

  /** Shows a view as it is, with this near plane. */
  hold(near = this.#near) {
    this.#renderer.camera.near = this.#goal = near;
    this.#waiting = false;
  }

  /** Looks at once, and cuts. */
  settle(view) {
    this.#look(view);
    this.#renderer.camera.near = this.#goal;
  }

  /** Advances by `seconds`; true when the picture changes. While `free` nothing is cut away. */
  step(seconds, view, moved, free) {
    const camera = this.#renderer.camera;
    this.#waiting = !free && (this.#waiting || moved);
    if (free) this.#goal = this.#near;
    if (this.#waiting && (!moved || performance.now() - this.#looked > INTERVAL)) {
      this.#look(view);
      this.#waiting = moved;
    }
    if (camera.near === this.#goal) return false;
    const next = this.#goal * (camera.near / this.#goal) ** Math.exp(-RATE * seconds);
    camera.near = Math.abs(next / this.#goal - 1) < 0.02 ? this.#goal : next;
    return true;
  }

  /** Distance to the nearest fifth of what the middle of the picture shows, within the radius of the scene. */
  distance(view, radius) {
    if (performance.now() - this.#looked > INTERVAL) {
      const depths = this.#depths(view, this.#near).filter((_, i) => isBetween(i % SIZE) && isBetween(Math.floor(i / SIZE)));
      this.#distance = Math.min(radius, Math.max(0.02 * radius, depths.sort()[Math.floor(depths.length / 5)]));
    }
    return this.#distance;
  }

  #depths(view, near) {
    this.#looked = performance.now();
    return this.#renderer.depths(view, near, SIZE);
  }

  /** Finds the near plane behind all that hides most of the subject. */
  #look(view) {
    const { camera, width, height } = this.#renderer;
    const { center, radius } = this.#subject;
    applyView(camera, view, width, height);
    camera.updateMatrixWorld();
    const place = center.clone().applyMatrix4(camera.matrixWorldInverse);
    const room = BEFORE * (-place.z - radius);
    this.#goal = this.#near;
    if (room <= this.#near) return;
    const [at, edge] = [place.clone(), place.clone().add(new Vector3(WITHIN * radius, WITHIN * radius, 0))].map((p) => p.applyMatrix4(camera.projectionMatrix));
    if (Math.max(Math.abs(at.x), Math.abs(at.y)) > 1) return;
    const [across, up] = [edge.x - at.x, edge.y - at.y].map((span) => Math.max(2.5 / SIZE, span));
    const isMiddle = (i) => {
      const [x, y] = [i % SIZE, Math.floor(i / SIZE)].map((cell) => ((cell + 0.5) / SIZE) * 2 - 1);
      return Math.hypot((x - at.x) / across, (y - at.y) / up) < 1;
    };
    for (let layer = 0; layer < LAYERS; layer++) {
      const middle = this.#depths(view, this.#goal).filter((_, i) => isMiddle(i));
      const hiding = middle.filter((one) => one < room).sort();
      if (hiding.length <= HIDDEN * middle.length) return;
      this.#goal = Math.min(room, 1.02 * hiding.at(-1));
    }
    this.#goal = room;
  }
}

/** True for the middle half of a row. */
function isBetween(cell) {
  return cell >= SIZE / 4 && cell < (3 * SIZE) / 4;
}
