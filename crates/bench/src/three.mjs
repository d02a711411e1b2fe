// Draws a GLB with three.js in headless Chromium along a path of cameras; the input comes as JSON on standard input,
// the result goes to standard output. Every frame ends when a pixel of it has been read back.
import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import { text } from "node:stream/consumers";

const job = JSON.parse(await text(process.stdin));
const require = createRequire(join(job.folder, "node_modules", "here.js"));
const { chromium } = require("playwright-core");
const three = join(job.folder, "node_modules", "three");
const browser = await chromium.launch({
  executablePath: job.chromium,
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--force-color-profile=srgb"],
});
const page = await browser.newPage({ viewport: { width: job.size[0], height: job.size[1] } });
page.on("pageerror", (e) => console.error(String(e)));
const index = `<!doctype html><style>body{margin:0}</style><script type=importmap>{"imports":{"three":"/three/build/three.module.js"}}</script>`;
await page.route("http://bench/**", (route) => {
  const path = new URL(route.request().url()).pathname;
  if (path === "/") return route.fulfill({ contentType: "text/html", body: index });
  if (path === "/scene.glb") return route.fulfill({ contentType: "model/gltf-binary", body: readFileSync(job.glb) });
  return route.fulfill({ contentType: "text/javascript", body: readFileSync(join(three, path.slice("/three/".length))) });
});
await page.goto("http://bench/");
// CPU time of the whole browser: what software rendering costs, whatever else the machine does.
const client = await browser.newBrowserCDPSession();
const cpu = async () => (await client.send("SystemInfo.getProcessInfo")).processInfo.reduce((sum, p) => sum + p.cpuTime, 0) * 1e3;
await page.evaluate(async (job) => {
  const THREE = await import("three");
  const { GLTFLoader } = await import("/three/examples/jsm/loaders/GLTFLoader.js");
  const renderer = new THREE.WebGLRenderer({ antialias: job.antialias, preserveDrawingBuffer: true });
  renderer.setPixelRatio(1);
  renderer.setSize(...job.size);
  document.body.append(renderer.domElement);
  const scene = new THREE.Scene();
  scene.background = new THREE.Color().setRGB(...job.background, THREE.SRGBColorSpace);
  scene.add((await new GLTFLoader().loadAsync("/scene.glb")).scene);
  const camera = new THREE.PerspectiveCamera();
  camera.matrixAutoUpdate = false;
  const gl = renderer.getContext();
  const pixel = new Uint8Array(4);
  window.draw = (i) => {
    const [toWorld, projection] = job.cameras[i % job.cameras.length];
    camera.matrix.fromArray(toWorld);
    camera.projectionMatrix.fromArray(projection);
    camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
    camera.updateMatrixWorld(true);
    renderer.render(scene, camera);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  };
  window.time = (first, count) => {
    const times = [];
    let [drawn, draws] = [0, 0];
    for (let i = 0; i < count; i++) {
      const start = performance.now();
      window.draw(first + i);
      times.push(performance.now() - start);
      drawn += renderer.info.render.triangles;
      draws += renderer.info.render.calls;
    }
    const info = gl.getExtension("WEBGL_debug_renderer_info");
    const adapter = gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
    return { frames_ms: times, drawn: drawn / count, draws: draws / count, adapter: `three.js ${THREE.REVISION}, ${adapter}` };
  };
}, job);
await page.evaluate(() => window.draw(0));
const shown = await page.evaluate(() => document.querySelector("canvas").toDataURL("image/png"));
writeFileSync(job.picture, Buffer.from(shown.split(",")[1], "base64"));
await page.evaluate((count) => window.time(0, count), job.warmup);
const before = await cpu();
const result = await page.evaluate(([first, count]) => window.time(first, count), [job.warmup, job.frames]);
result.cpu_ms = ((await cpu()) - before) / job.frames;
await browser.close();
console.log(JSON.stringify(result));
