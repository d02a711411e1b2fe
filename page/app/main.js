// The page: open a scene, look at it, bake it, compare, take the files.
import { Crop } from './crop.js';
import { missing, run } from './program.js';
import { moved, Shown } from './scene.js';
import { Tools } from './tools.js';

const SCENES = /\.(pt|pth|ply|splat|spz|sog|glb|gltf|obj|off|html?)(\.gz)?$/i;
const MOST_BYTES = 2 ** 30;
/** Most pixels of a soft picture, because one thread draws it. */
const SOFT_PIXELS = 400_000;
const LOOK = 'look.glb';
const LIST = 'erased.json';

const at = (id) => document.getElementById(id);
const state = (name) => (document.documentElement.dataset.state = name);

let shown = null;
let crop = null;
let tools = null;
/** The open scene: its files by name, the main one, its properties, and triangles of its bake that are erased, in the frame of the picture. */
let scene = null;
/** Ends the running work. */
let work = null;
/** Ends the drawing of a soft picture. */
let drawing = null;
/** True while the picture is at rest. */
let resting = false;
/** True while the eraser is open. */
let erasing = false;

function say(text) {
  at('what').textContent = text;
}

/** Shows an error in the words of the program. */
function complain(text) {
  at('message').textContent = text;
  at('message').hidden = !text;
}

/** Does `job` with a bar and Cancel; returns nothing when it was cancelled or failed, and shows this. */
async function working(what, job) {
  work?.abort();
  const mine = (work = new AbortController());
  complain('');
  say(what);
  at('working').hidden = false;
  at('bar').removeAttribute('value');
  at('bake').disabled = true;
  state('working');
  const onProgress = ({ stage, fraction }) => {
    if (stage) say(`${what}: ${stage}`);
    at('bar').value = fraction;
  };
  try {
    return await job({ signal: mine.signal, onProgress });
  } catch (error) {
    if (mine === work) say(mine.signal.aborted ? 'cancelled' : '');
    if (!mine.signal.aborted) complain(error.message);
    return null;
  } finally {
    if (mine === work) {
      work = null;
      at('working').hidden = true;
      at('bake').disabled = false;
      state(at('message').hidden ? 'ready' : 'failed');
      // It waited for the work.
      if (at('soft').hidden) soften();
    }
  }
}

/** Opens the scene among `files`. */
async function open(files) {
  const list = [...files];
  const main = list.find((file) => SCENES.test(file.name)) ?? list[0];
  if (!main) return;
  const bytes = list.reduce((sum, file) => sum + file.size, 0);
  if (bytes > MOST_BYTES) {
    complain(`${main.name} has ${size(bytes)}, and this page reads up to ${size(MOST_BYTES)}: use the program`);
    state('failed');
    return;
  }
  const opened = { files: Object.fromEntries(list.map((file) => [file.name, file])), name: main.name };
  chooseUp('auto');
  const look = await working(`reading ${main.name}`, async (how) => {
    const look = await lookAt(opened, {}, how);
    scene = Object.assign(opened, { toView: look.to_view, soft: look.soft, info: look.info, up: 'auto', erased: [] });
    forget();
    await shown.show('before', look.files[LOOK]);
    return look;
  });
  if (!look) return;
  crop.reset(shown.bounds(scene.toView));
  at('crop').checked = false;
  cropped();
  at('options').hidden = false;
  at('place').hidden = true;
  document.body.classList.add('opened');
  fold(true);
  at('has-soft').hidden = at('may-harden').hidden = !look.soft;
  const { splats, triangles } = look.info;
  const content = splats ? `${splats.toLocaleString('en')} splats` : `${triangles.toLocaleString('en')} triangles, ${look.soft ? 'soft' : 'solid'}`;
  sayErased();
  choose(splats ? 'soft' : 'solid');
  say(`${scene.name}: ${content}, ${size(bytes)}`);
}

/** Shows a scene. */
function lookAt({ files, name }, options, how) {
  return run({ command: 'look', input: name, output: LOOK, options }, files, how);
}

/** Removes the bake of an earlier scene. */
function forget() {
  tools.forget();
  shown.remove('after');
  at('compare').hidden = at('result').hidden = true;
  cut();
  for (const link of at('files').querySelectorAll('a')) URL.revokeObjectURL(link.href);
}

/** The chosen options of the bake, and the list of what it erases. */
function options(erase) {
  const asked = { target: at('target').value, up: at('axis').value };
  if (at('triangles').value) asked.max_triangles = Number(at('triangles').value);
  if (at('no-backdrop').checked) asked.backdrop = 'off';
  if (at('crop').checked) asked.crop = [crop.region];
  if (erase) asked.erase = { erase };
  return asked;
}

async function bake() {
  const ending = at('format').value;
  const output = `${scene.name.replace(/(\.\w+)+$/, '')}${ending}`;
  const megabytes = Number(at('megabytes').value);
  const erased = at('without').checked ? tools.erased(scene.erased) : [];
  const list = erased.length > 0 ? { [LIST]: new TextEncoder().encode(JSON.stringify(tools.list(scene.erased))) } : {};
  const job = {
    command: 'bake', inputs: [scene.name], output, options: options(Object.keys(list)[0]), harden: scene.soft && at('harden').checked,
    max_bytes: megabytes > 0 ? Math.round(megabytes * 1e6) : null,
  };
  const began = performance.now();
  const baked = await working('baking', async (how) => {
    const { files, report } = await run(job, { ...scene.files, ...list }, how);
    // The slider compares the content of files of any format.
    const look = await lookAt({ files: { ...files }, name: output }, { up: 'y' }, { signal: how.signal });
    return { files, report, look };
  });
  if (!baked) return;
  forget();
  scene.erased = erased;
  sayErased();
  await shown.show('after', baked.look.files[LOOK]);
  const seconds = (performance.now() - began) / 1000;
  at('compare').hidden = false;
  cut();
  present(baked, output, seconds);
}

/** Offers the files, and shows the report. */
function present({ files, report, look }, output, seconds) {
  const link = ([name, bytes]) => {
    const item = document.createElement('li');
    const type = name.endsWith('.html') ? 'text/html' : 'application/octet-stream';
    const a = Object.assign(document.createElement('a'), { download: name, href: URL.createObjectURL(new Blob([bytes], { type })) });
    a.textContent = `Download ${name} (${size(bytes.length)})`;
    item.append(a);
    return item;
  };
  // The requested file first, then those beside it.
  const order = Object.entries(files).sort(([a], [b]) => (b === output) - (a === output));
  at('files').replaceChildren(...order.map(link));
  const note = (text) => Object.assign(document.createElement('li'), { textContent: text });
  at('warnings').replaceChildren(...report.warnings.map(note));
  at('summary').textContent = `${look.info.triangles.toLocaleString('en')} triangles, ${seconds.toFixed(1)} s`;
  at('result').hidden = false;
  say('baked');
  fold(true);
  at('result').scrollIntoView({ block: 'nearest' });
}

/** On a phone: hides the options, so that the picture has the room. */
function fold(on) {
  document.body.classList.toggle('folded', on);
  at('fold').setAttribute('aria-expanded', !on);
}

function size(bytes) {
  return bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

function look() {
  return document.querySelector('input[name=look]:checked').value;
}

function choose(value) {
  document.querySelector(`input[name=look][value=${value}]`).checked = true;
  changedLook();
}

function changedLook() {
  shown.wires(look() === 'wires');
}

/** The picture came to rest, or moves again. */
function rested(atRest) {
  resting = atRest;
  soften();
}

/** In soft mode the program draws the scene at rest; a moving scene is solid, and so is one in a box, whose edges it would hide. */
async function soften() {
  drawing?.abort();
  drawing = null;
  at('soft').hidden = true;
  const wanted = resting && look() === 'soft' && scene?.soft && !work && !erasing && !at('crop').checked;
  const picture = (name) => (document.documentElement.dataset.picture = name);
  picture(!resting ? 'moving' : wanted ? 'drawing' : 'resting');
  if (!wanted) return;
  const mine = (drawing = new AbortController());
  try {
    const { files } = await run(softJob(), scene.files, { signal: mine.signal });
    if (mine !== drawing) return;
    const image = at('soft');
    URL.revokeObjectURL(image.src);
    image.src = URL.createObjectURL(new Blob([files['soft.png']], { type: 'image/png' }));
    await image.decode();
    if (mine === drawing) image.hidden = false;
  } catch (error) {
    if (!mine.signal.aborted) complain(error.message);
  }
  if (mine === drawing) picture('resting');
}

/** Draws the open scene soft, from where it is seen. */
function softJob() {
  const [width, height] = shown.size;
  const shrink = Math.min(1, Math.sqrt(SOFT_PIXELS / (width * height)));
  return {
    command: 'picture', input: scene.name, output: 'soft.png', view: shown.view, options: { up: at('axis').value },
    size: [width, height].map((px) => Math.max(1, Math.round(px * shrink))), background: [0x17, 0x18, 0x1a].map((code) => code / 255),
  };
}

/** The soft picture is the one before, while before and after are compared. */
function cut() {
  const after = at('compare').hidden ? 0 : 1 - Number(at('split').value);
  at('soft').style.clipPath = `inset(0 ${100 * after}% 0 0)`;
}

/** The slider between before and after. */
function split() {
  shown.split = Number(at('split').value);
  cut();
}

/** The box of the crop, from its handles. */
function cropped() {
  const on = at('crop').checked;
  crop.hidden = !on;
  shown.box(...(on ? [...crop.corners, scene.toView] : []));
}

/** Turns the scene by the chosen up axis. */
async function turn() {
  const up = at('axis').value;
  const turned = await working('turning', async (how) => {
    const look = await lookAt(scene, { up }, how);
    scene.erased = moved(tools.erased(scene.erased), scene.toView, look.to_view);
    sayErased();
    forget();
    Object.assign(scene, { toView: look.to_view, up });
    await shown.show('before', look.files[LOOK]);
    cropped();
    say(`turned: ${up === 'auto' ? 'automatic' : up} is up`);
    return true;
  });
  // The scene stands as before, unless another turn took the place of this one.
  if (!turned && !work) chooseUp(scene.up);
  return turned;
}

/** Chooses an up direction: an axis, or one that was clicked. */
function chooseUp(up) {
  const axis = at('axis');
  at('clicked').hidden = true;
  if (![...axis.options].some(({ value }) => value === up)) Object.assign(at('clicked'), { value: up, hidden: false });
  axis.value = up;
}

/** Turns the scene to a direction that was clicked, and bakes it again if it was baked. */
async function turnTo(up) {
  const isBaked = !at('result').hidden;
  chooseUp(up);
  if ((await turn()) && isBaked) await bake();
}

/** While the eraser is open, all of the picture is the bake. */
function erase(on) {
  erasing = on;
  at('compare').hidden = on || at('result').hidden;
  shown.split = on ? 0 : Number(at('split').value);
  cut();
  soften();
}

/** Offers to bake with what was erased. */
function sayErased() {
  const count = scene.erased.length;
  at('has-erased').hidden = count === 0;
  at('erased').textContent = count === 1 ? '1 erased triangle' : `${count.toLocaleString('en')} erased triangles`;
  at('without').checked = true;
}

function bind() {
  at('file').addEventListener('change', (event) => open(event.target.files));
  at('cancel').addEventListener('click', () => work?.abort(new Error('cancelled')));
  at('options').addEventListener('submit', (event) => (event.preventDefault(), bake()));
  at('fold').addEventListener('click', () => fold(!document.body.classList.contains('folded')));
  at('looks').addEventListener('change', changedLook);
  at('crop').addEventListener('change', cropped);
  at('axis').addEventListener('change', turn);
  at('split').addEventListener('input', split);
  // Keys typed here do not move the camera.
  for (const id of ['panel', 'compare']) at(id).addEventListener('keydown', (event) => event.stopPropagation());
  const over = (on) => (event) => {
    event.preventDefault();
    document.body.classList.toggle('dropping', on);
  };
  addEventListener('dragover', over(true));
  addEventListener('dragleave', over(false));
  addEventListener('drop', (event) => {
    over(false)(event);
    open(event.dataTransfer.files);
  });
}

function begin() {
  const reason = missing();
  if (reason) {
    complain(reason);
    at('file').disabled = true;
    state('failed');
    return;
  }
  shown = new Shown(at('picture'), rested);
  crop = new Crop(at('box'), cropped);
  tools = new Tools(shown, { element: at, scene: () => scene, turn: turnTo, bake, erasing: erase });
  bind();
  state('ready');
}

begin();
