// The page: reads the scene while the browser reads the page, then draws whenever something moves.
import { Move } from './move.js';
import { Picture } from './picture.js';
import { SceneFile } from './file.js';
import { boundsOf, first, format, parse, whole } from './view.js';

const BACKGROUND = '17181a';
/** Samples along each axis of a pixel, at rest. */
const GRID = 4;

/** The help goes away by itself after so long. */
const HELP_MS = 12_000;

const element = (id) => document.getElementById(id);
const asked = parse(location.hash);
const file = new SceneFile((share) => (element('bar').value = share));

/** What went wrong instead of a picture. */
function fail(error) {
  element('what').textContent = error?.message ?? String(error);
  element('loading').hidden = false;
  element('loading').classList.add('failed');
  document.documentElement.dataset.state = 'failed';
  console.error(error);
}

/** Shows the scene; what the returned object can do is in docs/formats.md. */
async function open() {
  const canvas = element('picture');
  const picture = new Picture(canvas, asked.ssaa ?? GRID, `#${asked.background ?? BACKGROUND}`);
  const { scene, meshes, viewpoint } = await file.meshes();
  const bounds = boundsOf(meshes);
  picture.show(scene);
  picture.resize();
  picture.camera.near = asked.near ?? 1e-3 * bounds.radius;
  picture.camera.far = 1e3 * bounds.reach;
  const move = new Move(picture.camera, canvas, bounds.radius);

  const aspect = () => picture.width / picture.height;
  const fit = () => (move.set(whole(viewpoint, bounds, aspect())), picture.restart());
  const start = () => (move.set(first(viewpoint, bounds, aspect())), picture.restart());
  const go = (words) => {
    const view = { ...move.view };
    for (const word of ['eye', 'target', 'up']) if (words[word]) view[word] = words[word].clone();
    if (words.fov || words.pinhole) Object.assign(view, { fov: words.fov ?? view.fov, pinhole: words.pinhole });
    move.set(view);
    picture.restart();
  };
  start();
  go(asked);
  addEventListener('hashchange', () => go(parse(location.hash)));
  listen({ canvas, picture, move, meshes, fit, start });
  element('loading').hidden = true;
  run(picture, move);
  return { view: () => format(move.view), show: (fragment) => go(parse(fragment)) };
}

/** Draws for as long as something moves or gets better. */
function run(picture, move) {
  let last = performance.now();
  const frame = (now) => {
    const moved = move.step(Math.min(0.1, (now - last) / 1000));
    last = now;
    if (picture.resize() || moved) picture.restart();
    if (picture.unfinished) picture.draw(move.view);
    document.documentElement.dataset.state = picture.unfinished ? 'refining' : 'ready';
    requestAnimationFrame(frame);
  };
  frame(last);
}

/** Buttons, and the keys that do the same. */
function listen({ canvas, picture, move, meshes, fit, start }) {
  const hide = setTimeout(() => help(false), HELP_MS);
  const help = (on) => {
    clearTimeout(hide);
    element('help').hidden = !on;
    element('ask').setAttribute('aria-expanded', on);
  };
  const fly = () => {
    move.fly(!move.flying);
    element('fly').setAttribute('aria-pressed', move.flying);
  };
  const link = async () => {
    history.replaceState(null, '', format(move.view));
    await navigator.clipboard?.writeText(location.href).catch(() => {});
    element('link').textContent = 'copied';
    setTimeout(() => (element('link').textContent = 'link'), 1500);
  };
  const full = () =>
    document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen?.();
  const does = {
    start, fit, fly, link, full,
    ask: () => help(element('help').hidden),
  };
  for (const [id, act] of Object.entries(does)) element(id).addEventListener('click', act);
  const keys = { KeyF: fit, Home: start, KeyR: start, KeyV: fly, KeyL: link, Enter: full, KeyH: does.ask };
  addEventListener('keydown', (event) => {
    const plain = !(event.ctrlKey || event.metaKey || event.altKey || event.repeat);
    const pressed = event.code === 'Enter' && event.target.tagName === 'BUTTON';
    if (plain && !pressed) keys[event.code]?.();
  });
  canvas.addEventListener('pointerdown', () => help(false));
  canvas.addEventListener('dblclick', (event) => move.focus(event, meshes));
  if (asked.bare) document.body.classList.add('bare');
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
