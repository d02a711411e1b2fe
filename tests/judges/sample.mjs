// Opens the page of samples/engines/three or, for pictures only, of samples/engines/babylon in headless Chromium, double-clicks its middle, and says what it did as one line of JSON:
// { triangles, target, errors }. The packages that the page asks its CDN for come from the judges; nothing else is let through.
// Usage: node sample.mjs JUDGES CHROMIUM FOLDER [VIEWS]   (JUDGES holds node_modules, FOLDER the page and its scene)
//
// VIEWS, JSON, asks for pictures: a list of { size: [W, H], fov: degrees from top to bottom, eye, target, out: PNG file }, all of one size.
import { readFileSync } from "node:fs";
import { extname, join, resolve } from "node:path";
import { launch, openPage } from "./chromium.mjs";

const [judges, executablePath, folder, list] = process.argv.slice(2);
const views = list ? JSON.parse(readFileSync(list)) : [];
const types = { ".html": "text/html", ".js": "text/javascript", ".glb": "model/gltf-binary", ".jpg": "image/jpeg" };
const three = `window.show = ({ fov, eye, target }) => {
  camera.fov = fov;
  camera.position.fromArray(eye);
  controls.target.fromArray(target);
  controls.update();
  resize();
};`;
const babylon = `window.show = ({ fov, eye, target }) => {
  scene.activeCamera.fov = (fov * Math.PI) / 180;
  scene.activeCamera.target = BABYLON.Vector3.FromArray(target);
  scene.activeCamera.setPosition(BABYLON.Vector3.FromArray(eye));
  scene.render();
};
document.documentElement.dataset.triangles = scene.meshes.reduce((sum, mesh) => sum + (mesh.getTotalIndices() || mesh.getTotalVertices()) / 3, 0);`;
const browser = await launch(judges, executablePath);
const { page, errors } = await openPage(browser, ...(views[0]?.size ?? [480, 360]));
await page.route("**/*", (route) => {
  const { origin, pathname } = new URL(route.request().url());
  const local = origin === "http://sample" ? join(resolve(folder), pathname) : pathname.replace(/^\/npm\/([^@]+)@[^/]+/, join(resolve(judges), "node_modules/$1"));
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
  const text = readFileSync(file, "utf8");
  const show = text.includes("BABYLON") ? babylon : three;
  return text.replace(/<\/script>\s*$/, `${show}</script>`);
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
