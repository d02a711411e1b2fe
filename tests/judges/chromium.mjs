// Headless Chromium for the judges, whose node_modules holds playwright-core.
import { createRequire } from "node:module";
import { join, resolve } from "node:path";

const args = [
  "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
  "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars", "--force-color-profile=srgb",
];

// The browser at `executablePath`; `judges` holds node_modules.
export function launch(judges, executablePath) {
  const { chromium } = createRequire(join(resolve(judges), "judge.js"))("playwright-core");
  return chromium.launch({ executablePath, args });
}

// A page of `browser`, and a list that gets all it complains of.
export async function openPage(browser, width, height, hasTouch = false) {
  const page = await browser.newPage({ viewport: { width, height }, hasTouch });
  const errors = [];
  page.on("console", (m) => m.type() === "error" && errors.push(m.text()));
  page.on("pageerror", (e) => errors.push(String(e)));
  return { page, errors };
}
