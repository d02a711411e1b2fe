// Opens the page of samples/engines/three in headless Chromium, double-clicks its middle, and says what it did as one line of JSON:
// { triangles, target, errors }. The packages that the page asks its CDN for come from the judges; nothing else is let through.
// Usage: node sample.mjs JUDGES CHROMIUM FOLDER   (JUDGES holds node_modules, FOLDER the page and its scene)
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { extname, join, resolve } from "node:path";

const [judges, executablePath, folder] = process.argv.slice(2);
const three = join(resolve(judges), "node_modules/three");
const { chromium } = createRequire(join(resolve(judges), "judge.js"))("playwright-core");
const args = [
  "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
  "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars",
];
const types = { ".html": "text/html", ".js": "text/javascript", ".glb": "model/gltf-binary" };
const browser = await chromium.launch({ executablePath, args });
const page = await browser.newPage({ viewport: { width: 480, height: 360 } });
const errors = [];
page.on("console", (m) => m.type() === "error" && errors.push(m.text()));
page.on("pageerror", (e) => errors.push(String(e)));
await page.route("**/*", (route) => {
  const { origin, pathname } = new URL(route.request().url());
  const local = origin === "http://sample" ? join(resolve(folder), pathname) : pathname.replace(/^\/npm\/three@[^/]+/, three);
  if (pathname === "/favicon.ico") return route.fulfill({ status: 204 });
  try {
    return route.fulfill({ contentType: types[extname(local)], body: readFileSync(local) });
  } catch (e) {
    errors.push(String(e));
    return route.fulfill({ status: 404 });
  }
});
await page.goto("http://sample/index.html");
const said = (name) => page.waitForFunction((name) => document.documentElement.dataset[name], name, { timeout: 60_000 });
const triangles = Number(await (await said("triangles")).jsonValue());
await page.mouse.dblclick(240, 180);
const target = await (await said("target")).jsonValue();
console.log(JSON.stringify({ triangles, target, errors }));
await browser.close();
