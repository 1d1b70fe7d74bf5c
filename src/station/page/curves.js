// Live curves of one site: pressure and reference above, current below. Samples come as they are measured; the screen is drawn
// when the browser has a frame to spare.
import { t } from "./texts.js";
import { h } from "./dom.js";

let drawn = 0;
const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export class Curves {
  constructor(height = 220) {
    this.element = h("div", { class: "curves", role: "img", "aria-label": t("curves") });
    this.height = height;
    this.plots = [];
    this.clear(0);
    new ResizeObserver(() => this.resize()).observe(this.element);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { this.drop(); this.draw(); });
  }

  clear(run) {
    this.run = run;
    this.n = 0;
    this.t = []; this.p = []; this.g = []; this.c = []; this.m = []; this.l = []; this.f = [];
    this.bad = 0;
    this.want();
  }

  // Columns of samples; those that were seen already are left out.
  add(columns, anew) {
    if (columns.r !== this.run || anew) this.clear(columns.r);
    for (let k = 0; k < columns.n.length; k++) {
      if (columns.n[k] <= this.n) continue;
      this.n = columns.n[k];
      this.t.push(columns.t[k]); this.p.push(columns.p[k]); this.g.push(columns.g[k]);
      this.c.push(columns.c[k]); this.m.push(columns.m[k]); this.l.push(columns.l[k]); this.f.push(columns.f[k]);
      if (!columns.q[k]) this.bad++;
    }
    this.want();
  }

  want() {
    if (this.wanted) return;
    this.wanted = true;
    requestAnimationFrame(() => { this.wanted = false; this.draw(); });
  }

  draw() {
    if (!this.element.isConnected || !this.element.clientWidth) return;
    if (!this.plots.length) this.make();
    this.plots[0].setData([this.t, this.p, this.g]);
    this.plots[1].setData([this.t, this.c, this.m]);
    document.documentElement.dataset.drawn = ++drawn;
  }

  make() {
    const axis = { stroke: color("--soft"), grid: { stroke: color("--grid"), width: 1 }, ticks: { stroke: color("--grid"), width: 1 }, font: "12px system-ui", size: 44 };
    const plot = (series, height, last) => new uPlot({
      width: this.element.clientWidth, height, padding: [6, 8, 0, 0],
      scales: { x: { time: false }, y: { range: (u, low, high) => uPlot.rangeNum(Math.min(low ?? 0, 0), Math.max(high ?? 1, last ? 0.1 : 1), 0.05, true) } },
      axes: [{ ...axis, show: last, size: 30 }, axis], legend: { show: false }, cursor: { show: false }, series: [{}, ...series],
    }, [[], [], []], this.element);
    const line = (name, width, dash) => ({ stroke: color(name), width, dash, spanGaps: false, points: { show: false } });
    this.plots = [
      plot([line("--measured", 2), line("--reference", 1.5, [6, 4])], this.height, false),
      plot([line("--feedback", 2), line("--soft", 1, [2, 3])], Math.round(this.height * 0.55), true),
    ];
    this.element.append(h("p", { class: "key", "aria-hidden": "true" },
      h("span", { class: "line measured" }, t("pressure")), h("span", { class: "line reference" }, t("reference")), h("span", { class: "line command" }, t("current"))));
  }

  drop() {
    this.plots.forEach((plot) => plot.destroy());
    this.plots = [];
    this.element.replaceChildren();
  }

  resize() {
    const width = this.element.clientWidth;
    if (!width) return;
    if (!this.plots.length) return this.draw();
    for (const plot of this.plots) if (plot.width !== width) plot.setSize({ width, height: plot.height });
  }
}
