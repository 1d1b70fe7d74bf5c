// Takes the pictures of README.md from pages that the program makes now, and writes beside them what stands on the pages; with
// --check it takes none and says where the program says something else by now.
// Usage: node pictures.mjs HIL FOLDER DOCS [--check]
import { chromium } from "playwright-core";
import { execFileSync, spawn } from "node:child_process";
import { mkdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { join, resolve } from "node:path";

const [hil, folder, docs] = process.argv.slice(2, 5).map((p) => resolve(p)), checks = process.argv.includes("--check");
rmSync(folder, { recursive: true, force: true });
mkdirSync(folder, { recursive: true });
const run = (line) => {
  try { execFileSync(hil, line.split(" ").slice(1), { cwd: folder, stdio: "ignore" }); } catch (e) { if (e.status !== 1) throw e; }
};
const pictures = {
  "report.png": { commands: ["hil run tipin --sim --out run"], page: "run/report.html", height: 1240 },
  "diagnose.png": {
    commands: ["hil init . --example diagnosis", "hil identify recordings/sweep.csv -o valves/valve.toml", "hil inspect recordings/logger.csv -o log.map.toml",
      "hil diagnose recordings/logger.csv --mapping log.map.toml --model valve --report diagnosis.html"],
    page: "diagnosis.html", height: 1000,
  },
  "batch.png": { commands: ["hil batch tipin --count 400 --sim --population population --out lot"], page: "lot/report.html", height: 1200 },
};
const browser = await chromium.launch({ executablePath: process.env.CHROMIUM || "/usr/bin/chromium", args: ["--no-sandbox", "--disable-gpu"] });
let failed = 0, shown = {};
for (const [name, { commands, page: file, height }] of Object.entries(pictures)) {
  commands.forEach(run);
  const page = await browser.newPage({ viewport: { width: 1180, height }, colorScheme: "light" });
  await page.goto("file://" + join(folder, file));
  // The verdict and the figures that a reader of the picture sees.
  shown[name] = { commands, says: await page.locator("header.top, .tile .value").allInnerTexts() };
  if (!checks) await page.screenshot({ path: join(docs, name) });
  await page.close();
}
// The station: a valve that is done on the left, one under test on the right. What stands there is the page's own, and no figure.
{
  const commands = ["hil station emulated"], station = spawn(hil, ["station", "emulated", "--listen", "127.0.0.1:0", "--store", "station"], { cwd: folder });
  const address = await new Promise((done) => { let text = ""; station.stdout.on("data", (data) => { text += data; const found = text.match(/http\S+\n/); if (found) done(found[0].trim()); }); });
  const page = await browser.newPage({ viewport: { width: 1180, height: 1000 }, colorScheme: "light", locale: "en-US" });
  await page.goto(address);
  await page.waitForSelector("#serial");
  const start = async (serial, k) => {
    await page.locator("#serial").fill(serial);
    await page.keyboard.press("Enter");
    await page.waitForSelector("#said.ready");
    await page.keyboard.press("Enter");
    await page.waitForSelector(`.site:nth-child(${k}) .stop:visible`);
  };
  await page.locator("#operator").fill("early shift");
  if (!checks) {
    await start("CV-0001", 1);
    await page.waitForSelector(".site:nth-child(1) .word", { timeout: 60000 });
    await start("CV-0002", 2);
    await page.waitForTimeout(8500);
    await page.screenshot({ path: join(docs, "station.png") });
  }
  shown["station.png"] = { commands, says: [await page.locator("#station").innerText(), ...(await page.locator("nav a").allInnerTexts()), ...(await page.locator("#product option").allInnerTexts()), await page.locator("#start").innerText()] };
  await page.close();
  station.kill("SIGTERM");
  await new Promise((done) => station.on("exit", done));
}
await browser.close();
const path = join(docs, "pictures.json"), text = JSON.stringify(shown, null, 1) + "\n";
if (!checks) writeFileSync(path, text);
else {
  const kept = JSON.parse(readFileSync(path, "utf8"));
  for (const name of Object.keys(shown)) {
    const now = JSON.stringify(shown[name]), then = JSON.stringify(kept[name]);
    if (now !== then) { failed++; console.log(`docs/${name} is stale: tests/browser/run.sh --pictures takes it again\n  then ${then}\n  now  ${now}`); }
  }
}
console.log(`${Object.keys(shown).length - failed} passed, ${failed} failed`);
process.exit(failed ? 1 : 0);
