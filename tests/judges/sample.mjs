// Opens the page of samples/engines/three in headless Chromium, double-clicks its middle, and says what it did as one line of JSON:
// { triangles, target, errors }. The packages that the page asks its CDN for come from the judges; nothing else is let through.
// Usage: node sample.mjs JUDGES CHROMIUM FOLDER [VIEWS]   (JUDGES holds node_modules, FOLDER the page and its scene)
//
// VIEWS, JSON, asks for pictures: a list of { size: [W, H], fov: degrees from top to bottom, eye, target, out: PNG file }, all of one size.
import { readFileSync } from "node:fs";
import { extname, join, resolve } from "node:path";
import { launch, openPage } from "./chromium.mjs";

const [judges, executablePath, folder, list] = process.argv.slice(2);
const views = list ? JSON.parse(readFileSync(list)) : [];
const three = join(resolve(judges), "node_modules/three");
const types = { ".html": "text/html", ".js": "text/javascript", ".glb": "model/gltf-binary", ".jpg": "image/jpeg" };
const browser = await launch(judges, executablePath);
const { page, errors } = await openPage(browser, ...(views[0]?.size ?? [480, 360]));
await page.route("**/*", (route) => {
  const { origin, pathname } = new URL(route.request().url());
  const local = origin === "http://sample" ? join(resolve(folder), pathname) : pathname.replace(/^\/npm\/three@[^/]+/, three);
  if (pathname === "/favicon.ico") return route.fulfill({ status: 204 });
  try {
    return route.fulfill({ contentType: types[extname(local)], body: served(local) });
  } catch (e) {
    errors.push(String(e));
    return route.fulfill({ status: 404 });
  }
});
// The page's own, with a way to look from elsewhere at the end of its script.
function served(file) {
  if (extname(file) !== ".html") return readFileSync(file);
  const show = `window.show = ({ fov, eye, target }) => {
    camera.fov = fov;
    camera.position.fromArray(eye);
    controls.target.fromArray(target);
    controls.update();
    resize();
  };`;
  return readFileSync(file, "utf8").replace(/<\/script>\s*$/, `${show}</script>`);
}
await page.goto("http://sample/index.html");
const said = (name) => page.waitForFunction((name) => document.documentElement.dataset[name], name, { timeout: 60_000 });
const triangles = Number(await (await said("triangles")).jsonValue());
// It draws before all is loaded, and again at the end of its script.
await page.waitForFunction(() => window.show);
for (const view of views) {
  await page.evaluate((view) => window.show(view), view);
  await page.screenshot({ path: view.out });
}
if (!views.length) await page.mouse.dblclick(240, 180);
const target = views.length ? null : await (await said("target")).jsonValue();
console.log(JSON.stringify({ triangles, target, errors }));
await browser.close();
