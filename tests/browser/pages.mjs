// Makes every kind of page with the program that is named, opens it in Chromium, and uses it: zooms, reads, toggles, sorts,
// takes data away; at three widths, light and dark, and as it is printed. Pictures stay in the folder that is named.
// Usage: node pages.mjs HIL FOLDER
import { chromium } from "playwright-core";
import { execFileSync } from "node:child_process";
import { existsSync, mkdirSync, readFileSync, rmSync, statSync } from "node:fs";
import { join, resolve } from "node:path";

const hil = resolve(process.argv[2]), folder = resolve(process.argv[3]);
rmSync(folder, { recursive: true, force: true });
mkdirSync(folder, { recursive: true });
const run = (...args) => {
  try { return execFileSync(hil, args, { cwd: folder, stdio: ["ignore", "pipe", "pipe"] }).toString(); } catch (e) {
    // 1 is a verdict, and as good a page as any.
    if (e.status !== 1) throw new Error(`hil ${args.join(" ")}: ${e.status}\n${e.stderr}`);
  }
};
let passed = 0, failed = 0;
const check = (what, ok, more = "") => { if (ok) passed++; else { failed++; console.log(`FAILED ${what} ${more}`); } };

run("run", "tipin", "--sim", "--out", "run");
run("init", ".", "--example", "diagnosis");
run("identify", "recordings/sweep.csv", "-o", "valves/valve.toml", "--report", "identify.html");
run("inspect", "recordings/logger.csv", "-o", "log.map.toml");
run("diagnose", "recordings/logger.csv", "--mapping", "log.map.toml", "--model", "valve", "-o", "valves/augmented.toml", "--report", "diagnose.html");
run("batch", "tipin", "--valve", "paper", "--count", "400", "--sim", "--population", "population", "--out", "batch");
run("diagnose", "recordings/sweep.csv", "--map", "current_a=1000 * current_a", "--model", "valve", "--report", "strangers.html");
run("compare", "run", "valve", "augmented", "-o", "compare.html");
// The largest weight of a page [bytes].
const pages = {
  run: ["run/report.html", 1.0e6], identify: ["identify.html", 1.5e6], diagnose: ["diagnose.html", 1.5e6],
  batch: ["batch/report.html", 2.0e6], compare: ["compare.html", 1.5e6], strangers: ["strangers.html", 1.5e6],
};

const browser = await chromium.launch({ executablePath: process.env.CHROMIUM || "/usr/bin/chromium", args: ["--no-sandbox", "--disable-gpu"] });
for (const [name, [file, largest]] of Object.entries(pages)) {
  const path = join(folder, file), url = "file://" + path, weight = statSync(path).size;
  console.log(`${name}: ${weight} bytes`);
  check(`${name}: weight`, weight <= largest, `${weight} > ${largest}`);
  for (const width of [1400, 768, 480]) for (const scheme of width === 768 ? ["light"] : ["light", "dark"]) {
    const context = await browser.newContext({ viewport: { width, height: 900 }, colorScheme: scheme, hasTouch: width === 480, acceptDownloads: true });
    const page = await context.newPage(), what = `${name} at ${width} ${scheme}`, errors = [], fetched = [];
    page.on("pageerror", (e) => errors.push(e.message));
    page.on("console", (m) => m.type() === "error" && errors.push(m.text()));
    page.on("request", (r) => r.url().startsWith("file:") || r.url().startsWith("blob:") || r.url().startsWith("data:") || fetched.push(r.url()));
    await page.goto(url);
    await page.screenshot({ path: join(folder, `${name}-${width}-${scheme}.png`), fullPage: true });
    const wide = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
    check(`${what}: nothing hangs over the edge`, wide <= 0, `${wide} px`);
    const badge = page.locator("header.top .badge").last();
    if (await badge.count()) { const box = await badge.boundingBox(); check(`${what}: the verdict is on the first screen`, box.x >= 0 && box.x + box.width <= width && box.y < 900, JSON.stringify(box)); }
    for (const verdict of await page.locator("table.verdicts td.verdict").all()) { const box = await verdict.boundingBox(); if (!box || box.x + box.width > width) { check(`${what}: a row's verdict is on the screen`, false, JSON.stringify(box)); break; } }
    const hidden = await page.evaluate(() => [...document.querySelectorAll("table.heat td.cell, table.tried td, table.pareto td")].filter((n) => n.checkVisibility() && n.getBoundingClientRect().right > innerWidth).length);
    check(`${what}: every place of the error and every reason is on the screen`, hidden === 0, `${hidden} cells`);
    const covered = await page.evaluate(() => [...document.querySelectorAll("figure.plot")].filter((n) => {
      if (!n.checkVisibility()) return false;
      const label = n.querySelector(".y-label span").getBoundingClientRect();
      return [...n.querySelectorAll(".y-ticks span")].some((t) => { const r = t.getBoundingClientRect(); return r.left < label.right - 1 && r.bottom > label.top && r.top < label.bottom; });
    }).map((n) => n.querySelector(".title").textContent));
    check(`${what}: no value stands on the name of its axis`, covered.length === 0, covered.join("; "));
    await use(page, what, width === 480);
    check(`${what}: no error of the script`, errors.length === 0, errors.join("; "));
    check(`${what}: nothing is fetched`, fetched.length === 0, fetched.join("; "));
    await context.close();
  }
  await print(name, url);
}
await browser.close().catch(() => {});
console.log(`${passed} passed, ${failed} failed`);
process.exit(failed ? 1 : 0);

async function use(page, what, touch) {
  const figure = page.locator("figure.plot").first(), area = figure.locator(".area");
  await area.scrollIntoViewIfNeeded();
  const box = await area.boundingBox(), ticks = (axis) => figure.locator(`.${axis}-ticks`).innerText();
  const plain = [await ticks("x"), await ticks("y")];
  if (touch) await page.touchscreen.tap(box.x + box.width / 2, box.y + box.height / 2);
  else await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  const read = await figure.locator(".readout").innerText().catch(() => "");
  const unit = ((await figure.getAttribute("data-y-label")).match(/\[(.*)\]/) || ["", ""])[1];
  check(`${what}: ${touch ? "a tap" : "pointing"} reads values with their unit`, read.includes(unit) && /\d/.test(read), JSON.stringify(read));
  if (!touch) {
    const drag = async (x0, y0, x1, y1) => {
      const b = await area.boundingBox();
      await page.mouse.move(b.x + x0 * b.width, b.y + y0 * b.height); await page.mouse.down();
      await page.mouse.move(b.x + (x0 + x1) / 2 * b.width, b.y + (y0 + y1) / 2 * b.height); await page.mouse.move(b.x + x1 * b.width, b.y + y1 * b.height); await page.mouse.up();
    };
    await drag(0.4, 0.5, 0.5, 0.5);
    check(`${what}: a drag across zooms`, (await ticks("x")) !== plain[0], await ticks("x"));
    const across = await ticks("y");
    check(`${what}: the values follow what is seen`, (await figure.evaluate((n) => n.querySelector("svg").viewBox.baseVal.height)) < 1e5 || across !== plain[1]);
    await drag(0.5, 0.2, 0.5, 0.6);
    check(`${what}: a drag up zooms the values`, (await ticks("y")) !== across);
    await area.dblclick();
    check(`${what}: a double click shows all`, (await ticks("x")) === plain[0] && (await ticks("y")) === plain[1], await ticks("y"));
    await area.focus(); await page.keyboard.press("ArrowRight");
    check(`${what}: the keyboard reads`, (await figure.locator(".readout").count()) === 1);
    await page.keyboard.press("+");
    check(`${what}: the keyboard zooms`, (await ticks("x")) !== plain[0]);
    await page.keyboard.press("0");
  } else {
    await figure.locator(".tools button", { hasText: "+" }).tap();
    check(`${what}: a button zooms`, (await ticks("x")) !== plain[0]);
    await figure.locator(".tools button", { hasText: "all" }).tap();
  }
  const key = page.locator("figure.plot .legend .key").first();
  if (await key.count()) {
    const off = () => page.locator("figure.plot path.off").count();
    await key.focus(); await page.keyboard.press("Enter");
    check(`${what}: a key of the legend hides its line`, (await off()) > 0 && (await key.getAttribute("aria-pressed")) === "false");
    await key.click();
    check(`${what}: and shows it again`, (await off()) === 0);
  }
  const heads = page.locator("table.sortable thead th");
  if (await heads.count()) {
    const table = page.locator("table.sortable").last(), number = table.locator("thead th.num").last();
    if (await number.count()) {
      await number.click();
      const k = await number.evaluate((n) => n.cellIndex);
      const values = (await table.locator(`tbody tr td:nth-child(${k + 1})`).allInnerTexts()).map(parseFloat).filter((v) => !isNaN(v));
      check(`${what}: a heading sorts`, values.length > 1 && values.every((v, i) => i === 0 || v >= values[i - 1]), values.slice(0, 5).join(" "));
    }
  }
  for (const [label, test] of [["CSV", (t) => t.startsWith("#") && t.split("\n").length > 3 && !t.includes("NaN")], ["SVG", (t) => t.startsWith("<svg") && t.includes("</svg>") && t.includes("<path") && page.evaluate((x) => !new DOMParser().parseFromString(x, "image/svg+xml").querySelector("parsererror"), t)], ["PNG", (t) => t.slice(1, 4) === "PNG"]]) {
    const waiting = page.waitForEvent("download", { timeout: 20000 }).catch(() => null);
    await figure.locator(".tools button", { hasText: label }).click();
    const download = await waiting;
    if (!download) { check(`${what}: the figure as ${label}`, false, "nothing came"); continue; }
    check(`${what}: the figure as ${label}`, await test(readFileSync(await download.path(), label === "PNG" ? "latin1" : "utf8")));
  }
}

// A4 without its margins, 186 mm: no table may be wider.
async function print(name, url) {
  const context = await browser.newContext({ viewport: { width: 703, height: 1000 } }), page = await context.newPage();
  await page.emulateMedia({ media: "print" });
  await page.goto(url);
  const cut = await page.evaluate(() => [...document.querySelectorAll("table, figure, dl")].filter((n) => n.checkVisibility() && (n.getBoundingClientRect().right > innerWidth + 1 || n.scrollWidth > n.clientWidth + 1)).map((n) => n.tagName + " " + n.className + " " + n.getBoundingClientRect().right));
  check(`${name} printed: no column is cut`, cut.length === 0, cut.join("; "));
  const broken = await page.evaluate(() => [...document.querySelectorAll("td.num")].filter((n) => {
    if (!n.checkVisibility() || n.firstChild?.nodeType !== 3) return false;
    const range = document.createRange(); range.selectNodeContents(n.firstChild);
    return new Set([...range.getClientRects()].map((r) => Math.round(r.top))).size > 1;
  }).map((n) => n.firstChild.textContent));
  check(`${name} printed: no figure is broken over two lines`, broken.length === 0, broken.slice(0, 5).join("; "));
  await page.pdf({ path: join(folder, `${name}.pdf`), preferCSSPageSize: true, printBackground: true });
  check(`${name} printed: a document`, existsSync(join(folder, `${name}.pdf`)));
  await context.close();
}
