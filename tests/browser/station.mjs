// A day at the station in a real browser, with the program that is named: five emulated valves by scanner keystrokes (one fails, one
// is tested again, one serial number is refused, one is stopped in mid-run, one loses its device), two viewers, a reload in the
// middle, the keyboard alone; a hostile page in another tab; accessibility; pictures of each screen in the folder that is named.
// Usage: node station.mjs HIL FOLDER
import { chromium } from "playwright-core";
import { spawn, execFileSync } from "node:child_process";
import { createServer } from "node:http";
import { existsSync, mkdirSync, readFileSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { join, resolve } from "node:path";

const hil = resolve(process.argv[2]), folder = resolve(process.argv[3]);
rmSync(folder, { recursive: true, force: true });
mkdirSync(folder, { recursive: true });
let passed = 0, failed = 0;
const check = (what, ok, more = "") => { if (ok) passed++; else { failed++; console.log(`FAILED ${what} ${more}`); } };
const sleep = (ms) => new Promise((done) => setTimeout(done, ms));

// A program that serves: resolves with its first line that `says` finds something in.
const running = [];
function begin(args, says) {
  const child = spawn(hil, args, { cwd: folder, stdio: ["ignore", "pipe", "pipe"] });
  running.push(child);
  let err = "";
  child.stderr.on("data", (data) => { err += data; });
  return new Promise((done, wrong) => {
    let text = "";
    child.stdout.on("data", (data) => { text += data; const found = text.match(says); if (found) done({ child, found, text: () => text }); });
    child.on("exit", (code) => wrong(new Error(`hil ${args.join(" ")}: ${code}\n${err}`)));
  });
}
const ended = (child) => new Promise((done) => { if (child.exitCode !== null || child.signalCode) done(child.exitCode); else child.on("exit", done); });

// The emulator's own driver, patient: a machine that also runs a browser may keep an answer waiting, which is not what is tested here.
writeFileSync(join(folder, "patient.toml"), readFileSync(new URL("../../drivers/emulator-tcp.toml", import.meta.url), "utf8").replace(/lost_max = \d+/, "lost_max = 60"));

// A short plan, and a valve too slow for it.
writeFileSync(join(folder, "short.toml"), `schema = "hil.plan/1"
name = "short"
[interlocks]
max_pressure = "35 bar"
silence = "1 s"
[timing]
max_lost = "20 %"
max_missed = "20 %"
[[setup]]
name = "fill"
stimulus.ramp = { from = "0 bar", to = "8 bar", over = "500 ms" }
[[phase]]
name = "step"
stimulus.sequence = [{ hold = { at = "8 bar", for = "500 ms" } }, { ramp = { to = "20 bar", over = "300 ms" } }, { hold = { at = "20 bar", for = "2 s" } }]
[[phase.measure]]
metric.rmse = {}
limit = { max = "0.6 bar" }
[[teardown]]
name = "release"
stimulus.ramp = { to = "0 bar", over = "500 ms" }
`);
execFileSync(hil, ["init", ".", "--example", "bench"], { cwd: folder, stdio: "ignore" });
const paper = readFileSync(join(folder, "valves/valve.toml"), "utf8");
writeFileSync(join(folder, "slow.toml"), `${paper}\n[[effect]]\nfirst_order_lag = { tau = "250 ms" }\n`);
writeFileSync(join(folder, "part.toml"), `schema = "hil.limits/1"\npart_number = "CV-7"\nrevision = "B"\nserial = { pattern = "V-##" }\n[[limit]]\nphase = "step"\nmetric = "rmse"\nlimit = { max = "0.6 bar" }\n`);
writeFileSync(join(folder, "ask.toml"), readFileSync(join(folder, "short.toml"), "utf8").replace('name = "short"', 'name = "ask"') + `
[[setup]]
name = "mounted"
prompt = { text = "Is the hose tight?", picture = "hose.png" }
[[setup]]
name = "oil"
prompt = { text = "Oil temperature", answer.number = { unit = "degC", limit = { min = "35 degC", max = "45 degC" } } }
[[teardown]]
name = "leak"
prompt = { text = "Does it leak?", answer.choice = { options = ["dry", "damp", "drips"], accept = ["dry"] } }
`);
// The smallest PNG: one pixel.
writeFileSync(join(folder, "hose.png"), Buffer.from("iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNkYPhfDwAChwGA60e6kgAAAABJRU5ErkJggg==", "base64"));
const port = 15020 + Math.floor(Math.random() * 2000);
writeFileSync(join(folder, "bench.toml"), `schema = "hil.station/1"
id = "bench 7"
store = "records"
models = ["paper"]
[[operator_badge]]
badge = "4711"
name = "early shift"
[[product]]
id = "cv7"
title = "CV-7"
plan = "short.toml"
limits = "part.toml"
driver = "patient.toml"
[[product]]
id = "ask"
title = "Asks"
plan = "ask.toml"
driver = "patient.toml"
[[site]]
name = "left"
tcp = "127.0.0.1:${port}"
[[site]]
name = "right"
emulate = "paper"
`);
let device = null;
async function mount(valve) {
  if (device) { device.kill("SIGKILL"); await ended(device); }
  device = (await begin(["emulate", "--valve", valve, "--driver", "emulator-tcp", "--tcp", `127.0.0.1:${port}`], /emulated driver/)).child;
}
await mount("paper");
const started = performance.now();
const station = await begin(["station", "bench.toml", "--listen", "127.0.0.1:0", "--viewer-token"], /viewers: (\S+)\n/);
const address = station.text().match(/: (http\S+)\n/)[1], viewers = station.found[1], root = address.split("#")[0].replace(/\/$/, "");

const browser = await chromium.launch({ executablePath: process.env.CHROMIUM || "/usr/bin/chromium", args: ["--no-sandbox", "--disable-gpu"] });
const errors = [];
async function open(url, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1400, height: 900 }, locale: "en-US", ...options }), page = await context.newPage();
  page.on("pageerror", (e) => errors.push(e.message));
  page.on("console", (m) => m.type() === "error" && !/ERR_CONNECTION|status of 409|Failed to load resource/.test(m.text()) && errors.push(m.text()));
  page.on("request", (r) => r.url().startsWith(root) || r.url().startsWith("data:") || errors.push(`fetched ${r.url()}`));
  await page.goto(url);
  return page;
}
const page = await open(address);
await page.waitForSelector("#serial");
check("a page that can start a valve within a second of the start", true);
console.log(`from the start of the program to the page: ${Math.round(performance.now() - started)} ms, the browser's own start among them`);
check("the token leaves the address bar", !page.url().includes(address.split("#")[1]));
const cookies = await page.context().cookies();
check("the cookie is HttpOnly and SameSite=Strict", cookies.length === 1 && cookies[0].httpOnly && cookies[0].sameSite === "Strict");
const seers = [await open(viewers), await open(viewers, { colorScheme: "dark", viewport: { width: 480, height: 900 }, locale: "de-DE" })];
for (const seer of seers) {
  await seer.waitForSelector(".site");
  check("a viewer has nothing to act with", (await seer.locator("#serial, .stop").count()) === 0);
}

// Everything from here on is typed, as a scanner and a keyboard do.
const keys = page.keyboard, card = (k) => page.locator(".site").nth(k);
const scan = async (text) => { await keys.type(text); await keys.press("Enter"); };
const said = async (text) => { await page.waitForFunction((t) => document.getElementById("said").textContent.includes(t), text, { timeout: 5000 }).catch(() => {}); const now = await page.locator("#said").textContent(); check(`it says: ${text}`, now.includes(text), now); };
const light = (k, name) => page.waitForSelector(`.site:nth-child(${k + 1})[data-light="${name}"]`, { timeout: 20000 });
const verdict = async (k, outcome) => {
  await page.waitForSelector(`.site:nth-child(${k + 1}) .word`, { timeout: 30000 }).catch(() => {});
  const found = await card(k).locator(".word").getAttribute("class").catch(() => "none");
  check(`the verdict is ${outcome}`, found === `word ${outcome}`, `${found} ${await card(k).innerText()}`);
};
const place = async (k) => { while (!(await card(k).evaluate((n) => n.classList.contains("chosen")))) { await page.locator(".pick[aria-pressed=false]").first().focus(); await keys.press("Enter"); } };

check("whoever is not known is asked first", await page.evaluate(() => document.activeElement.id) === "operator");
await scan("0815");
await scan("V-01");
await said("not one of this station");
await page.locator("#operator").focus();
await keys.press("Control+a");
await scan("4711");
check("the badge leads to the serial number", await page.evaluate(() => document.activeElement.id) === "serial");
await scan("X-99");
await said("not of the form");
await scan("V-01");
await said("V-01 on left: Enter starts");
await page.screenshot({ path: join(folder, "ready-1400.png") });
await keys.press("Enter");
await light(0, "running");
await sleep(900);
await page.screenshot({ path: join(folder, "running-1400.png") });
check("the field waits for the next serial number while a valve runs", await page.evaluate(() => document.activeElement.id) === "serial");
await verdict(0, "PASS");
check("what comes next is said", (await card(0).innerText()).includes("Scan the next"));
check("the verdict and the field of the next serial number are on one screen", await page.evaluate(() => ["#serial", ".word"].every((s) => { const b = document.querySelector(s).getBoundingClientRect(); return b.top >= 0 && b.bottom <= innerHeight; })));
check("a verdict is some 3 cm high on a screen of 96 dpi", await card(0).locator(".word").evaluate((n) => n.getBoundingClientRect().height) > 70);
await page.screenshot({ path: join(folder, "pass-1400.png") });
await page.evaluate(() => document.activeElement.blur());
await place(0);
await scan("V-01");
await said("has passed in this batch already");

// One fails, and is tested again. A reload in the middle of its run loses nothing.
await mount("slow.toml");
await place(0);
await scan("V-02");
await said("V-02 on left: Enter starts");
await keys.press("Enter");
await light(0, "running");
await sleep(700);
await page.reload();
await page.waitForSelector(".site .stop:visible");
check("after a reload the operator is still there", await page.inputValue("#operator") === "4711");
await verdict(0, "FAIL");
check("what is outside its limits is named", (await card(0).innerText()).includes("step/rmse"));
await page.screenshot({ path: join(folder, "fail-1400.png") });
await mount("paper");
await place(0);
await scan("V-02");
await said("This is attempt 2");
await keys.press("Enter");
await light(0, "running");
await verdict(0, "PASS");

// One is stopped.
await place(0);
await scan("V-03");
await said("V-03 on left: Enter starts");
await keys.press("Enter");
await light(0, "running");
await sleep(600);
await place(0);
await keys.press("Escape");
await verdict(0, "ABORTED");
check("the safe state is confirmed on the page", (await card(0).innerText()).includes("Safe state confirmed"));
await page.screenshot({ path: join(folder, "stopped-1400.png") });

// One loses its device, while the other site tests on.
await place(1);
await scan("V-05");
await said("V-05 on right: Enter starts");
await keys.press("Enter");
await light(1, "running");
await place(0);
await scan("V-04");
await said("V-04 on left: Enter starts");
await keys.press("Enter");
await light(0, "running");
device.kill("SIGKILL");
await ended(device);
device = null;
await verdict(0, "ERROR");
check("a current that nobody saw go is said", (await card(0).innerText()).includes("SAFE STATE NOT CONFIRMED"), await card(0).innerText());
await verdict(1, "PASS");
await page.screenshot({ path: join(folder, "unsafe-1400.png"), fullPage: true });
await place(0);
await scan("V-04");
await said("remove its power");
await page.locator(".alarm button").focus();
await keys.press("Enter");
await light(0, "idle");
await mount("paper");
await place(0);
await scan("V-04");
await said("This is attempt 2");
await keys.press("Enter");
await light(0, "running");
await verdict(0, "PASS");

// What was seen by the others, and what is stored.
for (const seer of seers) check("a viewer sees the same verdicts", (await seer.locator(".word.PASS").count()) === 2, await seer.locator(".sites").innerText());
check("nothing hangs over the edge at 480 px", await seers[1].evaluate(() => document.documentElement.scrollWidth <= innerWidth));
await seers[1].screenshot({ path: join(folder, "viewer-480-dark.png"), fullPage: true });
const batch = readdirSync(join(folder, "records")).find((n) => n.startsWith("cv7-"));
const history = JSON.parse(execFileSync(hil, ["history", join(folder, "records"), "--format", "json"]).toString()).attempts.map((a) => `${a.serial} ${a.attempt} ${a.outcome}`);
const wanted = ["V-01 1 PASS", "V-02 1 FAIL", "V-02 2 PASS", "V-03 1 ABORTED", "V-04 1 ERROR", "V-05 1 PASS", "V-04 2 PASS"];
check("the store holds every attempt", JSON.stringify([...history].sort()) === JSON.stringify([...wanted].sort()), JSON.stringify(history));
const record = JSON.parse(readFileSync(join(folder, "records", batch, "valves/V-03/attempt-1/record.json"), "utf8"));
check("the operator is in the record", record.provenance.station.operator === "early shift", JSON.stringify(record.provenance));
check("who stopped it is in the record", record.reasons.includes("stopped by the operator") && record.safe_state.confirmed, JSON.stringify(record.reasons));

// The engineer's view, the history, the reports; no serious fault of accessibility on any screen.
const axe = readFileSync(new URL("./node_modules/axe-core/axe.min.js", import.meta.url), "utf8");
async function accessible(page, what) {
  await page.evaluate(axe);
  const found = await page.evaluate(() => axe.run({ resultTypes: ["violations"] }).then((r) => r.violations.filter((v) => ["serious", "critical"].includes(v.impact)).map((v) => `${v.id}: ${v.nodes.map((n) => n.target).join(" ")} ${v.nodes[0].failureSummary}`)));
  check(`${what}: no serious fault of accessibility`, found.length === 0, found.join("\n"));
}
await accessible(page, "operator");
await accessible(seers[1], "viewer, dark");
for (const [view, wait] of [["engineer", "meter, .tile"], ["history", "tbody tr"]]) {
  await page.locator(`nav a[href="#${view}"]`).focus();
  await keys.press("Enter");
  await page.waitForSelector(wait);
  await sleep(300);
  await accessible(page, view);
  await page.screenshot({ path: join(folder, `${view}-1400.png`), fullPage: true });
  await page.setViewportSize({ width: 480, height: 900 });
  await sleep(200);
  check(`${view}: nothing hangs over the edge at 480 px`, await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth));
  await page.screenshot({ path: join(folder, `${view}-480.png`), fullPage: true });
  await page.setViewportSize({ width: 1400, height: 900 });
}
const opening = page.context().waitForEvent("page");
await page.locator("tbody a").first().click();
const report = await opening;
await report.waitForSelector("figure.plot");
check("a record shows its report", (await report.locator("h1").first().innerText()) === "short");
check("a report can ask the station for nothing", await report.evaluate(() => fetch("/api/records").then(() => false, () => true)));
await page.goto(`${root}/#operate`);
await page.setViewportSize({ width: 480, height: 900 });
await page.waitForSelector("#serial");
await sleep(300);
check("operator: nothing hangs over the edge at 480 px", await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth));
await page.screenshot({ path: join(folder, "operator-480.png"), fullPage: true });
await page.setViewportSize({ width: 1400, height: 900 });

// On a wall: all of it is seen without scrolling, and the verdict grows with the screen.
for (const [width, height] of [[2560, 1440], [3840, 2160]]) {
  await page.setViewportSize({ width, height });
  await sleep(300);
  const seen = await page.evaluate(() => ({ over: document.documentElement.scrollWidth > innerWidth, end: Math.max(...[...document.querySelectorAll(".site .word")].map((n) => n.getBoundingClientRect().bottom)), word: document.querySelector(".word").getBoundingClientRect().height, wide: document.querySelector(".sites").getBoundingClientRect().width }));
  check(`${width} x ${height}: fills the wall, and the verdicts are on it`, !seen.over && seen.end <= height && seen.word > 0.06 * height && seen.wide > 0.8 * width, JSON.stringify(seen));
  await page.screenshot({ path: join(folder, `operator-${width}.png`) });
}
await page.setViewportSize({ width: 1400, height: 900 });

// The same operator in German: what the program refuses is told in German.
const german = await open(address, { locale: "de-DE" });
await german.waitForSelector("#serial");
await german.fill("#operator", "4711");
await german.locator("#operator").press("Enter");
for (const [typed, answer] of [["X-99", "„X-99“ hat nicht die Form „V-##“"], ["V-01", "hat in dieser Charge schon bestanden"]]) {
  await german.fill("#serial", typed);
  await german.locator("#serial").press("Enter");
  await german.waitForFunction((t) => document.getElementById("said").textContent.includes(t), answer, { timeout: 5000 }).catch(() => {});
  check(`German: ${answer}`, (await german.locator("#said").innerText()).includes(answer), await german.locator("#said").innerText());
}
await german.locator('nav a[href="#engineer"]').click();
await german.waitForFunction(() => document.querySelector(".log")?.textContent.includes("vom Bediener gestoppt"), undefined, { timeout: 5000 }).catch(() => {});
check("German: the log", (await german.locator(".log").innerText()).includes("vom Bediener gestoppt"), await german.locator(".log").innerText());
await german.context().close();

// A plan that asks: answered by the keyboard, a wrong answer is told, what was answered is recorded.
await page.locator("#product").focus();
await keys.press("ArrowDown");
await scan("zz-0");
await said("zz-0 on");
check("a scan into the list of products is a serial number", await page.inputValue("#product") === "ask");
await place(1);
await scan("Q-1");
await said("Q-1 on right: Enter starts");
await keys.press("Enter");
await page.waitForSelector(".question img");
check("the picture is shown", await page.locator(".question img").evaluate((n) => n.decode().then(() => n.naturalWidth === 1, () => false)));
await page.screenshot({ path: join(folder, "question-1400.png") });
await accessible(page, "question");
check("a viewer sees the question and has nothing to answer with", await seers[0].locator(".question").count() === 1 && await seers[0].locator(".question button").count() === 0);
check("the answer has the focus", await page.evaluate(() => document.activeElement.textContent) === "Yes");
await keys.press("Enter");
await page.waitForSelector(".question input");
await page.waitForFunction(() => document.activeElement.matches(".question input"));
await scan("warm");
await page.waitForFunction(() => document.querySelector(".question .refused").textContent.includes("warm"));
await keys.press("Control+a");
await scan("40,5");
await page.waitForFunction(() => document.querySelector(".question")?.textContent.includes("leak"), undefined, { timeout: 20000 });
await keys.press("Tab");
await keys.press("Enter");
await verdict(1, "FAIL");
const asked = readdirSync(join(folder, "records")).find((n) => n.startsWith("ask-"));
const told = JSON.parse(readFileSync(join(folder, "records", asked, "valves/Q-1/attempt-1/record.json"), "utf8")).phases.flatMap((p) => p.prompt ? [[p.prompt.answer, p.prompt.by, p.outcome].join(" ")] : []);
check("the answers are in the record", JSON.stringify(told) === JSON.stringify(["yes page PASS", "40.5 degC page PASS", "damp page FAIL"]), JSON.stringify(told));

// A recording is dropped, and the diagnosis watched.
execFileSync(hil, ["init", "diagnosis", "--example", "diagnosis"], { cwd: folder, stdio: "ignore" });
await page.locator('nav a[href="#diagnosis"]').focus();
await keys.press("Enter");
await page.locator("#file").setInputFiles({ name: "..\\..\\evil.txt", mimeType: "text/plain", buffer: Buffer.from("x") });
await page.waitForFunction(() => document.querySelector(".drop .refused").textContent.includes(".csv"));
await page.locator("#file").setInputFiles(join(folder, "diagnosis/recordings/sweep.csv"));
await page.waitForSelector("tbody meter", { timeout: 120000 });
check("candidates are shown while it works", await page.locator("tbody meter").count() >= 1);
await page.waitForSelector('a[href^="/diagnosis/"], pre.refused', { timeout: 600000 });
await accessible(page, "diagnosis");
await page.screenshot({ path: join(folder, "diagnosis-1400.png"), fullPage: true });
const opened = page.context().waitForEvent("page");
await page.locator('a[href^="/diagnosis/"]').click();
const diagnosis = await opened;
await diagnosis.waitForSelector("figure.plot");
check("the page of the diagnosis is shown", (await diagnosis.locator("h1").count()) === 1);
await diagnosis.close();
await page.goto(`${root}/#operate`);
await page.waitForSelector("#serial");

// A hostile page: on another port of the same host, where even a strict cookie is sent, and in the same browser.
const hostile = createServer((_, response) => response.writeHead(200, { "content-type": "text/html" }).end("<!DOCTYPE html><title>x</title>"));
await new Promise((done) => hostile.listen(0, "127.0.0.1", done));
const evil = await page.context().newPage();
for (const host of ["127.0.0.1", "localhost"]) {
  await evil.goto(`http://${host}:${hostile.address().port}/`);
  const got = await evil.evaluate(async (root) => {
    const tried = {};
    const attempt = async (name, act) => { tried[name] = await act().catch(() => "refused"); };
    const entry = JSON.stringify({ site: 0, product: "cv7", serial: "V-66", operator: "4711" });
    for (const path of ["/api/me", "/api/records", "/api/events", "/batch"]) await attempt(`read ${path}`, () => fetch(root + path, { credentials: "include" }).then((r) => r.text()));
    await attempt("start, simple request", () => fetch(`${root}/api/start`, { method: "POST", mode: "no-cors", credentials: "include", headers: { "content-type": "text/plain" }, body: entry }).then((r) => r.type === "opaque" ? "refused" : r.text()));
    await attempt("stop, with the header", () => fetch(`${root}/api/stop`, { method: "POST", credentials: "include", headers: { "x-hil-act": "0" }, body: "{\"site\":0}" }).then((r) => r.text()));
    await attempt("script", () => new Promise((done, wrong) => { const s = document.createElement("script"); s.src = `${root}/api/records`; s.onload = () => done("loaded"); s.onerror = wrong; document.head.append(s); }));
    await attempt("stream", () => new Promise((done, wrong) => { const e = new EventSource(`${root}/api/events`, { withCredentials: true }); e.onmessage = e.onopen = () => done("open"); e.onerror = wrong; }));
    await attempt("frame", () => new Promise((done) => { const f = document.createElement("iframe"); f.src = `${root}/`; f.onload = () => { try { done(f.contentDocument?.body?.innerText ? "read" : "refused"); } catch { done("refused"); } }; document.body.append(f); }));
    await attempt("form", () => { const f = document.createElement("form"); f.method = "post"; f.action = `${root}/api/close`; f.enctype = "text/plain"; f.target = "_blank"; document.body.append(f); f.submit(); return Promise.resolve("refused"); });
    return tried;
  }, root);
  for (const [what, result] of Object.entries(got)) check(`a hostile page on ${host} may not: ${what}`, result === "refused", String(result).slice(0, 80));
}
await sleep(500);
const now = 1 + wanted.length, after = JSON.parse(execFileSync(hil, ["history", join(folder, "records"), "--format", "json"]).toString()).attempts.length;
check("a hostile page has started and closed nothing", after === now && (await page.locator('.site[data-light="running"], .site[data-light="waiting"]').count()) === 0);
hostile.close();
await evil.close();

// The station goes away, and comes back.
let gone = null;
const end = ended(station.child).then((code) => { gone = performance.now(); return code; });
station.child.kill("SIGTERM");
await page.waitForSelector("#lost:not([hidden])", { timeout: 5000 });
const seen = gone === null ? 0 : performance.now() - gone;
check("a lost connection is shown within a second", seen < 1000, `${seen} ms`);
check("the station ends in order", (await end) === 0);
check("the reports of the batch are written", existsSync(join(folder, "records", batch, "report.html")));
const again = await begin(["station", "bench.toml", "--listen", root.replace("http://", "")], /: (http\S+)\n/);
await page.waitForSelector("#token", { timeout: 8000 });
check("a station with a new token asks for it", true);
await page.locator("#token").fill(again.found[1].split("#")[1]);
await keys.press("Enter");
await page.waitForSelector("#serial");
await page.locator("#operator").focus();
await keys.press("Control+a");
await scan("4711");
await scan("V-01");
await said("has passed");
check("no error of the scripts, and nothing fetched from elsewhere", errors.length === 0, errors.join("; "));

await browser.close().catch(() => {});
for (const child of running) child.kill("SIGTERM");
await Promise.all(running.map(ended));
console.log(`${passed} passed, ${failed} failed`);
process.exit(failed ? 1 : 0);
