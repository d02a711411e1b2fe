// Uses the page of the program as a person does: node app.mjs JUDGES CHROMIUM PAGE < VISITS
//
// VISITS is a JSON list of { files, set, bake, folder, cancel, soft, webgl, isolated, screenshot, size }: files to open; values of fields by their ids;
// whether to bake, and where downloads go; whether to cancel that; whether to look at the scene soft; false for a browser without WebGL 2;
// whether a server isolates it.
// Prints one JSON line per visit: { errors, state, message, what, downloads, warnings, pause, paint }; pause: the longest between two frames
// while it worked, ms; paint: when the page was first seen, ms.
import { readFile } from "node:fs/promises";
import { createServer } from "node:http";
import { join, resolve } from "node:path";
import { text } from "node:stream/consumers";
import { pathToFileURL } from "node:url";
import { launch, openPage } from "./chromium.mjs";

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

async function see({ files, set = {}, bake, folder, cancel, soft, webgl = true, isolated, screenshot, size = [900, 600] }) {
  const { page, errors } = await openPage(browser, ...size);
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
  for (const [id, value] of Object.entries(set)) {
    if (typeof value === "boolean") await page.setChecked(`#${id}`, value);
    else if (await page.evaluate((id) => document.getElementById(id).tagName === "SELECT", id)) await page.selectOption(`#${id}`, value);
    else await page.fill(`#${id}`, value);
    await rest("working");
  }
  if (soft) {
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
    const shown = (id) => (document.getElementById(id).checkVisibility() ? document.getElementById(id).innerText : "");
    return {
      state: document.documentElement.dataset.state,
      message: shown("message"),
      what: shown("what"),
      warnings: shown("warnings"),
      isolated: window.crossOriginIsolated,
      compares: document.getElementById("compare").checkVisibility(),
      pause: Math.round(window.pause),
      paint: Math.round(performance.getEntriesByName("first-contentful-paint")[0]?.startTime ?? -1),
    };
  });
  await page.close();
  server?.close();
  return { errors, ...seen, downloads };
}
