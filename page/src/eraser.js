// The eraser: strokes of a lasso or a brush select the triangles that are seen, which can be deleted, and the rest saved.
import { MOUSE } from 'three';
import { Faces } from './faces.js';

/** Width of the brush, px. */
const BRUSH = 24;
const KEYS = {
  Delete: 'delete', Backspace: 'delete', KeyX: 'delete', CtrlKeyZ: 'undo', CtrlKeyY: 'redo', CtrlShiftKeyZ: 'redo', Escape: 'clear',
};

export class Eraser {
  #page;
  #faces = null;
  #selected = new Set();
  #done = [];
  #undone = [];
  #lasso = true;
  #stroke = null;

  /**
   * `page` has the parts of the page, which may change until `forget` is called: element, canvas, renderer, scene, meshes, controls, title;
   * save(faces), which keeps the rest; list(faces), what `trisplat bake --erase` reads; and opened(on), if it wants to know.
   */
  constructor(page) {
    this.#page = page;
    const { element, canvas } = page;
    const actions = {
      lasso: () => this.#tool(true), brush: () => this.#tool(false), delete: () => this.#delete(),
      undo: () => this.#repeat(this.#done, this.#undone, false), redo: () => this.#repeat(this.#undone, this.#done, true),
      save: () => this.#page.save(this.#faces), list: () => this.#list(),
    };
    element('erase').addEventListener('click', () => this.#open(element('eraser').hidden));
    for (const [id, act] of Object.entries(actions)) element(id).addEventListener('click', act);
    addEventListener('keydown', (event) => {
      const key = `${event.ctrlKey || event.metaKey ? 'Ctrl' : ''}${event.shiftKey ? 'Shift' : ''}${event.code}`;
      if (element('eraser').hidden || !KEYS[key]) return;
      if (KEYS[key] === 'clear') this.#select(new Set());
      else actions[KEYS[key]]();
      event.preventDefault();
    });
    // Before the orbit hears of it.
    canvas.parentElement.addEventListener('pointerdown', (event) => event.target === canvas && this.#begin(event), { capture: true });
    canvas.addEventListener('pointermove', (event) => this.#stroke && this.#draw(event));
    addEventListener('pointerup', () => this.#stroke && this.#end());
  }

  #open(on) {
    const { element, scene, meshes, controls } = this.#page;
    if (on) this.#faces ??= new Faces(scene, meshes);
    element('eraser').hidden = !on;
    element('erase').setAttribute('aria-pressed', on);
    controls.buttons = on ? { LEFT: null, MIDDLE: MOUSE.PAN, RIGHT: MOUSE.ROTATE } : null;
    this.#select(new Set());
    this.#page.opened?.(on);
  }

  /** Closes the eraser, because the scene is another now. */
  forget() {
    if (!this.#faces) return;
    this.#open(false);
    this.#faces.dispose();
    this.#faces = null;
    this.#done.length = this.#undone.length = 0;
  }

  /** The corners of every erased triangle, in the frame of the picture. */
  get erased() {
    return this.#faces?.hiddenCorners ?? [];
  }

  #tool(lasso) {
    this.#lasso = lasso;
    this.#page.element('lasso').setAttribute('aria-pressed', lasso);
    this.#page.element('brush').setAttribute('aria-pressed', !lasso);
  }

  #begin(event) {
    if (this.#page.element('eraser').hidden || event.button !== 0) return;
    event.stopPropagation();
    const drawing = this.#page.element('stroke');
    const { clientWidth: width, clientHeight: height } = this.#page.canvas;
    Object.assign(drawing, { width, height, hidden: false });
    this.#stroke = { points: [], removes: event.altKey };
    this.#draw(event);
  }

  /** Draws the stroke; what it covers is what it selects. */
  #draw({ offsetX, offsetY }) {
    const { points } = this.#stroke;
    points.push([offsetX, offsetY]);
    const drawing = this.#page.element('stroke');
    const pen = drawing.getContext('2d', { willReadFrequently: true });
    pen.clearRect(0, 0, drawing.width, drawing.height);
    Object.assign(pen, { lineWidth: this.#lasso ? 2 : BRUSH, lineCap: 'round', lineJoin: 'round', fillStyle: '#ffffff40', strokeStyle: '#ffffffa0' });
    pen.beginPath();
    for (const [x, y] of points) pen.lineTo(x, y);
    if (points.length === 1) pen.lineTo(offsetX + 0.01, offsetY);
    if (this.#lasso) pen.fill();
    pen.stroke();
  }

  #end() {
    const drawing = this.#page.element('stroke');
    const { width, height } = drawing;
    const { data } = drawing.getContext('2d').getImageData(0, 0, width, height);
    const mask = Uint8Array.from({ length: width * height }, (_, i) => {
      // Pictures are read from below.
      const [x, y] = [i % width, height - 1 - Math.floor(i / width)];
      return data[4 * (y * width + x) + 3] > 0;
    });
    const numbers = this.#page.renderer.numbers(this.#faces.numbered(), this.#page.controls.view, width, height);
    const selected = new Set(this.#selected);
    for (const face of Faces.among(numbers, mask)) this.#stroke.removes ? selected.delete(face) : selected.add(face);
    this.#stroke = null;
    drawing.hidden = true;
    this.#select(selected);
  }

  #select(faces) {
    this.#selected = faces;
    this.#faces.mark(faces);
    const { element, renderer } = this.#page;
    const erased = this.#done.reduce((sum, faces) => sum + faces.size, 0);
    element('count').textContent = `${faces.size} selected, ${erased} erased`;
    element('delete').disabled = faces.size === 0;
    element('undo').disabled = element('save').disabled = element('list').disabled = this.#done.length === 0;
    element('redo').disabled = this.#undone.length === 0;
    renderer.restart();
  }

  #delete() {
    if (this.#selected.size === 0) return;
    this.#faces.hide(this.#selected, true);
    this.#done.push(this.#selected);
    this.#undone.length = 0;
    this.#select(new Set());
  }

  /** Takes the last deletion of one list to the other: undoes it, or does it again. */
  #repeat(from, to, on) {
    const faces = from.pop();
    if (!faces) return;
    this.#faces.hide(faces, on);
    to.push(faces);
    this.#select(on ? new Set() : faces);
  }

  /** A list that `trisplat bake --erase` repeats. */
  #list() {
    const list = JSON.stringify(this.#page.list(this.erased));
    download(new Blob([list], { type: 'application/json' }), `${this.#page.title}.erase.json`);
  }
}

/** The list of erased triangles of a file whose asset has these extras. */
export function eraseList({ source, placement }, triangles) {
  return { trisplat_erase: 1, source, placement, triangles };
}

export function download(blob, name) {
  const link = Object.assign(document.createElement('a'), { download: name, href: URL.createObjectURL(blob) });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
