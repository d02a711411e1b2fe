// The tools of a page for the scenes of the app: up by three clicks, and the eraser, whose list the next bake gets.
import { Eraser, eraseList } from '../src/eraser.js';
import { copiedOption, Up } from '../src/up.js';
import { sourceOf } from './scene.js';

export class Tools {
  #shown;
  #up;
  #eraser;

  /**
   * `app` has element; scene(), the open scene; turn(up), which applies an up direction; bake(), which bakes without what is erased; and
   * erasing(on), told when the eraser opens and closes.
   */
  constructor(shown, app) {
    this.#shown = shown;
    const { element } = app;
    const { canvas, renderer, controls } = shown.parts('before');
    const turn = (direction) => {
      const option = copiedOption(sourceOf(direction, app.scene().toView));
      app.turn(option.split(' ')[1]);
      return `The scene is turned by ${option} (copied, for the program).`;
    };
    const before = { get meshes() { return shown.parts('before').meshes; } };
    this.#up = new Up(Object.assign(before, { element, canvas, controls, turn }));
    element('save').textContent = 'bake without them';
    element('save').title = 'Bake again, without what was erased';
    const after = {
      get scene() { return shown.parts('after').scene; },
      get meshes() { return shown.parts('after').meshes; },
      get title() { return app.scene().name; },
    };
    const list = () => this.list(app.scene().erased);
    this.#eraser = new Eraser(Object.assign(after, { element, canvas, renderer, controls, save: app.bake, list, opened: app.erasing }));
  }

  /** The list of these triangles and of those that are erased now. */
  list(erased) {
    return eraseList(this.#shown.extras, this.erased(erased));
  }

  /** These triangles and those that are erased now, in the frame of the shown scenes. */
  erased(before) {
    const { unit } = this.#shown;
    const now = this.#eraser.erased.map((corners) => corners.map((corner) => corner.map((x) => x * unit)));
    return [...before, ...now];
  }

  /** Ends what the tools were doing, because another scene is shown. */
  forget() {
    this.#up.forget();
    this.#eraser.forget();
  }
}
