// Uses the page of the program as a person does: node app.mjs JUDGES CHROMIUM PAGE < VISITS
//
// VISITS is a JSON list of { files, drop, each, set, inputs, bake, folder, cancel, after, again, webgl, isolated, touch, screenshot, size }:
// files to open, by a click where the picture will be or dropped there; files that cannot be read, opened one after the other; values of fields
// by their ids; inputs of inputs.mjs, each with { seen: NAME } for pictures of before and after; whether to bake, and where downloads go; an
// input during the bake, which is then cancelled; inputs after it; where downloads go after those; false for a browser without WebGL 2; whether
// a server isolates it; whether it has a touch screen.
// Prints one JSON line per visit: { errors, state, message, what, axis, floor, count, erased, downloads, again, warnings, pause, paint, start,
// opened, baked, end }; pause: the longest between two frames while it worked, ms; paint: when the page was first seen, ms; the last four: where
// things were then (layout). With `each` it holds { each }: { errors, state, message, ... } of each of them.
import { readFile } from "node:fs/promises";
import { createServer } from "node:http";
import { basename, join, resolve } from "node:path";
import { text } from "node:stream/consumers";
import { pathToFileURL } from "node:url";
import { launch, openPage } from "./chromium.mjs";
import { act, heard, seen } from "./inputs.mjs";

const [judges, executablePath, app] = process.argv.slice(2);
const browser = await launch(judges, executablePath);
for (const visit of JSON.parse(await text(process.stdin))) console.log(JSON.stringify(await see(visit)));
await browser.close();

/** The page from a server whose headers isolate it, so that its threads may share memory. */
async function served() {
  const headers = {
    "content-type": "text/html", "cross-origin-opener-policy": "same-origin", "cross-origin-embedder-policy": "require-corp",
  };
  const text = await readFile(app);
  const server = createServer((_, answer) => answer.writeHead(200, headers).end(text));
  await new Promise((listening) => server.listen(0, "127.0.0.1", listening));
  return server;
}

/** Chooses files after a click near a corner of where the picture will be. */
async function choose(page, files) {
  const chooser = page.waitForEvent("filechooser", { timeout: 20_000 });
  await page.click("#place", { position: { x: 20, y: 20 }, timeout: 20_000 });
  await (await chooser).setFiles(files);
}

/**
 * In the page: the boxes of the picture, the panel and the button Bake, and the ids of what is seen in the middle of the picture, near a corner
 * of it, and in the middle of the button and of the list of downloads.
 */
function layout() {
  const [picture, panel, button, download] = ["#picture", "#panel", "#bake", "#files"].map((one) =>
    document.querySelector(one).getBoundingClientRect().toJSON(),
  );
  const at = (x, y) => document.elementFromPoint(x, y)?.closest("[id]")?.id ?? null;
  const inside = ({ left, top, width, height }) => at(left + width / 2, top + height / 2);
  return {
    picture, panel, button, middle: inside(picture), corner: at(picture.right - 50, picture.top + 50), onButton: inside(button),
    onDownload: inside(download),
  };
}

/** Drops files into the middle of the empty picture. */
async function dropInto(page, files) {
  const all = await Promise.all(files.map(async (path) => ({ name: basename(path), data: (await readFile(path)).toString("base64") })));
  await page.evaluate(async (all) => {
    const dataTransfer = new DataTransfer();
    for (const { name, data } of all) dataTransfer.items.add(new File([Uint8Array.from(atob(data), (c) => c.charCodeAt(0))], name));
    const { left, top, width, height } = document.getElementById("picture").getBoundingClientRect();
    const [clientX, clientY] = [left + width / 2, top + height / 2];
    const event = { dataTransfer, clientX, clientY, bubbles: true, cancelable: true };
    const at = document.elementFromPoint(clientX, clientY);
    // A page that does not take the first is not asked to take the second.
    if (!at.dispatchEvent(new DragEvent("dragover", event))) at.dispatchEvent(new DragEvent("drop", event));
  }, all);
}

/** Goes to the page and counts the pauses between its frames. */
async function begin({ webgl = true, isolated, touch = false, size = [900, 600] }) {
  const { page, errors } = await openPage(browser, ...size, touch);
  const server = isolated ? await served() : null;
  const address = server ? `http://127.0.0.1:${server.address().port}/` : pathToFileURL(resolve(app)).href;
  page.on("request", (r) => /^(http|ws)/.test(r.url()) && r.url() !== address && errors.push(`asks the network for ${r.url()}`));
  if (!webgl) await page.addInitScript(() => (HTMLCanvasElement.prototype.getContext = () => null));
  await page.goto(address);
  await idle(page, "starting");
  await page.evaluate(() => {
    window.pause = 0;
    let last = performance.now();
    const tick = (now) => {
      window.pause = Math.max(window.pause, now - last);
      last = now;
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  });
  return { page, errors, server };
}

/** Waits until the page does nothing of this name, and has started. */
function idle(page, name = "working") {
  const other = (name) => !["starting", name].includes(document.documentElement.dataset.state);
  return page.waitForFunction(other, name, { timeout: 300_000 });
}

/** Waits until what has been chosen is seen. */
async function settled(page) {
  // What has just been shown is drawn from the next frame on.
  for (let i = 0; i < 2; i++) {
    await idle(page);
    await still(page);
  }
}

/** Waits until the picture is at rest. */
async function still(page) {
  await heard(page);
  await page.waitForFunction(() => document.documentElement.dataset.picture === "resting", null, { timeout: 120_000 });
}

/** Opens files, and waits until the scene is there or the page says why not. */
async function open(page, { files, drop }) {
  if (files) await choose(page, files);
  if (drop) await dropInto(page, drop);
  if (!files && !drop) return;
  const answered = () => ![...document.querySelectorAll("#options, #message")].every(({ hidden }) => hidden);
  await page.waitForFunction(answered, null, { timeout: 300_000 });
  await idle(page);
}

/** Opens files one after the other, and returns what the page says of each. */
async function openEach(page, errors, files) {
  const all = [];
  for (const file of files) {
    // What was said of the last one is no answer.
    await page.evaluate(() => (document.getElementById("message").hidden = true));
    await open(page, { files: [file] });
    all.push({ errors: errors.splice(0), ...(await page.evaluate(said)) });
  }
  return all;
}

async function fill(page, values) {
  for (const [id, value] of Object.entries(values)) {
    if (typeof value === "boolean") await page.setChecked(`#${id}`, value);
    else if (await page.evaluate((id) => document.getElementById(id).tagName === "SELECT", id)) await page.selectOption(`#${id}`, value);
    else await page.fill(`#${id}`, value);
    await idle(page);
  }
}

/** Does inputs of inputs.mjs. */
async function perform(page, client, inputs) {
  if (inputs.length > 0) await settled(page);
  let last = null;
  for (const input of inputs) {
    if (input.seen) last = await seen(page, client, input, input.seen, () => settled(page), last);
    else {
      last = null;
      await act(page, client, input);
      await settled(page);
    }
  }
}

/** Bakes, or cancels that, and takes the files; returns their names and where things were before that. */
async function baking(page, client, { folder, cancel }) {
  await page.evaluate(() => (window.pause = 0));
  await page.click("#bake");
  if (cancel) {
    await act(page, client, cancel);
    await still(page);
    await page.click("#cancel");
  }
  await idle(page);
  const baked = await page.evaluate(layout);
  return { baked, downloads: await download(page, folder) };
}

/** Takes the files of the last bake, and returns their names. */
async function download(page, folder) {
  const downloads = [];
  for (const link of await page.locator("#files a").all()) {
    const [download] = await Promise.all([page.waitForEvent("download"), link.click()]);
    await download.saveAs(join(folder, download.suggestedFilename()));
    downloads.push(download.suggestedFilename());
  }
  return downloads;
}

/** In the page: what it says. */
function said() {
  const shown = (id) => (document.getElementById(id).checkVisibility() ? document.getElementById(id).innerText : "");
  return {
    state: document.documentElement.dataset.state,
    message: shown("message"),
    what: shown("what"),
    warnings: shown("warnings"),
    isolated: window.crossOriginIsolated,
    axis: document.getElementById("axis").value,
    floor: shown("floor"),
    count: document.getElementById("count").textContent,
    erased: shown("has-erased").trim(),
    compares: document.getElementById("compare").checkVisibility(),
    pause: Math.round(window.pause),
    paint: Math.round(performance.getEntriesByName("first-contentful-paint")[0]?.startTime ?? -1),
  };
}

async function see(visit) {
  const { page, errors, server } = await begin(visit);
  const client = await page.context().newCDPSession(page);
  const start = await page.evaluate(layout);
  await open(page, visit);
  const each = visit.each && (await openEach(page, errors, visit.each));
  const opened = await page.evaluate(layout);
  await fill(page, visit.set ?? {});
  await perform(page, client, visit.inputs ?? []);
  const done = visit.bake ? await baking(page, client, visit) : { downloads: [] };
  await perform(page, client, visit.after ?? []);
  const again = visit.again && (await download(page, visit.again));
  if (visit.screenshot) {
    await page.waitForTimeout(1500);
    await page.screenshot({ path: visit.screenshot });
  }
  const line = { errors, ...(await page.evaluate(said)), ...done, again, each, start, opened, end: await page.evaluate(layout) };
  await page.close();
  server?.close();
  return line;
}
