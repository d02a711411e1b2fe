// Opens pages in headless Chromium and does what standard input asks for; prints one JSON line per page.
// Usage: node browser.mjs JUDGES CHROMIUM < PAGES   (JUDGES holds node_modules)
//
// PAGES is a JSON list of { page, fragment, size: [w, h], touch, steps, webgl, script }; webgl and script are false for a browser without
// them, and of a page without script the line holds { text }: what is seen of it. A step is an input of inputs.mjs and then waits for the
// picture to be at rest; { screenshot: FILE } is taken after that, and { seen: NAME } saves pictures of before and after. The line holds
// { views, errors, state, ms }: the page's own words for the view after every step, and all that the console complained of.
import { resolve } from "node:path";
import { text } from "node:stream/consumers";
import { pathToFileURL } from "node:url";
import { launch } from "./chromium.mjs";
import { act, heard, seen } from "./inputs.mjs";

const [judges, executablePath] = process.argv.slice(2);
const browser = await launch(judges, executablePath);
for (const wanted of JSON.parse(await text(process.stdin))) console.log(JSON.stringify(await visit(wanted)));
await browser.close();

async function visit({ page: file, fragment = "", size, touch = false, steps = [], webgl = true, script = true }) {
  const [width, height] = size;
  const context = await browser.newContext({ viewport: { width, height }, hasTouch: touch, javaScriptEnabled: script });
  const page = await context.newPage();
  if (!webgl) await page.addInitScript(() => (HTMLCanvasElement.prototype.getContext = () => null));
  if (!script) {
    await page.goto(pathToFileURL(resolve(file)).href);
    const seen = await page.locator("body > *:visible, noscript > p").allInnerTexts();
    await context.close();
    return { text: seen.join(" ") };
  }
  const errors = [];
  page.on("console", (m) => ["error", "warning"].includes(m.type()) && errors.push(m.text()));
  page.on("pageerror", (e) => errors.push(String(e)));
  page.on("request", (r) => r.url().startsWith("http") && errors.push(`asks the network for ${r.url()}`));
  const start = performance.now();
  await page.goto(pathToFileURL(resolve(file)).href + fragment);
  const ready = () =>
    page.waitForFunction(() => ["ready", "failed"].includes(document.documentElement.dataset.state), null, { timeout: 120_000 });
  const rest = async () => {
    await heard(page);
    await ready();
  };
  await ready();
  const ms = Math.round(performance.now() - start);
  const views = [await page.evaluate(() => window.trisplat.view?.())];
  const client = await context.newCDPSession(page);
  let last = null;
  for (const step of steps) {
    if (step.seen) last = await seen(page, client, step, step.seen, rest, last);
    else {
      last = null;
      await act(page, client, step);
      await rest();
    }
    if (step.screenshot) await page.screenshot({ path: step.screenshot });
    views.push(await page.evaluate(() => window.trisplat.view?.()));
  }
  const state = await page.evaluate(() => ({
    state: document.documentElement.dataset.state,
    says: document.getElementById("what").textContent,
    loading: !document.getElementById("loading").hidden,
    help: !document.getElementById("help").hidden,
    keys: getComputedStyle(document.querySelector("#help .key")).display !== "none",
    flying: document.getElementById("fly").getAttribute("aria-pressed") === "true",
    hash: location.hash,
    limit: !document.getElementById("limit").hidden,
    count: document.getElementById("count").textContent,
    floor: document.getElementById("floor").textContent,
    scale: document.getElementById("scale").innerText,
  }));
  await context.close();
  return { views, errors, ms, ...state };
}
