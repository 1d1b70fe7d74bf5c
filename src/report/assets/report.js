// Reads values under the pointer, zooms both axes, toggles series, sorts tables, and hands out the data of a figure.
// Figures with the same horizontal axis move together. Without script the page shows the same figures, still.
(() => {
  const el = (tag, cls, text) => { const n = document.createElement(tag); if (cls) n.className = cls; if (text !== undefined) n.textContent = text; return n; };
  const unit = (label) => (label.match(/\[([^\]]*)\]\s*$/) || ["", ""])[1];
  const quantity = (label) => label.replace(/\s*\[[^\]]*\]\s*$/, "");
  // As many digits as the visible range tells apart.
  const num = (v, span) => {
    if (!isFinite(v)) return "-";
    const a = Math.abs(v);
    if (a !== 0 && (a < 1e-5 || a >= 1e7)) return v.toExponential(3);
    return v.toFixed(Math.max(0, Math.min(6, Math.ceil(2.7 - Math.log10(span || a || 1)))));
  };
  const ticks = (lo, hi, log, wanted) => {
    if (log && hi / lo > 5) {
      const out = [], many = Math.log10(hi / lo) > 2.5;
      for (let e = Math.floor(Math.log10(lo)); e <= Math.ceil(Math.log10(hi)); e++)
        for (const k of many ? [1] : [1, 2, 5]) { const v = k * 10 ** e; if (v >= lo && v <= hi) out.push([v, e >= -4 && e <= 5 ? String(+v.toPrecision(3)) : v.toExponential(0)]); }
      return out;
    }
    const raw = (hi - lo) / wanted, pow = 10 ** Math.floor(Math.log10(raw)), step = pow * [1, 2, 5, 10].find((k) => k * pow >= raw * 0.999);
    const digits = Math.max(0, -Math.floor(Math.log10(step * 1.000001))), out = [];
    for (let n = Math.ceil(lo / step - 1e-9); n * step <= hi + step * 1e-9; n++) out.push([n * step, n === 0 ? "0" : (n * step).toFixed(Math.min(9, digits))]);
    return out;
  };
  const axis = (from, to, log) => ({ from, to, log,
    value: (t) => (log ? from * (to / from) ** t : from + t * (to - from)),
    place: (v) => (log ? Math.log(v / from) / Math.log(to / from) : (v - from) / (to - from)) });

  const figures = [...document.querySelectorAll("figure.plot")].map((node) => {
    const d = node.dataset, area = node.querySelector(".area"), svg = area.querySelector("svg"), box = svg.viewBox.baseVal;
    const f = { node, area, svg, W: box.width, H: box.height, xLabel: d.xLabel, yLabel: d.yLabel, title: node.querySelector(".title").textContent,
      x: axis(+d.xFrom, +d.xTo, d.xLog === "true"), y: axis(+d.yFrom, +d.yTo, d.yLog === "true"), a: 0, b: 1, c: 0, d: 1,
      xTicks: node.querySelector(".x-ticks"), yTicks: node.querySelector(".y-ticks"), grid: svg.querySelector(".grid"),
      bands: [...area.querySelectorAll(".band-label[data-from]")], marks: [...area.querySelectorAll(".marker-label")],
      series: [...svg.querySelectorAll("path[data-series]")], at: null };
    f.plain = [f.xTicks.innerHTML, f.yTicks.innerHTML, f.grid.getAttribute("d")];
    return f;
  });

  // The drawn points of a path in whole coordinates; bars as the middle of their tops.
  const points = (path) => {
    if (path.hil) return path.hil;
    const out = [], text = path.getAttribute("d"); let x = 0, y = 0;
    if (/V/.test(text)) for (const m of text.matchAll(/M(-?\d+) (-?\d+)V(-?\d+)H(-?\d+)/g)) out.push([(+m[1] + +m[4]) / 2, +m[3]]);
    else for (const m of text.matchAll(/([Ml])(-?\d+) (-?\d+)/g)) {
      if (m[1] === "M") { x = +m[2]; y = +m[3]; } else { x += +m[2]; y += +m[3]; }
      out.push([x, y]);
    }
    path.loop = out.some((p, i) => i && p[0] < out[i - 1][0]);
    return (path.hil = out);
  };
  const shown = (f) => f.series.filter((p) => !p.classList.contains("off"));
  const color = (node) => [...node.classList].find((c) => c.startsWith("c-"));

  const clear = () => { document.querySelectorAll(".cursor, .readout").forEach((n) => n.remove()); };
  const nearest = (list, x) => {
    let low = 0, high = list.length - 1;
    while (high - low > 1) { const mid = (low + high) >> 1; if (list[mid][0] <= x) low = mid; else high = mid; }
    return Math.abs(list[low][0] - x) < Math.abs(list[high][0] - x) ? list[low] : list[high];
  };
  // The values at place t; of a loop those of the point that is nearest to the pointer.
  const show = (f, t, u) => {
    f.at = t;
    const left = (t - f.a) / (f.b - f.a); if (left < 0 || left > 1) return;
    const cursor = el("div", "cursor"); cursor.style.left = 100 * left + "%";
    const box = el("div", "readout");
    const line = (text, cls) => { const p = el("div", cls); if (cls) p.append(el("i")); p.append(text); box.append(p); };
    const xs = f.x.value(f.b) - f.x.value(f.a), ys = f.y.value(f.d) - f.y.value(f.c);
    const with_unit = (v, span, label) => (num(v, span) + " " + (unit(label) === "1" ? "" : unit(label))).trim();
    line(quantity(f.xLabel) + " " + with_unit(f.x.value(t), xs, f.xLabel));
    for (const path of shown(f)) {
      const list = points(path), name = path.dataset.name;
      if (!name || !list.length || (path.classList.contains("s-area") && path.loop)) continue;
      let p = null;
      if (!path.loop) { p = nearest(list, t * f.W); if (Math.abs(p[0] - t * f.W) > 0.02 * f.W * (f.b - f.a) + 20) p = null; }
      else if (u !== undefined) {
        let best = 0.0016;
        for (const q of list) { const dx = (q[0] / f.W - t) / (f.b - f.a), dy = (1 - q[1] / f.H - u) / (f.d - f.c), r = dx * dx + dy * dy; if (r < best) { best = r; p = q; } }
      }
      if (p) line(name + " " + with_unit(f.y.value(1 - p[1] / f.H), ys, f.yLabel) + (path.loop ? " at " + with_unit(f.x.value(p[0] / f.W), xs, f.xLabel) : ""), color(path));
    }
    if (left < 0.6) box.style.left = `calc(${100 * left}% + 10px)`; else box.style.right = `calc(${100 * (1 - left)}% + 10px)`;
    f.area.append(cursor, box);
  };

  // The vertical range of what is seen between a and b.
  const fit = (f) => {
    const whole = f.a === 0 && f.b === 1 && shown(f).length === f.series.length;
    let lo = Infinity, hi = -Infinity;
    if (!whole) for (const path of shown(f)) {
      const list = points(path);
      for (let i = 0; i < list.length; i++) {
        const inside = list[i][0] >= f.a * f.W && list[i][0] <= f.b * f.W;
        // Also the ends of a stroke that crosses an edge.
        const near = !path.loop && ((list[i + 1] && list[i][0] < f.a * f.W && list[i + 1][0] > f.a * f.W) || (list[i - 1] && list[i][0] > f.b * f.W && list[i - 1][0] < f.b * f.W));
        if (inside || near) { const v = 1 - list[i][1] / f.H; lo = Math.min(lo, v); hi = Math.max(hi, v); }
      }
    }
    if (!(lo <= hi)) return [0, 1];
    const pad = Math.max((hi - lo) * 0.07, 1e-4); return [lo - pad, hi + pad];
  };
  const draw = (f) => {
    const whole = f.a === 0 && f.b === 1 && f.c === 0 && f.d === 1;
    f.svg.setAttribute("viewBox", `${f.a * f.W} ${(1 - f.d) * f.H} ${(f.b - f.a) * f.W} ${(f.d - f.c) * f.H}`);
    const px = (p) => (p - f.a) / (f.b - f.a), py = (p) => 1 - (p - f.c) / (f.d - f.c);
    for (const label of f.bands) {
      const l = Math.max(0, Math.min(1, px(f.x.place(+label.dataset.from)))), r = Math.max(0, Math.min(1, px(f.x.place(+label.dataset.to))));
      label.style.left = 100 * l + "%"; label.style.width = 100 * (r - l) + "%";
    }
    for (const mark of f.marks) {
      const l = mark.dataset.x === undefined ? (mark.classList.contains("near") ? 0 : 1) : px(f.x.place(+mark.dataset.x)), t = mark.dataset.y === undefined ? 0 : py(f.y.place(+mark.dataset.y));
      mark.style.left = 100 * l + "%"; mark.style.top = 100 * t + "%"; mark.style.visibility = l < 0 || l > 1 || t < 0 || t > 1 ? "hidden" : "";
    }
    f.node.classList.toggle("zoomed", !whole);
    const room = () => { const most = Math.max(...[...f.yTicks.children].map((s) => s.textContent.length - Math.floor((s.textContent.match(/[^0-9a-z]/gi) || []).length / 2))); f.yTicks.parentNode.style.setProperty("--ticks", most > 4 ? most + "ch" : "0ch"); };
    if (whole) { f.xTicks.innerHTML = f.plain[0]; f.yTicks.innerHTML = f.plain[1]; f.grid.setAttribute("d", f.plain[2]); room(); return; }
    let grid = ""; f.xTicks.textContent = ""; f.yTicks.textContent = "";
    for (const [v, text] of ticks(f.x.value(f.a), f.x.value(f.b), f.x.log, Math.max(3, Math.min(8, f.area.clientWidth / 80)))) {
      const s = el("span", "", text); s.style.left = 100 * px(f.x.place(v)) + "%"; f.xTicks.append(s);
      grid += `M${Math.round(f.x.place(v) * f.W)} ${-9 * f.H}V${9 * f.H}`;
    }
    for (const [v, text] of ticks(f.y.value(f.c), f.y.value(f.d), f.y.log, Math.max(3, f.area.clientHeight / 34))) {
      const s = el("span", "", text); s.style.top = 100 * py(f.y.place(v)) + "%"; f.yTicks.append(s);
      grid += `M${-9 * f.W} ${Math.round((1 - f.y.place(v)) * f.H)}H${9 * f.W}`;
    }
    f.grid.setAttribute("d", grid); room();
  };
  const partners = (f) => figures.filter((g) => g.xLabel === f.xLabel && g.x.from === f.x.from && g.x.to === f.x.to);
  // Zooms along x, together with the partners; y follows.
  const zoom = (f, a, b) => {
    const width = Math.max(1e-4, b - a); a = Math.max(0, Math.min(1 - width, a)); b = Math.min(1, a + width);
    clear();
    for (const g of partners(f)) { g.a = a; g.b = b; [g.c, g.d] = fit(g); draw(g); }
  };
  const zoomY = (f, c, d) => { clear(); f.c = c; f.d = Math.max(c + 1e-4, d); draw(f); };
  const around = (f, factor) => { const m = f.at !== null && f.at >= f.a && f.at <= f.b ? f.at : (f.a + f.b) / 2; const w = Math.min(1, (f.b - f.a) * factor); zoom(f, m - (m - f.a) * w / (f.b - f.a), m - (m - f.a) * w / (f.b - f.a) + w); };

  const save = (name, blob) => { const a = el("a"); a.href = URL.createObjectURL(blob); a.download = name; a.click(); setTimeout(() => URL.revokeObjectURL(a.href), 1000); };
  const file = (f, end) => (document.title + " " + f.title).toLowerCase().replace(/[^a-z0-9]+/g, "-").replace(/^-|-$/g, "").slice(0, 80) + "." + end;
  const cell = (text) => (/[",\n]/.test(text) ? '"' + text.replace(/"/g, '""') + '"' : text);
  const csv = (f) => {
    let out = `# ${f.title}: the points as drawn; long traces are thinned to the extremes of each pixel\nseries,${cell(f.xLabel)},${cell(f.yLabel)}\n`;
    for (const path of shown(f)) for (const p of points(path)) out += `${cell(path.dataset.name || f.title)},${+f.x.value(p[0] / f.W).toPrecision(7)},${+f.y.value(1 - p[1] / f.H).toPrecision(7)}\n`;
    return out;
  };
  const picture = (f) => {
    const w = f.area.clientWidth, h = f.area.clientHeight, L = 74, T = 58, R = 18, B = 50, width = w + L + R, height = h + T + B;
    const style = getComputedStyle(document.documentElement), css = (name) => style.getPropertyValue(name).trim();
    const esc = (t) => t.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/"/g, "&quot;");
    const text = (x, y, t, more = "", size = 12) => `<text x="${x}" y="${y}" fill="${css("--ink")}" font-size="${size}" ${more}>${esc(t)}</text>`;
    let out = `<svg xmlns="${f.svg.namespaceURI}" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}" font-family="system-ui, Arial, sans-serif"><rect width="100%" height="100%" fill="${css("--card")}"/>`;
    out += text(L, 20, f.title, 'font-weight="650"', 14);
    let at = L;
    for (const path of shown(f).filter((p) => p.dataset.name)) {
      const s = getComputedStyle(path);
      out += `<path d="M${at} 40h22" stroke="${s.stroke === "none" ? s.fill : s.stroke}" stroke-width="3" ${s.strokeDasharray === "none" ? "" : `stroke-dasharray="${s.strokeDasharray}"`}/>` + text(at + 28, 44, path.dataset.name);
      at += 48 + 6.6 * path.dataset.name.length;
    }
    out += `<svg x="${L}" y="${T}" width="${w}" height="${h}" viewBox="${f.svg.getAttribute("viewBox")}" preserveAspectRatio="none">`;
    for (const path of f.svg.querySelectorAll("path")) {
      if (path.classList.contains("off")) continue;
      const s = getComputedStyle(path);
      out += `<path d="${path.getAttribute("d")}" fill="${s.fill}" fill-opacity="${s.fillOpacity}" stroke="${s.stroke}" stroke-width="${s.strokeWidth}" stroke-opacity="${s.strokeOpacity}" stroke-dasharray="${s.strokeDasharray}" stroke-linecap="${s.strokeLinecap}" stroke-linejoin="round" vector-effect="non-scaling-stroke"/>`;
    }
    out += `</svg><rect x="${L}" y="${T}" width="${w}" height="${h}" fill="none" stroke="${css("--line")}"/>`;
    for (const s of f.xTicks.children) out += text(L + parseFloat(s.style.left) / 100 * w, T + h + 17, s.textContent, 'text-anchor="middle"');
    for (const s of f.yTicks.children) out += text(L - 8, T + parseFloat(s.style.top) / 100 * h + 4, s.textContent, 'text-anchor="end"');
    for (const m of f.area.querySelectorAll(".marker-label")) if (m.style.visibility !== "hidden") out += text(L + parseFloat(m.style.left) / 100 * w + (m.classList.contains("flip") ? -7 : 9), T + parseFloat(m.style.top) / 100 * h + 4 + (m.classList.contains("low") ? 12 : 0) + (m.classList.contains("lower") ? 15 : 0), m.textContent, m.classList.contains("flip") ? 'text-anchor="end"' : "");
    return out + text(L + w / 2, T + h + 38, f.xLabel, 'text-anchor="middle"') + text(0, 0, f.yLabel, `text-anchor="middle" transform="translate(16 ${T + h / 2}) rotate(-90)"`) + "</svg>";
  };
  const png = (f) => {
    // A picture from a data address may be drawn and read again, also by a page that lies in a folder.
    const image = new Image();
    image.onload = () => {
      const c = el("canvas"); c.width = image.width * 2; c.height = image.height * 2;
      c.getContext("2d").drawImage(image, 0, 0, c.width, c.height);
      c.toBlob((blob) => save(file(f, "png"), blob));
    };
    image.src = "data:image/svg+xml;charset=utf-8," + encodeURIComponent(picture(f));
  };

  for (const f of figures) {
    const tools = el("span", "tools");
    const tool = (text, label, act) => { const b = el("button", "", text); b.type = "button"; b.title = label; b.setAttribute("aria-label", label + ": " + f.title); b.addEventListener("click", act); tools.append(b); };
    tool("+", "zoom in", () => around(f, 0.5)); tool("\u2212", "zoom out", () => around(f, 2)); tool("all", "show all", () => zoom(f, 0, 1));
    tool("CSV", "data as CSV", () => save(file(f, "csv"), new Blob([csv(f)], { type: "text/csv" })));
    tool("SVG", "figure as SVG", () => save(file(f, "svg"), new Blob([picture(f)], { type: "image/svg+xml" })));
    tool("PNG", "figure as PNG", () => png(f));
    f.node.querySelector("figcaption").append(tools);
    for (const key of f.node.querySelectorAll(".legend .key")) key.addEventListener("click", () => {
      const off = key.getAttribute("aria-pressed") === "true"; key.setAttribute("aria-pressed", String(!off));
      for (const path of f.series) if (path.dataset.name === key.dataset.name) path.classList.toggle("off", off);
      clear(); [f.c, f.d] = fit(f); draw(f);
    });
    let from = null, box = null;
    const at = (e) => { const r = f.area.getBoundingClientRect(), t = Math.max(0, Math.min(1, (e.clientX - r.left) / r.width)), u = Math.max(0, Math.min(1, 1 - (e.clientY - r.top) / r.height));
      return { t: f.a + t * (f.b - f.a), u: f.c + u * (f.d - f.c), px: e.clientX - r.left, py: e.clientY - r.top }; };
    const read = (p) => { clear(); for (const g of partners(f)) show(g, p.t, g === f ? p.u : undefined); };
    // What a drag means: across, up, or a box.
    const drag = (p) => { const dx = Math.abs(p.px - from.px), dy = Math.abs(p.py - from.py); return { x: dx > 6 && (dy < 30 || dx >= 30), y: dy >= 30 && (dx < 30 || dy >= 30) }; };
    f.area.tabIndex = 0; f.area.setAttribute("aria-label", f.title + ": arrows read, plus and minus zoom, 0 shows all");
    f.area.addEventListener("pointermove", (e) => {
      const p = at(e); read(p);
      if (box) {
        const how = drag(p), style = box.style, r = f.area.getBoundingClientRect();
        const [l, w] = how.x || !how.y ? [Math.min(from.px, p.px), Math.abs(p.px - from.px)] : [0, r.width];
        const [t, h] = how.y ? [Math.min(from.py, p.py), Math.abs(p.py - from.py)] : [0, r.height];
        style.left = l + "px"; style.width = w + "px"; style.top = t + "px"; style.height = h + "px";
      }
    });
    f.area.addEventListener("pointerleave", (e) => { if (e.pointerType === "mouse") clear(); });
    f.area.addEventListener("pointerdown", (e) => { if (e.button) return; from = at(e); read(from); box = el("div", "drag"); f.area.append(box); f.area.setPointerCapture(e.pointerId); });
    const end = () => { if (box) box.remove(); box = null; };
    f.area.addEventListener("pointercancel", end);
    f.area.addEventListener("pointerup", (e) => {
      if (!box) return; const p = at(e), how = drag(p); end();
      const [c, d] = [Math.min(from.u, p.u), Math.max(from.u, p.u)];
      if (how.x) zoom(f, Math.min(from.t, p.t), Math.max(from.t, p.t));
      if (how.y) zoomY(f, c, d);
    });
    f.area.addEventListener("dblclick", () => zoom(f, 0, 1));
    f.area.addEventListener("keydown", (e) => {
      const w = f.b - f.a, t = f.at === null ? (f.a + f.b) / 2 : f.at, step = (e.key === "ArrowLeft" ? -1 : 1) * w;
      if (e.key === "ArrowLeft" || e.key === "ArrowRight") { if (e.shiftKey) zoom(f, f.a + 0.2 * step, f.b + 0.2 * step); else read({ t: Math.max(f.a, Math.min(f.b, t + 0.01 * step)) }); }
      else if (e.key === "+" || e.key === "=") around(f, 0.5); else if (e.key === "-") around(f, 2); else if (e.key === "0") zoom(f, 0, 1); else if (e.key === "Escape") clear(); else return;
      e.preventDefault();
    });
  }
  document.addEventListener("pointerdown", (e) => { if (!e.target.closest(".area")) clear(); });

  for (const table of document.querySelectorAll("table.sortable")) {
    const body = table.tBodies[0], text = (row, k) => row.cells[k].textContent.trim(), heads = table.querySelectorAll("thead th");
    heads.forEach((head, k) => {
      head.tabIndex = 0; head.setAttribute("role", "button");
      const sort = () => {
        const down = head.dataset.order === "up"; heads.forEach((h) => { delete h.dataset.order; h.removeAttribute("aria-sort"); });
        head.dataset.order = down ? "down" : "up"; head.setAttribute("aria-sort", down ? "descending" : "ascending");
        const numeric = head.classList.contains("num"), rows = [...body.rows].map((row) => ({ row, text: text(row, k), number: parseFloat(text(row, k)) }));
        rows.sort((p, q) => numeric ? (isFinite(p.number) ? p.number : Infinity) - (isFinite(q.number) ? q.number : Infinity) : p.text.localeCompare(q.text, undefined, { numeric: true }));
        if (down) rows.reverse();
        body.append(...rows.map((r) => r.row));
      };
      head.addEventListener("click", sort);
      head.addEventListener("keydown", (e) => { if (e.key === "Enter" || e.key === " ") { e.preventDefault(); sort(); } });
    });
  }
  for (const input of document.querySelectorAll("input[data-filter]")) input.addEventListener("input", () => {
    const wanted = input.value.toLowerCase();
    for (const row of document.getElementById(input.dataset.filter).tBodies[0].rows) row.hidden = !row.textContent.toLowerCase().includes(wanted);
  });
})();
