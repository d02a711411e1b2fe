// Uses the page of the program as a person does: node app.mjs JUDGES CHROMIUM PAGE < VISITS
//
// VISITS is a JSON list of { files, drop, set, inputs, bake, folder, cancel, soft, webgl, isolated, touch, screenshot, size }: files to open, by
// the button or dropped where the picture will be; values of fields by their ids; inputs of inputs.mjs, each with { seen: NAME } for pictures of
// before and after; whether to bake, and where downloads go; whether to cancel that; whether to look at the scene soft; false for a browser
// without WebGL 2; whether a server isolates it; whether it has a touch screen.
// Prints one JSON line per visit: { errors, state, message, what, downloads, warnings, pause, paint, canvas, button }; pause: the longest between
// two frames while it worked, ms; paint: when the page was first seen, ms; canvas and button: the boxes of the picture and of the button Bake.
import { readFile } from "node:fs/promises";
import { createServer } from "node:http";
import { basename, join, resolve } from "node:path";
import { text } from "node:stream/consumers";
import { pathToFileURL } from "node:url";
import { launch, openPage } from "./chromium.mjs";
import { seen as seenInput } from "./inputs.mjs";

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

async function see({
  files, drop, set = {}, inputs = [], bake, folder, cancel, soft, webgl = true, isolated, touch = false, screenshot, size = [900, 600],
}) {
  const { page, errors } = await openPage(browser, ...size, touch);
  const server = isolated ? await served() : null;
  const address = server ? `http://127.0.0.1:${server.address().port}/` : pathToFileURL(resolve(app)).href;
  page.on("request", (r) => /^(http|ws)/.test(r.url()) && r.url() !== address && errors.push(`asks the network for ${r.url()}`));
  if (!webgl) await page.addInitScript(() => (HTMLCanvasElement.prototype.getContext = () => null));
  await page.goto(address);
  const rest = (not) =>
    page.waitForFunction((not) => !["starting", not].includes(document.documentElement.dataset.state), not, { timeout: 300_000 });
  await rest("starting");
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
  const downloads = [];
  if (files) {
    await page.setInputFiles("#file", files);
    await rest("working");
  }
  if (drop) {
    await dropInto(page, drop);
    await page.waitForFunction(() => !document.getElementById("options").hidden, null, { timeout: 300_000 });
    await rest("working");
  }
  for (const [id, value] of Object.entries(set)) {
    if (typeof value === "boolean") await page.setChecked(`#${id}`, value);
    else if (await page.evaluate((id) => document.getElementById(id).tagName === "SELECT", id)) await page.selectOption(`#${id}`, value);
    else await page.fill(`#${id}`, value);
    await rest("working");
  }
  const client = await page.context().newCDPSession(page);
  const still = () => page.waitForFunction(() => document.documentElement.dataset.picture === "resting", null, { timeout: 120_000 });
  if (inputs.length > 0) await still();
  for (const input of inputs) await seenInput(page, client, input, input.seen, still);
  if (soft) {
    // On a phone the choices are folded away.
    if (await page.isVisible("#fold")) await page.click("#fold");
    await page.check("input[name=look][value=soft]");
    await page.waitForFunction(() => !document.getElementById("soft").hidden, null, { timeout: 120_000 });
  }
  if (bake) {
    await page.evaluate(() => (window.pause = 0));
    await page.click("#bake");
    if (cancel) await page.click("#cancel");
    await rest("working");
    for (const link of await page.locator("#files a").all()) {
      const [download] = await Promise.all([page.waitForEvent("download"), link.click()]);
      await download.saveAs(join(folder, download.suggestedFilename()));
      downloads.push(download.suggestedFilename());
    }
  }
  if (screenshot) {
    await page.waitForTimeout(1500);
    await page.screenshot({ path: screenshot });
  }
  const seen = await page.evaluate(() => {
    const box = (id) => document.getElementById(id).getBoundingClientRect().toJSON();
    const shown = (id) => (document.getElementById(id).checkVisibility() ? document.getElementById(id).innerText : "");
    return {
      state: document.documentElement.dataset.state,
      message: shown("message"),
      what: shown("what"),
      warnings: shown("warnings"),
      isolated: window.crossOriginIsolated,
      compares: document.getElementById("compare").checkVisibility(),
      pause: Math.round(window.pause),
      canvas: box("picture"),
      button: box("bake"),
      paint: Math.round(performance.getEntriesByName("first-contentful-paint")[0]?.startTime ?? -1),
    };
  });
  await page.close();
  server?.close();
  return { errors, ...seen, downloads };
}
