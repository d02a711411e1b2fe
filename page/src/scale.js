// A bar as long as a round length at the distance of the orbit's centre, where a unit of the file is a metre.

/** Longest bar, px. */
const WIDEST = 160;

export class ScaleBar {
  #element;
  #isKnown;

  /** `placement` is the file's: a scene that was scaled is in metres. */
  constructor(element, placement) {
    [this.#element, this.#isKnown] = [element, (placement?.scale ?? 1) !== 1];
    element.hidden = !this.#isKnown;
  }

  /** Fits the bar to a view. */
  show({ eye, target }, camera) {
    if (!this.#isKnown) return;
    const pixel = (2 * Math.tan((camera.fov * Math.PI) / 360) * eye.distanceTo(target)) / camera.view.fullHeight * Math.min(window.devicePixelRatio, 2);
    const [length, text] = round(WIDEST * pixel);
    this.#element.style.width = `${length / pixel}px`;
    this.#element.firstElementChild.textContent = text;
  }
}

/** The longest round length up to `metres`, and its name. */
function round(metres) {
  const power = 10 ** Math.floor(Math.log10(metres));
  const length = [5, 2, 1].find((digit) => digit * power <= metres) * power;
  const [unit, name] = [[1000, 'km'], [1, 'm'], [0.01, 'cm'], [0, 'mm']].find(([unit]) => length >= 0.999 * unit);
  return [length, `${Number((length / (unit || 0.001)).toPrecision(1))} ${name}`];
}
