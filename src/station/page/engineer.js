// What a test engineer sees: the loop, its timing, the log, the batch with its charts, every record.
import { t, told } from "./texts.js";
import { clock, fill, h, number, s, say } from "./dom.js";
import { get, link, post } from "./link.js";
import { table } from "./history.js";

export function engineer(main, curves) {
  let site = 0, wanted = false, shown = "";
  const canvas = h("canvas", { role: "img" });
  const chooser = h("select", { id: "which", onchange: () => { site = Number(chooser.value); want(); } });
  const timing = h("dl", { class: "facts" }), log = h("ol", { class: "log", tabindex: 0, "aria-label": t("log") }), batch = h("div"), records = h("div");
  fill(main, h("h2", { class: "out-of-sight" }, t("engineer")),
    h("div", { class: "columns" },
      h("section", { class: "card" }, h("div", { class: "head" }, h("h3", {}, t("loop")), h("label", { for: "which" }, t("site")), chooser), canvas),
      h("section", { class: "card" }, h("h3", {}, t("timing")), timing, h("h3", {}, t("log")), log)),
    h("section", { class: "card" }, h("div", { class: "head" }, h("h3", {}, t("batch"))), batch),
    h("section", { class: "card" }, h("h3", {}, t("records")), records));

  function want() {
    if (!wanted) { wanted = true; requestAnimationFrame(() => { wanted = false; draw(); }); }
  }

  const sorted = (values) => values.filter((v) => v !== null).sort((a, b) => a - b);
  function draw() {
    const course = curves[site];
    if (!course || !canvas.isConnected) return;
    loop(canvas, course.c, course.p);
    canvas.setAttribute("aria-label", t("loop_help", link.board.sites[site]?.name ?? ""));
    const late = sorted(course.l), at = (q) => late[Math.min(late.length - 1, Math.ceil(q * late.length) - 1)];
    const fact = (name, value) => [h("dt", {}, t(name)), h("dd", {}, value)];
    const simulated = late.length && late[late.length - 1] === 0;
    fill(timing, fact("samples", number(course.n, 0)), fact("not_good", number(course.bad, 0)),
      simulated ? h("dd", {}, t("of_simulation")) : [fact("late_p50", `${number(at(0.5), 3)} ms`), fact("late_p99", `${number(at(0.99), 3)} ms`), fact("late_max", `${number(late[late.length - 1], 3)} ms`)]);
  }

  async function refresh() {
    if (!link.there) return;
    const open = link.board.batch;
    const figures = open ? await get("/api/figures").catch((e) => e) : null;
    if (!batch.isConnected) return;
    fill(batch, !open ? h("p", {}, t("no_batch")) : [
      h("p", {}, h("b", {}, open.name), " ", open.origin === "real" ? null : h("span", { class: "origin" }, t(open.origin)), " ",
        h("a", { href: "/batch", target: "_blank", rel: "noopener" }, t("batch_page")), " ",
        link.role === "operator" ? h("button", { type: "button", class: "plain", onclick: () => post("/api/close").then(refresh, () => {}) }, t("close_batch")) : null),
      figures instanceof Error ? h("p", {}, t("nothing_tested")) : of_batch(figures)]);
  }
  async function list() {
    const now = JSON.stringify(link.board.sites.map((s) => s.verdict?.record));
    if (now === shown) return;
    shown = now;
    const found = await get("/api/records").catch(() => null);
    if (found) fill(records, table(found.attempts.slice(0, 200)));
  }
  const timer = setInterval(refresh, 3000);
  let verdicts = "";
  return {
    board(board) {
      if (chooser.options.length !== board.sites.length) fill(chooser, board.sites.map((s, k) => h("option", { value: k }, s.name)));
      fill(log, [...board.log].reverse().slice(0, 60).map((l) => h("li", {}, h("time", {}, clock(l.at)), ` ${l.site === null ? "" : `${board.sites[l.site].name}: `}${told(l.text)}`)));
      const now = JSON.stringify([board.batch, board.sites.map((s) => s.verdict?.record)]);
      if (now !== verdicts) { verdicts = now; refresh(); }
      list();
      want();
    },
    samples: (which) => which === site && want(),
    gone: () => clearInterval(timer),
  };
}

function of_batch(f) {
  const share = (finding) => finding.value ? `${number(100 * finding.value.share, 1)} %` : "–";
  const of = (finding) => finding.value ? t("of", finding.value.passed, finding.value.count) : "";
  const tile = (name, finding) => h("div", { class: "tile" }, h("span", {}, t(name)), h("b", {}, share(finding)), h("span", {}, of(finding)));
  return [
    h("div", { class: "tiles" }, tile("first_pass", f.first_pass), tile("final_yield", f.final_yield),
      Object.entries(f.counts).map(([outcome, count]) => h("div", { class: "tile" }, h("span", {}, t(outcome)), h("b", {}, count)))),
    f.pareto.length ? [h("h4", {}, t("failures")), pareto(f.pareto)] : null,
    h("h4", {}, t("charts")), h("div", { class: "charts" }, f.metrics.map(chart)),
  ];
}

function pareto(bars) {
  const most = bars[0].count;
  return h("div", { class: "wide", tabindex: 0 }, h("table", {}, h("thead", {}, h("tr", {}, ["cause", "count", "share"].map((c) => h("th", { scope: "col" }, t(c))))),
    h("tbody", {}, bars.slice(0, 10).map((bar) => h("tr", {}, h("td", {}, bar.cause), h("td", { class: "gauge" }, h("meter", { min: 0, max: most, value: bar.count, "aria-hidden": "true" }), ` ${bar.count}`), h("td", {}, `${number(100 * bar.cumulative, 0)} %`))))));
}

// The individuals of one metric with its control limits and its tolerance.
function chart(metric) {
  const values = metric.points.map((p) => p[1]), known = values.filter((v) => v !== null), limits = metric.chart.value, W = 420, H = 130;
  const lines = [metric.tolerance.min, metric.tolerance.max, limits?.lower, limits?.upper].filter((v) => v !== null && v !== undefined);
  const low = Math.min(...known, ...lines), high = Math.max(...known, ...lines), pad = (high - low || 1) * 0.08;
  const x = (k) => 8 + (W - 16) * (values.length > 1 ? k / (values.length - 1) : 0.5), y = (v) => H - 8 - (H - 16) * ((v - low + pad) / (high - low + 2 * pad));
  const across = (v, kind) => v === null || v === undefined ? null : s("line", { x1: 0, x2: W, y1: y(v), y2: y(v), class: kind });
  const path = values.map((v, k) => v === null ? "" : `${k && values[k - 1] !== null ? "L" : "M"}${x(k).toFixed(1)} ${y(v).toFixed(1)}`).join("");
  const d = (v) => number(v, 3);
  const words = limits ? t("chart_text", metric.name, d(limits.centre), d(limits.lower), d(limits.upper), d(metric.tolerance.min), d(metric.tolerance.max), metric.unit) : `${metric.name} [${metric.unit}]: ${t("no_chart")}`;
  return h("figure", {}, s("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": words },
    across(metric.tolerance.min, "tolerance"), across(metric.tolerance.max, "tolerance"), across(limits?.lower, "control"), across(limits?.upper, "control"), across(limits?.centre, "centre"),
    s("path", { d: path, class: "points" }), values.map((v, k) => v === null ? null : s("circle", { cx: x(k), cy: y(v), r: 2.5, class: "point" }))), h("figcaption", {}, words));
}

// Pressure over current on a canvas, the newest second on top.
function loop(canvas, current, pressure) {
  const style = getComputedStyle(document.documentElement), color = (name) => style.getPropertyValue(name).trim();
  const scale = devicePixelRatio || 1, W = canvas.clientWidth, H = Math.max(220, Math.min(360, W * 0.6));
  if (canvas.width !== Math.round(W * scale) || canvas.height !== Math.round(H * scale)) { canvas.width = Math.round(W * scale); canvas.height = Math.round(H * scale); }
  const g = canvas.getContext("2d");
  g.setTransform(scale, 0, 0, scale, 0, 0);
  g.clearRect(0, 0, W, H);
  const top = (values, least) => values.reduce((m, v) => v !== null && v > m ? v : m, least);
  const xs = nice(top(current, 0.1)), ys = nice(top(pressure, 1)), L = 40, B = 26;
  const x = (v) => L + (W - L - 12) * v / xs.end, y = (v) => H - B - (H - B - 10) * v / ys.end;
  g.font = "12px system-ui"; g.fillStyle = color("--soft"); g.strokeStyle = color("--grid"); g.lineWidth = 1;
  for (const v of xs.ticks) { g.beginPath(); g.moveTo(x(v), y(0)); g.lineTo(x(v), y(ys.end)); g.stroke(); g.textAlign = "center"; g.fillText(number(v, xs.digits), x(v), H - 8); }
  for (const v of ys.ticks) { g.beginPath(); g.moveTo(x(0), y(v)); g.lineTo(x(xs.end), y(v)); g.stroke(); g.textAlign = "right"; g.fillText(number(v, ys.digits), L - 6, y(v) + 4); }
  const draw = (from, stroke, width) => {
    g.strokeStyle = stroke; g.lineWidth = width; g.beginPath();
    let pen = false;
    for (let k = from; k < current.length; k++) {
      if (pressure[k] === null || current[k] === null) { pen = false; continue; }
      g[pen ? "lineTo" : "moveTo"](x(Math.max(0, current[k])), y(Math.max(0, pressure[k])));
      pen = true;
    }
    g.stroke();
  };
  draw(Math.max(0, current.length - 20000), color("--measured"), 1);
  draw(Math.max(0, current.length - 100), color("--feedback"), 2.5);
}

function nice(end) {
  const step = [1, 2, 5].map((f) => f * 10 ** Math.floor(Math.log10(end / 4))).find((d) => end / d <= 6) ?? 10 ** Math.ceil(Math.log10(end / 4));
  const ticks = [];
  for (let k = 0; k * step <= end * 1.0001; k++) ticks.push(k * step);
  return { end: Math.max(end, ticks[ticks.length - 1]), ticks, digits: Math.max(0, -Math.floor(Math.log10(step))) };
}
