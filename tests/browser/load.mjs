// What watching costs: runs of a minute at 100 Hz on an emulated valve, in turn with one browser and ten more readers of the event
// stream, and with nobody. Prints samples lost, frames drawn, the server's share of a core, and the lateness of the loop.
// Usage: node load.mjs HIL FOLDER [PAIRS] [SECONDS]. Its figures say something only on a machine that does nothing else.
import { chromium } from "playwright-core";
import { spawn } from "node:child_process";
import { mkdirSync, readFileSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { get } from "node:http";
import { join, resolve } from "node:path";

const hil = resolve(process.argv[2]), folder = resolve(process.argv[3]);
const pairs = Number(process.argv[4] ?? 5), seconds = Number(process.argv[5] ?? 60);
rmSync(folder, { recursive: true, force: true });
mkdirSync(folder, { recursive: true });
const sleep = (ms) => new Promise((done) => setTimeout(done, ms));

writeFileSync(join(folder, "watched.toml"), `schema = "hil.plan/1"
name = "watched"
rate = "100 Hz"
[[phase]]
name = "drive"
stimulus.sine = { mean = "12 bar", amplitude = "6 bar", frequency = "0.5 Hz", for = "${seconds} s" }
[[phase.measure]]
metric.rmse = {}
`);
const port = 15020 + Math.floor(Math.random() * 2000);
writeFileSync(join(folder, "bench.toml"), `schema = "hil.station/1"
id = "load"
store = "records"
[[product]]
id = "watched"
title = "Watched"
plan = "watched.toml"
driver = "emulator-tcp"
[[site]]
name = "left"
tcp = "127.0.0.1:${port}"
`);

const running = [];
function begin(args, says) {
  const child = spawn(hil, args, { cwd: folder, stdio: ["ignore", "pipe", "pipe"] });
  running.push(child);
  let text = "", err = "";
  child.stderr.on("data", (data) => { err += data; });
  return new Promise((done, wrong) => {
    child.stdout.on("data", (data) => { text += data; const found = text.match(says); if (found) done({ child, found, text: () => text }); });
    child.on("exit", (code) => wrong(new Error(`hil ${args.join(" ")}: ${code}\n${text}${err}`)));
  });
}
process.on("exit", () => running.forEach((child) => child.kill("SIGKILL")));

// Seconds of CPU that a process has used, and its threads: Linux counts hundredths.
const cpu = (pid) => { const f = readFileSync(`/proc/${pid}/stat`, "utf8").split(") ")[1].split(" "); return (Number(f[11]) + Number(f[12])) / 100; };

await begin(["emulate", "--valve", "paper", "--driver", "emulator-tcp", "--tcp", `127.0.0.1:${port}`], /emulated driver/);
const station = await begin(["station", "bench.toml", "--listen", "127.0.0.1:0", "--viewer-token"], /viewers: (\S+)\n/);
const address = station.text().match(/: (http\S+)\n/)[1], root = address.split("#")[0].replace(/\/$/, "");
const browser = await chromium.launch({ executablePath: process.env.CHROMIUM || "/usr/bin/chromium", args: ["--no-sandbox", "--disable-gpu"] });

async function visitor() {
  const context = await browser.newContext({ viewport: { width: 1400, height: 900 }, locale: "en-US" }), page = await context.newPage();
  await page.goto(address);
  await page.waitForSelector("#serial");
  return { context, page };
}

let serial = 0, newest = new Set();
function record() {
  const found = readdirSync(join(folder, "records"), { recursive: true }).filter((f) => f.endsWith("record.json") && !newest.has(f));
  for (const f of found) newest.add(f);
  return found.length ? JSON.parse(readFileSync(join(folder, "records", found.at(-1)), "utf8")) : null;
}

async function run(watched) {
  const { context, page } = await visitor();
  const cookie = (await context.cookies()).map((c) => `${c.name}=${c.value}`).join("; ");
  await page.locator("#operator").fill("load");
  await page.keyboard.press("Enter");
  await page.locator("#serial").fill(`L-${++serial}`);
  await page.keyboard.press("Enter");
  await sleep(300);
  await page.keyboard.press("Enter");
  await page.waitForSelector('.site[data-light="running"]', { timeout: 10000 });
  const streams = [];
  let bytes = 0;
  if (watched) for (let k = 0; k < 10; k++) streams.push(get(`${root}/api/events`, { headers: { cookie } }, (answer) => answer.on("data", (data) => { bytes += data.length; })));
  else await context.close();
  await sleep(2000);
  const from = cpu(station.child.pid), drawn = watched ? await page.evaluate(() => Number(document.documentElement.dataset.drawn)) : 0, begun = performance.now();
  await sleep((seconds - 8) * 1000);
  const span = (performance.now() - begun) / 1000, used = cpu(station.child.pid) - from;
  const frames = watched ? (await page.evaluate(() => Number(document.documentElement.dataset.drawn))) - drawn : 0;
  for (let k = 0; k < 300; k++) { const found = record(); if (found) { streams.forEach((s) => s.destroy()); if (watched) await context.close(); return { record: found, share: used / span, frames: frames / span, bytes }; } await sleep(200); }
  throw new Error("no record came");
}

for (let k = 0; k < pairs; k++) {
  for (const watched of k % 2 ? [false, true] : [true, false]) {
    const { record, share, frames, bytes } = await run(watched);
    const timing = record.phases.map((p) => p.timing).find((t) => t) ?? record.timing;
    const us = (s) => `${Math.round(s * 1e6)} us`, { lateness_p99_s, lateness_max_s, missed_slots, lost_samples, stale_samples, samples } = timing;
    console.log(`${watched ? "watched" : "alone  "} lateness p99 ${us(lateness_p99_s)}, max ${us(lateness_max_s)}; of ${samples} samples ${missed_slots} slots missed, ${lost_samples} late, ${stale_samples} stale; server ${(share * 100).toFixed(1)} % of a core${watched ? `; ${frames.toFixed(1)} frames/s, ${(bytes / 1e6).toFixed(1)} MB to ten readers` : ""}`);
  }
}
await browser.close();
running.forEach((child) => child.kill("SIGKILL"));
