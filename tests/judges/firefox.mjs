// Bakes a scene for Godot on the page of the program, in Firefox, on a screen: node firefox.mjs JUDGES FIREFOX PAGE SCENE FOLDER
//
// Downloads go to FOLDER. Prints one JSON line: { errors, state, message, browser, paint }; paint: when the page was first seen, ms.
// Playwright wants a Firefox of its own; Puppeteer drives the one of the system.
import { createRequire } from "node:module";
import { join, resolve } from "node:path";
import { readdir } from "node:fs/promises";
import { pathToFileURL } from "node:url";

const [judges, executablePath, app, scene, folder] = process.argv.slice(2);
const { default: puppeteer } = await import(
  pathToFileURL(createRequire(join(resolve(judges), "judge.js")).resolve("puppeteer-core")).href
);
const browser = await puppeteer.launch({
  browser: "firefox", executablePath, headless: false, // Without a screen it has no WebGL here.
  extraPrefsFirefox: {
    "webgl.force-enabled": true, "browser.download.folderList": 2, "browser.download.dir": resolve(folder),
    "browser.download.alwaysOpenPanel": false,
  },
});
const errors = [];
const page = await browser.newPage();
page.on("console", (m) => m.type() === "error" && errors.push(m.text()));
page.on("pageerror", (e) => errors.push(String(e)));
await page.goto(pathToFileURL(resolve(app)).href);
// Puppeteer's own waitForFunction makes its function from text, which the policy of the page forbids in newer Firefox.
const rest = async (not) => {
  for (const end = Date.now() + 120_000; ; await new Promise((later) => setTimeout(later, 100))) {
    const state = await page.evaluate(() => document.documentElement.dataset.state);
    if (!["starting", not].includes(state)) return;
    if (Date.now() > end) throw new Error(`still ${state} after two minutes`);
  }
};
await rest("starting");
await (await page.$("#file")).uploadFile(resolve(scene));
await rest("working");
await page.select("#target", "godot");
await rest("working");
await page.click("#bake");
await rest("working");
const links = await page.$$("#files a");
for (const link of links) await link.click();
// A file that still downloads has a second one beside it, NAME.part.
for (let tries = 0; tries < 100; tries++) {
  const there = await readdir(folder);
  if (there.length === links.length && !there.some((name) => name.endsWith(".part"))) break;
  await new Promise((later) => setTimeout(later, 100));
}
const seen = await page.evaluate(() => ({
  state: document.documentElement.dataset.state,
  message: document.getElementById("message").innerText,
  browser: navigator.userAgent,
  paint: Math.round(performance.getEntriesByName("first-contentful-paint")[0]?.startTime ?? -1),
}));
await browser.close();
console.log(JSON.stringify({ errors, ...seen }));
