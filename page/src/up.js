// The up direction by three clicked points of the floor, as the program's option wants it.
import { Matrix4, Quaternion, Vector3 } from 'three';

const AXES = {
  x: [1, 0, 0], '-x': [-1, 0, 0], y: [0, 1, 0], '-y': [0, -1, 0], z: [0, 0, 1], '-z': [0, 0, -1],
};
/** Rows of the rotations that take these axes to +Y. */
const TO_Y_UP = {
  y: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], '-y': [[1, 0, 0], [0, -1, 0], [0, 0, -1]], z: [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
  '-z': [[1, 0, 0], [0, 0, -1], [0, 1, 0]], x: [[0, -1, 0], [1, 0, 0], [0, 0, 1]], '-x': [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
};

/** A direction of the file as a direction of the scene that the file was baked from. */
export function sourceDirection(direction, placement) {
  const { up = 'y', rotate = 0 } = placement ?? {};
  const turned = direction.clone().applyAxisAngle(new Vector3(0, 1, 0), (-rotate * Math.PI) / 180);
  const vector = new Vector3(...(AXES[up] ?? up)).normalize();
  const nearest = Object.keys(AXES).reduce((best, axis) => (new Vector3(...AXES[axis]).dot(vector) > new Vector3(...AXES[best]).dot(vector) ? axis : best), 'x');
  const rows = TO_Y_UP[nearest].map((row) => new Vector3(...row));
  const back = new Matrix4().makeBasis(...rows);
  const arc = new Quaternion().setFromUnitVectors(new Vector3(...AXES[nearest]), vector);
  return turned.applyMatrix4(back).applyQuaternion(arc);
}

/** The normal of the plane through three points, on the side of `eye`; null for points on a line. */
export function normalOf([a, b, c], eye) {
  const [ab, ac] = [b.clone().sub(a), c.clone().sub(a)];
  const normal = ab.clone().cross(ac);
  if (normal.length() < 0.02 * ab.length() * ac.length()) return null;
  normal.normalize();
  return normal.dot(eye.clone().sub(a)) < 0 ? normal.negate() : normal;
}

/** The option of the program for an up direction, which is copied too. */
export function copiedOption(direction) {
  const option = `--up ${direction.toArray().map((x) => Number(x.toFixed(4)) + 0)}`;
  navigator.clipboard?.writeText(option).catch(() => {});
  return option;
}

/** Asks for three points, and turns the view upright. */
export class Up {
  #points = null;
  #page;

  /** `page` has element, canvas, controls, meshes, and turn(up), which returns what to say of it. */
  constructor(page) {
    this.#page = page;
    page.element('up').addEventListener('click', () => this.#start());
    let from = null;
    page.canvas.addEventListener('pointerdown', (event) => {
      from = [event.clientX, event.clientY];
      // What was said of the last three points has been read.
      if (this.#points === null) this.#say('');
    });
    page.canvas.addEventListener('pointerup', (event) => {
      if (from && Math.hypot(event.clientX - from[0], event.clientY - from[1]) < 4) this.#click(event);
    });
    addEventListener('keydown', (event) => event.code === 'Escape' && this.#points && this.#say(''));
  }

  #start() {
    const on = this.#points === null;
    this.#points = on ? [] : null;
    this.#say(on ? 'Click three points of the floor, far from each other (Esc ends).' : '');
  }

  #say(text) {
    const { element } = this.#page;
    element('floor').textContent = text;
    element('floor').hidden = !text;
    if (!text) this.#points = null;
    element('up').setAttribute('aria-pressed', this.#points !== null);
  }

  #click(event) {
    if (this.#points === null) return;
    const { controls, meshes, turn } = this.#page;
    const point = controls.hit(event, meshes);
    if (!point) return;
    this.#points.push(point);
    if (this.#points.length < 3) {
      this.#say(`Click ${3 - this.#points.length} more of the floor.`);
      return;
    }
    const normal = normalOf(this.#points, controls.view.eye);
    this.#points = normal && null;
    if (!normal) {
      this.#points = [];
      this.#say('These points lie on a line: click three others.');
      return;
    }
    this.#say(turn(normal));
  }

  /** Ends the clicks, because the scene is another now. */
  forget() {
    if (this.#points) this.#say('');
  }
}
