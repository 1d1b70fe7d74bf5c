// Reads values under the pointer and zooms along the horizontal axis: drag to zoom, double-click to go back.
// Figures with the same horizontal axis move together. Without script the page shows the same figures, still.
(() => {
  const W = 20000, H = 10000;
  const num = (v) => { const a = Math.abs(v); return a !== 0 && (a < 1e-3 || a >= 1e5) ? v.toExponential(3) : v.toFixed(a < 1 ? 4 : a < 100 ? 3 : 1); };
  const figures = [...document.querySelectorAll("figure.plot")].map((node) => {
    const d = node.dataset, area = node.querySelector(".area");
    const f = { node, area, svg: area.querySelector("svg"), ticks: node.querySelector(".x-ticks"), label: d.xLabel,
      x0: +d.xFrom, x1: +d.xTo, xlog: d.xLog === "true", y0: +d.yFrom, y1: +d.yTo, ylog: d.yLog === "true", a: 0, b: 1 };
    f.x = (t) => f.xlog ? f.x0 * Math.pow(f.x1 / f.x0, t) : f.x0 + t * (f.x1 - f.x0);
    f.y = (t) => f.ylog ? f.y0 * Math.pow(f.y1 / f.y0, t) : f.y0 + t * (f.y1 - f.y0);
    f.place = (x) => f.xlog ? Math.log(x / f.x0) / Math.log(f.x1 / f.x0) : (x - f.x0) / (f.x1 - f.x0);
    f.plain = f.ticks.innerHTML;
    f.grid = f.svg.querySelector(".grid"); f.plainGrid = f.grid.getAttribute("d"); f.rows = (f.plainGrid.match(/M0 \d+H\d+/g) || []).join("");
    f.bands = [...area.querySelectorAll(".band-label[data-from]")];
    return f;
  });
  const points = (path) => {
    if (path.hil) return path.hil;
    const out = []; let x = 0, y = 0;
    for (const m of path.getAttribute("d").matchAll(/([Ml])(-?\d+) (-?\d+)/g)) {
      if (m[1] === "M") { x = +m[2]; y = +m[3]; } else { x += +m[2]; y += +m[3]; }
      out.push([x, y]);
    }
    return (path.hil = out);
  };
  const clear = () => document.querySelectorAll(".cursor, .readout").forEach((n) => n.remove());
  const nearest = (list, x) => {
    let low = 0, high = list.length - 1;
    while (high - low > 1) { const mid = (low + high) >> 1; if (list[mid][0] <= x) low = mid; else high = mid; }
    return Math.abs(list[low][0] - x) < Math.abs(list[high][0] - x) ? list[low] : list[high];
  };
  const show = (f, t) => {
    const cursor = document.createElement("div"); cursor.className = "cursor";
    const left = (t - f.a) / (f.b - f.a); cursor.style.left = 100 * left + "%";
    const box = document.createElement("div"); box.className = "readout";
    const line = (text, cls) => { const p = document.createElement("div"); if (cls) { p.className = cls; p.append(document.createElement("i")); } p.append(text); box.append(p); };
    line(f.label.replace(/ \[.*/, "") + " " + num(f.x(t)));
    for (const path of f.svg.querySelectorAll("path[data-name]")) {
      const list = points(path), name = path.dataset.name;
      if (!name || !list.length || path.classList.contains("s-area")) continue;
      if (list.some((p, i) => i && p[0] < list[i - 1][0])) continue;
      const p = nearest(list, t * W);
      if (Math.abs(p[0] - t * W) < 0.02 * W * (f.b - f.a) + 20) line(name + " " + num(f.y(1 - p[1] / H)), [...path.classList].find((c) => c.startsWith("c-")));
    }
    if (left < 0.6) box.style.left = `calc(${100 * left}% + 10px)`; else box.style.right = `calc(${100 * (1 - left)}% + 10px)`;
    f.area.append(cursor, box);
  };
  const zoom = (f, a, b) => {
    f.a = a; f.b = b; f.svg.setAttribute("viewBox", `${a * W} 0 ${(b - a) * W} ${H}`);
    for (const label of f.bands) {
      const from = (f.place(+label.dataset.from) - a) / (b - a), to = (f.place(+label.dataset.to) - a) / (b - a);
      const l = Math.max(0, Math.min(1, from)), r = Math.max(0, Math.min(1, to));
      label.style.left = 100 * l + "%"; label.style.width = 100 * (r - l) + "%";
    }
    f.area.querySelectorAll(".marker-label").forEach((n) => { n.style.visibility = a === 0 && b === 1 ? "" : "hidden"; });
    if (a === 0 && b === 1) { f.ticks.innerHTML = f.plain; f.grid.setAttribute("d", f.plainGrid); return; }
    f.ticks.textContent = "";
    const lo = f.x(a), hi = f.x(b), raw = (hi - lo) / 8, pow = Math.pow(10, Math.floor(Math.log10(raw)));
    const step = pow * [1, 2, 5, 10].find((k) => k * pow >= raw), digits = Math.max(0, -Math.floor(Math.log10(step * 1.000001)));
    let columns = "";
    for (let n = Math.ceil(lo / step); n * step <= hi; n++) {
      columns += `M${Math.round(f.place(n * step) * W)} 0V${H}`;
      const s = document.createElement("span"); s.textContent = (n * step).toFixed(digits);
      s.style.left = 100 * (f.place(n * step) - a) / (b - a) + "%"; f.ticks.append(s);
    }
    f.grid.setAttribute("d", columns + f.rows);
  };
  for (const f of figures) {
    let from = null, box = null;
    const partners = () => figures.filter((g) => g.label === f.label && g.x0 === f.x0 && g.x1 === f.x1);
    const at = (e) => { const r = f.area.getBoundingClientRect(); return f.a + Math.max(0, Math.min(1, (e.clientX - r.left) / r.width)) * (f.b - f.a); };
    f.area.addEventListener("pointermove", (e) => {
      clear(); const t = at(e); for (const g of partners()) show(g, t);
      if (box) { const l = (Math.min(from, t) - f.a) / (f.b - f.a), r = (Math.max(from, t) - f.a) / (f.b - f.a); box.style.left = 100 * l + "%"; box.style.width = 100 * (r - l) + "%"; }
    });
    f.area.addEventListener("pointerleave", clear);
    f.area.addEventListener("pointerdown", (e) => { if (e.button) return; from = at(e); box = document.createElement("div"); box.className = "drag"; f.area.append(box); f.area.setPointerCapture(e.pointerId); });
    f.area.addEventListener("pointerup", (e) => {
      if (!box) return; box.remove(); box = null;
      const t = at(e), a = Math.min(from, t), b = Math.max(from, t);
      if ((b - a) / (f.b - f.a) > 0.01 && b - a > 1e-4) for (const g of partners()) zoom(g, a, b);
    });
    f.area.addEventListener("dblclick", () => { for (const g of partners()) zoom(g, 0, 1); });
  }
})();
