// Opens the page of samples/engines/three in headless Chromium, double-clicks its middle, and says what it did as one line of JSON:
// { triangles, target, errors }. The packages that the page asks its CDN for come from the judges; nothing else is let through.
// Usage: node sample.mjs JUDGES CHROMIUM FOLDER   (JUDGES holds node_modules, FOLDER the page and its scene)
import { readFileSync } from "node:fs";
import { extname, join, resolve } from "node:path";
import { launch, openPage } from "./chromium.mjs";

const [judges, executablePath, folder] = process.argv.slice(2);
const three = join(resolve(judges), "node_modules/three");
const types = { ".html": "text/html", ".js": "text/javascript", ".glb": "model/gltf-binary" };
const browser = await launch(judges, executablePath);
const { page, errors } = await openPage(browser, 480, 360);
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
