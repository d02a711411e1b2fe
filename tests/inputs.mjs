// What a person does in a page, and what is seen of it. An input is one of
//   { show: FRAGMENT }  { drag: [x, y, dx, dy] }  { pinch: [x, y, from, to] }  { double: [x, y] }  { press: KEY, ms }  { click: ID }
//   { wheel: dy, at: [x, y], notches }  { resize: [w, h] }  { hide: true }: the tab, and back  { lose: true }: the graphics, and back

/** Does one input. */
export async function act(page, client, { show, drag, pinch, double, press, click, wheel, at, notches = 1, resize, hide, lose, ms }) {
  const touch = (type, points) =>
    client.send("Input.dispatchTouchEvent", { type, touchPoints: points.map(([x, y], id) => ({ x, y, id })) });
  if (show !== undefined) await page.evaluate((f) => window.trisplat.show(f), show);
  if (drag) {
    const [x, y, dx, dy] = drag;
    await page.mouse.move(x, y);
    await page.mouse.down();
    await page.mouse.move(x + dx, y + dy, { steps: 5 });
    await page.mouse.up();
  }
  if (pinch) {
    const [x, y, from, to] = pinch;
    const fingers = (apart) => [[x - apart / 2, y], [x + apart / 2, y]];
    await touch("touchStart", fingers(from));
    for (let i = 1; i <= 5; i++) await touch("touchMove", fingers(from + ((to - from) * i) / 5));
    await touch("touchEnd", []);
  }
  if (double) await page.mouse.dblclick(...double);
  if (press) {
    await page.keyboard.down(press);
    await page.waitForTimeout(ms ?? 0);
    await page.keyboard.up(press);
  }
  if (click) await page.click(`#${click}`);
  if (at) await page.mouse.move(...at);
  for (let notch = 0; wheel && notch < notches; notch++) await page.mouse.wheel(0, wheel);
  if (resize) await page.setViewportSize({ width: resize[0], height: resize[1] });
  if (hide) await page.evaluate(hidden);
  if (lose) await page.evaluate(lost);
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

/** Saves what the canvas shows, without what lies over it. */
export async function picture(page, path) {
  const fade = (opacity) =>
    page.evaluate((opacity) => {
      for (const one of document.body.children) if (one.id !== "picture") one.style.opacity = opacity;
    }, opacity);
  await fade(0);
  // What was drawn last is shown a frame later; before that, the picture is one of those on the way to it.
  await heard(page);
  await page.locator("#picture").screenshot({ path });
  await fade("");
}

/**
 * Does an input between two pictures, NAME-before.png and NAME-after.png, without any other event, and saves a third, NAME-again.png, that is
 * drawn anew because the window was resized for a moment. `rest()` waits for the picture to be at rest.
 */
export async function seen(page, client, input, name, rest) {
  await picture(page, `${name}-before.png`);
  await act(page, client, input);
  await heard(page);
  await rest();
  await picture(page, `${name}-after.png`);
  const { width, height } = page.viewportSize();
  for (const more of [8, 0]) {
    await page.setViewportSize({ width: width + more, height });
    await heard(page);
    await rest();
  }
  await picture(page, `${name}-again.png`);
}
