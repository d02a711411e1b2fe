// What a person does in a page, and what is seen of it. An input is one of
//   { drag: [x, y, dx, dy], button }  { single: [x, y] }  { double: [x, y] }  { stroke: [[x, y], ...] }  { wheel: dy, at: [x, y], notches }  { press: KEY, ms }: the mouse and keys
//   { finger: [x, y, dx, dy] }  { fingers: [x, y, dx, dy] }: two beside each other  { pinch: [x, y, from, to] }  { tap: [x, y] }: twice
//   { click: ID }  { download: ID, to: FILE }  { check: SELECTOR, on }  { select: [ID, VALUE] }  { range: ID, to }: a share of its length: the parts of the page
//   { show: FRAGMENT }  { resize: [w, h] }  { hide: true }: the tab, and back  { lose: true }: the graphics, and back
import { copyFile } from "node:fs/promises";

/** Does one input. */
export async function act(page, client, input) {
  const { show, press, ms, click, check, on = true, select, range, to, resize, hide, lose, download } = input;
  if (show !== undefined) await page.evaluate((f) => window.trisplat.show(f), show);
  await point(page, input);
  await touch(client, input);
  if (press?.includes("+")) await page.keyboard.press(press);
  else if (press) {
    await page.keyboard.down(press);
    await page.waitForTimeout(ms ?? 0);
    await page.keyboard.up(press);
  }
  if (download) {
    const [saved] = await Promise.all([page.waitForEvent("download"), page.click(`#${download}`)]);
    await saved.saveAs(to);
  }
  if (click) await page.click(`#${click}`);
  if (check) await page.setChecked(check, on);
  if (select) await page.selectOption(`#${select[0]}`, select[1]);
  if (range) await slide(page, range, to);
  if (resize) await page.setViewportSize({ width: resize[0], height: resize[1] });
  if (hide) await page.evaluate(hidden);
  if (lose) await page.evaluate(lost);
}

/** What the mouse does. */
async function point({ mouse }, { drag, button = "left", single, double, stroke, wheel, at, notches = 1 }) {
  if (drag) {
    const [x, y, dx, dy] = drag;
    await mouse.move(x, y);
    await mouse.down({ button });
    await mouse.move(x + dx, y + dy, { steps: 5 });
    await mouse.up({ button });
  }
  if (stroke) {
    await mouse.move(...stroke[0]);
    await mouse.down();
    for (const [x, y] of stroke.slice(1)) await mouse.move(x, y, { steps: 3 });
    await mouse.up();
  }
  if (single) await mouse.click(...single);
  if (double) await mouse.dblclick(...double);
  if (at) await mouse.move(...at);
  for (let notch = 0; wheel && notch < notches; notch++) await mouse.wheel(0, wheel);
}

/** What fingers do. */
async function touch(client, { finger, fingers, pinch, tap }) {
  const send = (type, points) =>
    client.send("Input.dispatchTouchEvent", { type, touchPoints: points.map(([x, y], id) => ({ x, y, id })) });
  /** The fingers go to where `at` says that they are at each share of the way. */
  const move = async (at) => {
    await send("touchStart", at(0));
    for (let i = 1; i <= 5; i++) await send("touchMove", at(i / 5));
    await send("touchEnd", []);
  };
  const pair = (x, y, apart) => [[x - apart / 2, y], [x + apart / 2, y]];
  const shifted = ([x, y, dx, dy], share) => [x + share * dx, y + share * dy];
  if (finger) await move((share) => [shifted(finger, share)]);
  if (fingers) await move((share) => pair(...shifted(fingers, share), 80));
  if (pinch) await move((share) => pair(pinch[0], pinch[1], pinch[2] + share * (pinch[3] - pinch[2])));
  for (let i = 0; tap && i < 2; i++) {
    await send("touchStart", [tap]);
    await send("touchEnd", []);
  }
}

/** Puts the handle of a slider to a share of its length, as a click there does. */
async function slide(page, id, to) {
  const slider = page.locator(`#${id}`);
  const { width, height } = await slider.boundingBox();
  await slider.click({ position: { x: Math.min(width - 1, Math.max(1, to * width)), y: height / 2 } });
}

/**
 * In the page: hides it and shows it again, as a browser does that drops what a hidden tab has drawn. Headless Chromium hides no tab, so the
 * page is told what it would be told.
 */
async function hidden() {
  const gl = document.getElementById("picture").getContext("webgl2");
  const [color, target] = [gl.COLOR_CLEAR_VALUE, gl.FRAMEBUFFER_BINDING].map((name) => gl.getParameter(name));
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.clearColor(1, 0, 1, 1);
  gl.clear(gl.COLOR_BUFFER_BIT);
  gl.clearColor(...color);
  gl.bindFramebuffer(gl.FRAMEBUFFER, target);
  for (const value of ["hidden", "visible"]) {
    await new Promise(requestAnimationFrame);
    Object.defineProperty(document, "visibilityState", { value, configurable: true });
    document.dispatchEvent(new Event("visibilitychange"));
  }
}

/** In the page: takes the graphics away, as a driver that begins anew does. */
async function lost() {
  const canvas = document.getElementById("picture");
  const graphics = canvas.getContext("webgl2").getExtension("WEBGL_lose_context");
  const told = (name) => new Promise((done) => canvas.addEventListener(name, done, { once: true }));
  const gone = told("webglcontextlost");
  graphics.loseContext();
  await gone;
  // Only after the event has been handled may they come back.
  await new Promise((handled) => setTimeout(handled, 50));
  const back = told("webglcontextrestored");
  graphics.restoreContext();
  await back;
}

/** Waits for two frames: what was done has been heard, and the picture has begun again. */
export function heard(page) {
  return page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
}

/** Saves what the picture shows, without what lies over it. */
export async function picture(page, path) {
  const fade = (opacity) =>
    page.evaluate((opacity) => {
      for (const one of document.body.children) if (!["picture", "soft"].includes(one.id)) one.style.opacity = opacity;
      const { left, top, right, bottom } = document.getElementById("picture").getBoundingClientRect();
      const [x, y] = [left, top].map(Math.floor);
      return { x, y, width: Math.ceil(right) - x, height: Math.ceil(bottom) - y };
    }, opacity);
  const clip = await fade(0);
  // What was drawn last is shown a frame later; before that, the picture is one of those on the way to it.
  await heard(page);
  // Of a locator it would take twice as long, for the frames in which it watches whether the element moves.
  await page.screenshot({ path, clip });
  await fade("");
}

/**
 * Does an input between two pictures, NAME-before.png and NAME-after.png, without any other event, and saves a third, NAME-again.png, that is
 * drawn anew because the window was resized for a moment. `rest()` waits until the input has been heard and the picture is at rest.
 * Returns the third, which is also the picture before the input that follows: given as `last`, it is not taken twice.
 */
export async function seen(page, client, input, name, rest, last) {
  if (last) await copyFile(last, `${name}-before.png`);
  else await picture(page, `${name}-before.png`);
  await act(page, client, input);
  await rest();
  await picture(page, `${name}-after.png`);
  const { width, height } = page.viewportSize();
  await page.setViewportSize({ width: width + 8, height });
  // The canvas loses what it shows once the page has heard of its size; the picture of that size need not be finished.
  await heard(page);
  await page.setViewportSize({ width, height });
  await rest();
  await picture(page, `${name}-again.png`);
  return `${name}-again.png`;
}
