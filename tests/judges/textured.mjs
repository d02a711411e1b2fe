// Draws a GLB in three.js in headless Chromium from given places, one sample a pixel, on black.
// Usage: node textured.mjs JUDGES CHROMIUM SCENE VIEWS   (JUDGES holds node_modules)
// VIEWS: JSON list of { size: [W, H], fov: degrees from top to bottom, eye, target, up, out: PNG file }
//
// Prints JSON: { errors }.
import { readFileSync, writeFileSync } from "node:fs";
import { join, resolve } from "node:path";
import { launch, openPage } from "./chromium.mjs";

const [judges, executablePath, scene, views] = process.argv.slice(2);
const modules = join(resolve(judges), "node_modules");
const browser = await launch(judges, executablePath);
const { page, errors } = await openPage(browser, 640, 480);
const imports = { three: "/modules/three/build/three.module.js", "three/addons/": "/modules/three/examples/jsm/" };
const index = `<!doctype html><script type=importmap>${JSON.stringify({ imports })}</script><canvas></canvas>`;
await page.route("http://judge/**", (route) => {
  const path = decodeURIComponent(new URL(route.request().url()).pathname);
  if (path === "/") return route.fulfill({ contentType: "text/html", body: index });
  if (path === "/scene.glb") return route.fulfill({ body: readFileSync(resolve(scene)) });
  if (!path.startsWith("/modules/")) return route.fulfill({ status: 204 });
  return route.fulfill({ contentType: "text/javascript", body: readFileSync(join(modules, path.slice(9))) });
});
await page.goto("http://judge/");
await page.evaluate(async () => {
  const THREE = await import("three");
  const { GLTFLoader } = await import("three/addons/loaders/GLTFLoader.js");
  const canvas = document.querySelector("canvas");
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: false, preserveDrawingBuffer: true });
  const world = new THREE.Scene();
  world.background = new THREE.Color(0);
  world.add((await new GLTFLoader().loadAsync("/scene.glb")).scene);
  window.show = ({ size, fov, eye, target, up }) => {
    renderer.setSize(size[0], size[1], false);
    const camera = new THREE.PerspectiveCamera(fov, size[0] / size[1], 0.01, 1e4);
    camera.position.set(...eye);
    camera.up.set(...up);
    camera.lookAt(...target);
    renderer.render(world, camera);
    return canvas.toDataURL("image/png").split(",")[1];
  };
});
for (const view of JSON.parse(readFileSync(views))) {
  writeFileSync(view.out, Buffer.from(await page.evaluate((view) => window.show(view), view), "base64"));
}
await browser.close();
console.log(JSON.stringify({ errors }));
