// The box of a crop: six handles, which are sliders, so that keys and fingers move them too.

const AXES = ['x', 'y', 'z'];
const STEPS = 200;
/** Range of the handles, as a multiple of the box of nearly all of the scene. */
const MARGIN = 0.05;
/** A handle at its end does not crop. */
const FAR = 1e9;

export class Crop {
  #element;
  #ranges = [];

  /** Puts the handles into `element`; `changed()` is called when one moves. */
  constructor(element, changed) {
    this.#element = element;
    const handle = (axis, side) => {
      const label = document.createElement('label');
      const input = Object.assign(document.createElement('input'), { type: 'range', min: 0, max: STEPS, step: 1, value: side * STEPS });
      input.id = `${axis}${side}`;
      input.addEventListener('input', changed);
      label.append(`${axis} ${side ? 'to' : 'from'}`, input);
      element.append(label);
      return input;
    };
    this.handles = AXES.map((axis) => [handle(axis, 0), handle(axis, 1)]);
  }

  /** Begins with the whole scene. Nearly all of it is within `bounds`: lowest and highest of each axis. */
  reset(bounds) {
    this.#ranges = bounds.map(([low, high]) => {
      const more = MARGIN * Math.max(high - low, 1e-9);
      return [low - more, high + more];
    });
    this.handles.forEach(([low, high]) => ([low.value, high.value] = [0, STEPS]));
  }

  set hidden(hidden) {
    this.#element.hidden = hidden;
  }

  #at(axis, side) {
    const [low, high] = this.#ranges[axis];
    const [a, b] = this.handles[axis].map((input) => Number(input.value));
    const step = side ? Math.max(a, b) : Math.min(a, b);
    return { end: step === side * STEPS, value: low + ((high - low) * step) / STEPS };
  }

  /** Lowest and highest corner. */
  get corners() {
    return [0, 1].map((side) => AXES.map((_, axis) => this.#at(axis, side).value));
  }

  /** The region as an option of the bake. */
  get region() {
    const corner = (side) => AXES.map((_, axis) => this.#at(axis, side)).map(({ end, value }) => (end ? (side ? FAR : -FAR) : value));
    return [...corner(0), ...corner(1)].join(',');
  }
}
