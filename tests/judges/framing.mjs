// Opens a GLB in three.js or Babylon.js in headless Chromium, framed by the viewer's own means, with its backdrop and without.
// Usage: node framing.mjs JUDGES CHROMIUM three|babylon SCENE [FOLDER]   (JUDGES holds node_modules; FOLDER: where to keep the pictures)
//
// Prints JSON: { scene: share of the picture that the scene covers, kept: share of that which looks the same with the backdrop,
// ball: share that the backdrop covers, errors }.
import { readFileSync, writeFileSync } from "node:fs";
import { join, resolve } from "node:path";
import { launch, openPage } from "./chromium.mjs";

const [judges, executablePath, viewer, scene, folder] = process.argv.slice(2);
const modules = join(resolve(judges), "node_modules");
const browser = await launch(judges, executablePath);
const { page, errors } = await openPage(browser, 640, 480);
const imports = { three: "/modules/three/build/three.module.js", "three/addons/": "/modules/three/examples/jsm/" };
const head = viewer === "three" ? `<script type=importmap>${JSON.stringify({ imports })}</script>`
  : "<script src=/modules/babylonjs/babylon.js></script><script src=/modules/babylonjs-loaders/babylonjs.loaders.min.js></script>";
const index = `<!doctype html><style>body{margin:0}</style>${head}<canvas width=640 height=480></canvas>`;
await page.route("http://judge/**", (route) => {
  const path = decodeURIComponent(new URL(route.request().url()).pathname);
  if (path === "/") return route.fulfill({ contentType: "text/html", body: index });
  if (path === "/scene.glb") return route.fulfill({ body: readFileSync(resolve(scene)) });
  if (!path.startsWith("/modules/")) return route.fulfill({ status: 204 });
  return route.fulfill({ contentType: "text/javascript", body: readFileSync(join(modules, path.slice(9))) });
});
await page.goto("http://judge/");

// Both end with a function that shows the scene with its backdrop or without, on magenta.
const open = {
  // The usual viewer: a box around everything, the camera as far off as that is large.
  three: async () => {
    const THREE = await import("three");
    const { GLTFLoader } = await import("three/addons/loaders/GLTFLoader.js");
    const renderer = new THREE.WebGLRenderer({ canvas: document.querySelector("canvas"), preserveDrawingBuffer: true });
    const all = (await new GLTFLoader().loadAsync("/scene.glb")).scene;
    const box = new THREE.Box3().setFromObject(all);
    const [size, center] = [box.getSize(new THREE.Vector3()).length(), box.getCenter(new THREE.Vector3())];
    const camera = new THREE.PerspectiveCamera(60, 4 / 3, size / 100, size * 100);
    camera.position.set(size / 2, size / 5, size / 2).add(center);
    camera.lookAt(center);
    const world = new THREE.Scene();
    world.add(all);
    world.background = new THREE.Color(0xff00ff);
    window.show = (backdrop) => {
      all.traverse((object) => { if (object.name === "backdrop") object.visible = backdrop; });
      renderer.render(world, camera);
    };
  },
  babylon: async () => {
    BABYLON.SceneLoader.ShowLoadingScreen = false;
    const engine = new BABYLON.Engine(document.querySelector("canvas"), false, { preserveDrawingBuffer: true });
    const world = new BABYLON.Scene(engine);
    world.clearColor = new BABYLON.Color4(1, 0, 1, 1);
    await BABYLON.SceneLoader.AppendAsync("/", "scene.glb", world);
    // Its own framing, from the front of a glTF, as its sandbox and viewer do.
    world.createDefaultCameraOrLight(true, true, true);
    world.activeCamera.alpha += Math.PI;
    await world.whenReadyAsync();
    window.show = (backdrop) => {
      world.meshes.filter((mesh) => mesh.name.startsWith("backdrop")).forEach((mesh) => mesh.setEnabled(backdrop));
      world.render();
    };
  },
};
await page.evaluate(open[viewer]);
// The pixels stay in the page: as text they would take seconds.
const picture = async (backdrop, name) => {
  await page.evaluate(([backdrop, name]) => {
    window.show(backdrop);
    const flat = document.createElement("canvas");
    [flat.width, flat.height] = [640, 480];
    const to = flat.getContext("2d");
    to.drawImage(document.querySelector("canvas"), 0, 0);
    window[name] = to.getImageData(0, 0, 640, 480).data;
  }, [backdrop, name]);
  if (folder) writeFileSync(join(folder, `${viewer}-${name}.png`), await page.screenshot());
};
await picture(false, "without");
await picture(true, "with");
const shares = await page.evaluate(() => {
  const { without, with: withIt } = window;
  const magenta = (p, i) => p[i] > 250 && p[i + 1] < 5 && p[i + 2] > 250;
  let [scene, same, ball] = [0, 0, 0];
  for (let i = 0; i < without.length; i += 4) {
    if (!magenta(without, i)) {
      scene += 1;
      same += [0, 1, 2].every((c) => Math.abs(without[i + c] - withIt[i + c]) <= 3);
    } else ball += !magenta(withIt, i);
  }
  const all = without.length / 4;
  return { scene: scene / all, kept: same / Math.max(scene, 1), ball: ball / all };
});
await browser.close();
console.log(JSON.stringify({ ...shares, errors }));
