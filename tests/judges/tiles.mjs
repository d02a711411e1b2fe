// Opens a tileset with 3DTilesRendererJS in headless Chromium from several distances and says what it loads.
// Usage: node tiles.mjs JUDGES CHROMIUM TILESET [SCREENSHOT] < JOB   (JUDGES holds node_modules; the folder of the tileset is served)
//
// JOB is JSON: { size: [w, h], error: px, views: [{ eye, target }] }, Z-up, in units of the tileset. Prints a JSON list, for each view
// { triangles, tiles, loaded, depth }: drawn triangles and tiles, tiles in memory, depth of the deepest drawn. A last line holds errors.
import { readFileSync } from "node:fs";
import { basename, dirname, join, resolve } from "node:path";
import { text } from "node:stream/consumers";
import { launch, openPage } from "./chromium.mjs";

const [judges, executablePath, tileset, screenshot] = process.argv.slice(2);
const job = JSON.parse(await text(process.stdin));
const modules = join(resolve(judges), "node_modules");
const browser = await launch(judges, executablePath);
const { page, errors } = await openPage(browser, job.size[0], job.size[1]);
const imports = {
  three: "/modules/three/build/three.module.js",
  "three/addons/": "/modules/three/examples/jsm/",
  "three/": "/modules/three/",
  "3d-tiles-renderer": "/modules/3d-tiles-renderer/build/index.three.js",
};
const index = `<!doctype html><style>body{margin:0}</style><script type=importmap>${JSON.stringify({ imports })}</script>`;
await page.route("http://tiles/**", (route) => {
  const path = decodeURIComponent(new URL(route.request().url()).pathname);
  try {
    if (path === "/") return route.fulfill({ contentType: "text/html", body: index });
    if (path.startsWith("/scene/")) return route.fulfill({ body: readFileSync(join(dirname(resolve(tileset)), path.slice(7))) });
    if (!path.startsWith("/modules/")) return route.fulfill({ status: 204 });
    return route.fulfill({ contentType: "text/javascript", body: readFileSync(join(modules, path.slice(9))) });
  } catch (e) {
    errors.push(String(e));
    return route.fulfill({ status: 404 });
  }
});
await page.goto("http://tiles/");
const views = await page.evaluate(
  async ([job, url]) => {
    const THREE = await import("three");
    const { TilesRenderer } = await import("3d-tiles-renderer");
    const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
    renderer.setPixelRatio(1);
    renderer.setSize(...job.size);
    document.body.append(renderer.domElement);
    const scene = new THREE.Scene();
    const camera = new THREE.PerspectiveCamera(60, job.size[0] / job.size[1], 1e-3, 1e6);
    camera.up.set(0, 0, 1);
    const tiles = new TilesRenderer(url);
    tiles.errorTarget = job.error;
    tiles.setCamera(camera);
    tiles.setResolutionFromRenderer(camera, renderer);
    scene.add(tiles.group);
    let failed = 0;
    tiles.addEventListener("load-error", () => failed++);
    const frame = async () => {
      camera.updateMatrixWorld();
      tiles.update();
      renderer.render(scene, camera);
      await new Promise((done) => setTimeout(done, 10));
    };
    const out = [];
    for (const { eye, target } of job.views) {
      camera.position.set(...eye);
      camera.lookAt(...target);
      // At rest: for some frames nothing is asked for, and the same is drawn.
      let [quiet, last] = [0, -1];
      for (let i = 0; i < 6000 && quiet < 20; i++) {
        await frame();
        const { downloading, parsing, queued = 0 } = tiles.stats;
        const now = renderer.info.render.triangles;
        quiet = downloading + parsing + queued === 0 && now === last && tiles.root ? quiet + 1 : 0;
        last = now;
      }
      const visible = [...tiles.visibleTiles];
      const depth = Math.max(...visible.map((tile) => tile.internal?.depth ?? tile.__depth ?? 0));
      out.push({ triangles: last, tiles: visible.length, depth, failed });
    }
    return out;
  },
  [job, `/scene/${encodeURIComponent(basename(tileset))}`],
);
if (screenshot) await page.screenshot({ path: screenshot });
await browser.close();
console.log(JSON.stringify({ views, errors }));
