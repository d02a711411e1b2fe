// The page: reads the scene while the browser reads the page, then draws whenever something moves.
import { Vector3 } from 'three';
import { Controls } from './controls.js';
import { download, Eraser, eraseList } from './eraser.js';
import { SceneFile } from './file.js';
import { withoutFaces } from './glb.js';
import { light } from './light.js';
import { Renderer } from './renderer.js';
import { ScaleBar } from './scale.js';
import { Sight } from './sight.js';
import { switches } from './switches.js';
import { copiedOption, sourceDirection, Up } from './up.js';
import { boundsOf, format, framed, initial, parse } from './view.js';

/** A neutral ground: neither dark nor bright scenes vanish in it. */
const BACKGROUND = '66686c';
/** Samples per pixel along each axis, once nothing moves. */
const GRID = 4;

/** The help disappears by itself after this time. */
const HELP_MS = 12_000;

const element = (id) => document.getElementById(id);
const requested = parse(location.hash);
const file = new SceneFile((share) => (element('bar').value = share));

/** Says what to do where the browser cannot draw, before a library says less. */
function demandWebGL() {
  if (document.createElement('canvas').getContext('webgl2')) return;
  throw new Error(
    'This browser does not draw in three dimensions: WebGL 2 is off or not there. Turn on hardware acceleration in its ' +
      'settings, update it or the graphics driver, or open this page in another browser.',
  );
}

/** Shows an error instead of a renderer. */
function fail(error) {
  element('what').textContent = error?.message ?? String(error);
  element('loading').hidden = false;
  element('loading').classList.add('failed');
  document.documentElement.dataset.state = 'failed';
  console.error(error);
}

/** Shows the scene; docs/page.md describes the returned object. */
async function open() {
  demandWebGL();
  const canvas = element('picture');
  const renderer = new Renderer(canvas, requested.ssaa ?? GRID, `#${requested.background ?? BACKGROUND}`);
  const { scene, meshes, sh, extras, sky } = await file.meshes();
  const viewpoint = extras.viewpoint ?? null;
  const bounds = boundsOf(meshes);
  light(scene, meshes);
  renderer.show(scene, sky);
  renderer.resize();
  renderer.camera.far = 1e3 * bounds.reach;
  const controls = new Controls(renderer.camera, canvas, bounds.radius, viewpoint, bounds.reach);
  const radius = viewpoint?.radius ?? bounds.radius;
  const subject = { center: viewpoint?.radius ? new Vector3(...viewpoint.target) : bounds.center, radius };
  const sight = new Sight(renderer, requested.near ?? 1e-3 * bounds.radius, subject);
  controls.seenDistance = () => sight.distance(controls.view, bounds.radius);

  const aspect = () => renderer.width / renderer.height;
  const fit = () => {
    controls.set(framed(viewpoint, bounds, aspect(), controls.view));
    sight.subject = subject;
    sight.settle(controls.view);
    renderer.restart();
  };
  let up = null;
  const start = () => {
    const first = initial(viewpoint, bounds, aspect());
    controls.set({ ...first, up: up ?? first.up });
    sight.subject = subject;
    sight.hold();
    renderer.restart();
  };
  const go = (words) => {
    const view = { ...controls.view };
    for (const word of ['eye', 'target', 'up']) if (words[word]) view[word] = words[word].clone();
    if (words.fov || words.pinhole) Object.assign(view, { fov: words.fov ?? view.fov, pinhole: words.pinhole });
    controls.set(view);
    sight.hold(words.near ?? undefined);
    renderer.restart();
  };
  const focus = (event) => {
    const center = controls.focus(event, meshes);
    if (center) sight.subject = { center, radius: 0.01 * bounds.radius };
  };
  start();
  go(requested);
  addEventListener('hashchange', () => go(parse(location.hash)));
  const view = () => format({ ...controls.view, near: sight.cut });
  bindInput({ canvas, controls, fit, start, focus, view });
  bindHint(canvas, controls);
  const title = document.title;
  const turn = (direction) => {
    up = direction;
    controls.set({ ...controls.view, up });
    renderer.restart();
    return `${copiedOption(sourceDirection(direction, extras.placement))} (copied): give it to trisplat bake or make.`;
  };
  new Up({ element, canvas, controls, meshes, turn });
  const save = ({ hidden }) => {
    const erased = hidden.map(({ mesh, flags }) => ({ ...file.numbersOf(mesh), flags }));
    download(withoutFaces(file.glb, erased), `${title}.erased.glb`);
  };
  const list = (triangles) => eraseList(extras, triangles);
  new Eraser({ element, canvas, renderer, scene, meshes, controls, title, save, list });
  switches({ element, renderer, scene, meshes, sh, sky });
  element('loading').hidden = true;
  run(renderer, controls, sight, new ScaleBar(element('scale'), extras.placement));
  return { view, show: (fragment) => go(parse(fragment)) };
}

/** Draws while something moves or samples are missing. */
function run(renderer, controls, sight, scale) {
  let last = performance.now();
  const frame = (now) => {
    const seconds = Math.min(0.1, (now - last) / 1000);
    last = now;
    const moved = controls.step(seconds);
    const cut = sight.step(seconds, controls.view, moved, controls.flying || controls.walking);
    if (renderer.resize() || moved || cut) renderer.restart();
    if (renderer.unfinished) {
      renderer.draw(controls.view);
      scale.show(controls.view, renderer.camera);
    }
    document.documentElement.dataset.state = moved || cut || renderer.unfinished ? 'refining' : 'ready';
    requestAnimationFrame(frame);
  };
  frame(last);
}

/** Says why a drag pulls back, until the next one, and offers to look from anywhere. */
function bindHint(canvas, controls) {
  controls.onLimit = () => (element('limit').hidden = false);
  canvas.addEventListener('pointerdown', () => (element('limit').hidden = true));
  element('anywhere').addEventListener('click', () => {
    controls.lookAnywhere();
    element('limit').hidden = true;
  });
}

/** Buttons, and the keys that do the same. */
function bindInput({ canvas, controls, fit, start, focus, view }) {
  const hide = setTimeout(() => help(false), HELP_MS);
  const help = (on) => {
    clearTimeout(hide);
    element('help').hidden = !on;
    element('ask').setAttribute('aria-expanded', on);
  };
  const fly = () => {
    controls.fly(!controls.flying);
    element('fly').setAttribute('aria-pressed', controls.flying);
  };
  const link = async () => {
    history.replaceState(null, '', view());
    await navigator.clipboard?.writeText(location.href).catch(() => {});
    element('link').textContent = 'copied';
    setTimeout(() => (element('link').textContent = 'link'), 1500);
  };
  const full = () =>
    document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen?.();
  const actions = {
    start, fit, fly, link, full,
    // The first question is answered in full, even while the brief help is there.
    ask: () => {
      const { classList, hidden } = element('help');
      help(hidden || classList.contains('brief'));
      classList.remove('brief');
    },
  };
  element('more').addEventListener('click', ({ currentTarget: more }) => {
    more.setAttribute('aria-expanded', more.parentElement.classList.toggle('open'));
  });
  for (const [id, act] of Object.entries(actions)) element(id).addEventListener('click', act);
  const keys = { KeyF: fit, Home: start, KeyR: start, KeyV: fly, KeyL: link, Enter: full, KeyH: actions.ask };
  addEventListener('keydown', (event) => {
    const plain = !(event.ctrlKey || event.metaKey || event.altKey || event.repeat);
    const pressed = event.code === 'Enter' && event.target.tagName === 'BUTTON';
    if (plain && !pressed) keys[event.code]?.();
  });
  canvas.addEventListener('pointerdown', () => help(false));
  canvas.addEventListener('dblclick', focus);
  if (requested.bare) document.body.classList.add('bare');
}

window.trisplat = {
  block: () => {
    const data = document.currentScript.previousElementSibling;
    try {
      file.block(data.textContent);
    } catch (error) {
      fail(error);
    }
    data.remove();
  },
  ready: new Promise((resolve) => addEventListener('DOMContentLoaded', resolve)).then(open),
};
window.trisplat.ready.then((page) => Object.assign(window.trisplat, page), fail);
