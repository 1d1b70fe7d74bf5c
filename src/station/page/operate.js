// What an operator sees: whose turn, which valve, start, live curves, the verdict, what comes next.
import { t, told } from "./texts.js";
import { clock, fill, h, number, say } from "./dom.js";
import { link, post } from "./link.js";
import { light, sign } from "./signs.js";

const kept = (name) => sessionStorage.getItem(`hil-${name}`) ?? "";
const keep = (name, value) => sessionStorage.setItem(`hil-${name}`, value);

export function operate(main, curves) {
  const acts = link.role === "operator";
  let chosen = Number(kept("site")) || 0, accepted = null, asking = 0;
  const cards = [];
  const operator = h("input", { id: "operator", autocomplete: "off", spellcheck: "false", maxlength: 64, value: kept("operator") });
  const product = h("select", { id: "product" });
  const lot = h("input", { id: "lot", autocomplete: "off", spellcheck: "false", maxlength: 64, value: kept("lot") });
  const serial = h("input", { id: "serial", autocomplete: "off", spellcheck: "false", maxlength: 200, autocapitalize: "off", value: kept("serial"), "aria-describedby": "said" });
  const start = h("button", { id: "start", type: "submit", class: "go" }, t("start"));
  const said = h("p", { id: "said", "aria-live": "assertive" });
  const about = h("div", { class: "about" });
  const field = (id, label, input) => h("div", { class: `field ${id}` }, h("label", { for: id }, t(label)), input);
  const desk = h("form", { class: "desk", onsubmit: (e) => { e.preventDefault(); entered(); } },
    field("serial", "serial", serial), start,
    field("operator", link.board?.station.badges ? "operator_badge" : "operator", operator), field("product", "product", product), field("lot", "lot", lot),
    said, about);
  const sites = h("div", { class: "sites" });
  fill(main, h("h2", { class: "out-of-sight" }, t("operate")), acts ? desk : null, sites);

  const entry = () => ({ site: chosen, product: product.value, serial: serial.value.trim(), operator: operator.value, lot: lot.value || null });
  const key = () => JSON.stringify(entry());
  function tell(text, kind = "") {
    said.className = kind;
    say(said, text);
  }

  // Enter: the badge leads to the serial number, the serial number is checked, a checked one starts.
  async function entered() {
    if (document.activeElement === operator) { keep("operator", operator.value); return serial.focus(); }
    if (!operator.value.trim()) { tell(t("type_operator"), "ask"); return operator.focus(); }
    if (!serial.value.trim()) { tell(t("type_serial"), "ask"); return focus(); }
    const asked = key(), turn = ++asking, path = accepted === asked ? "/api/start" : "/api/check";
    accepted = null;
    try {
      const answer = await post(path, entry());
      if (turn !== asking) return;
      if (path === "/api/start") {
        serial.value = "";
        keep("serial", "");
        tell("");
        fill(about);
        next();
      } else {
        accepted = asked;
        const again = answer.before ? `${t("again", answer.before, answer.attempt)} ` : "";
        tell(again + t("ready_to_start", answer.serial, link.board.sites[chosen].name), "ready");
        describe();
      }
    } catch (e) {
      if (turn !== asking) return;
      tell(`${t("refused")}: ${e.message}`, "refused");
    }
    start.classList.toggle("ready", accepted !== null);
    focus();
  }

  // The next free site has the next valve.
  function next() {
    const board = link.board.sites;
    for (let k = 1; k <= board.length; k++) {
      const site = (chosen + k) % board.length;
      if (board[site].light === "idle" && site !== chosen) return choose(site);
    }
  }

  function choose(site) {
    chosen = site;
    keep("site", site);
    accepted = null;
    start.classList.remove("ready");
    cards.forEach((card, k) => card.choice(k === chosen));
  }

  function describe() {
    const card = link.board.products.find((p) => p.id === product.value);
    if (!card) return fill(about);
    const part = [card.part_number, card.revision].filter(Boolean).join(" ");
    fill(about, h("dl", {}, part ? [h("dt", {}, t("part")), h("dd", {}, part)] : null,
      h("dt", {}, t("plan")), h("dd", {}, `${card.plan}, ${t("takes", number(card.duration_s, 0))}`, card.origin === "real" ? null : h("span", { class: "origin" }, t(card.origin))),
      h("dt", {}, t("limits")), h("dd", {}, h("ul", {}, card.limits.map((l) => h("li", {}, l))))));
  }

  // A scanner types wherever it may: its keys go to the serial number, unless somebody writes in another field.
  const writes = (element) => element?.matches?.("input, select, textarea");
  const focus = () => { if (acts && !document.querySelector("dialog[open]")) { serial.focus({ preventScroll: true }); serial.select(); } };
  function keyed(event) {
    if (event.key === "Escape") { const site = running(); if (site !== null) { event.preventDefault(); stop(site); } return; }
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const at = document.activeElement, printable = event.key.length === 1 && event.key !== " ";
    // In a list of products a scanned letter would choose one: it is the first of a serial number.
    if (at === product && (printable || event.key === "Enter")) { event.preventDefault(); accepted = null; serial.focus(); if (printable) serial.value = event.key; return; }
    if (writes(at)) return;
    if (printable) { serial.focus(); serial.value = ""; accepted = null; }
  }
  // What Escape stops: the site that is chosen, else the only one that runs.
  function running() {
    const busy = link.board.sites.map((s, k) => k).filter((k) => ["running", "waiting", "asking"].includes(link.board.sites[k].light));
    return busy.includes(chosen) ? chosen : busy.length === 1 ? busy[0] : null;
  }
  async function stop(site) {
    await post("/api/stop", { site }).catch((e) => tell(e.message, "refused"));
    focus();
  }
  const blurred = () => setTimeout(() => { if (document.activeElement === document.body) focus(); }, 0);
  if (acts) {
    document.addEventListener("keydown", keyed, true);
    window.addEventListener("focus", blurred);
    document.addEventListener("focusout", blurred);
    serial.addEventListener("input", () => { keep("serial", serial.value); accepted = null; start.classList.remove("ready"); });
    product.addEventListener("change", () => { keep("product", product.value); accepted = null; describe(); });
    for (const [name, input] of [["operator", operator], ["lot", lot]]) input.addEventListener("change", () => { keep(name, input.value); accepted = null; });
  }

  function card(site, index) {
    const head = h("div", { class: "head" }), body = h("div", { class: "verdict", role: "status", "aria-live": "assertive" });
    const place = h("p", { class: "where" }), bar = h("progress", { max: 1, value: 0, "aria-label": t("phase") });
    const halt = h("button", { type: "button", class: "stop", onclick: () => stop(index) }, t("stop"));
    const run = h("div", { class: "run" }, h("div", { class: "now" }, place, bar), acts ? halt : null);
    const pick = h("button", { type: "button", class: "pick", onclick: () => { choose(index); focus(); } });
    const element = h("section", { class: "card site", "aria-label": `${t("site")} ${site.name}` }, head, body, run, curves[index].element);
    let signature = "";
    return {
      element,
      choice(yes) {
        element.classList.toggle("chosen", yes && acts && link.board.sites.length > 1);
        pick.setAttribute("aria-pressed", yes);
        say(pick, yes ? t("chosen") : t("choose"));
      },
      board(now) {
        element.dataset.light = now.light;
        const word = now.light === "waiting" && !now.run ? t("light_starting") : t(`light_${now.light}`);
        fill(head, h("h3", {}, now.name), h("span", { class: `state ${now.light}` }, light(now.light), word), link.board.sites.length > 1 && acts ? pick : null);
        const busy = !["idle", "unsafe"].includes(now.light);
        run.hidden = !busy;
        halt.disabled = now.light === "stopping";
        curves[index].element.hidden = !busy && !now.verdict;
        const shown = JSON.stringify([now.light === "unsafe", now.verdict, busy && now.run?.id, now.prompt?.id]);
        if (shown === signature) return;
        signature = shown;
        fill(body, now.light === "unsafe" ? unsafe(index) : null, busy && now.prompt ? question(index, now.prompt) : null, busy && now.run ? running_of(now.run) : now.verdict ? verdict(now.verdict) : h("p", { class: "next" }, acts ? t("type_serial") : t("light_idle")));
        // A question takes the keyboard, unless a serial number is being typed; afterwards the scanner has it again.
        if (busy && now.prompt && acts) { if (!serial.value) body.querySelector(".question input, .question button")?.focus(); }
        else if ((!busy && now.verdict) || document.activeElement === document.body) focus();
      },
      samples() {
        const now = link.board.sites[index].run, course = curves[index];
        if (!now || course.run !== now.id || !course.t.length) return;
        const all = now.phases.reduce((sum, p) => sum + p.samples, 0), phase = now.phases[course.f[course.f.length - 1]];
        say(place, `${phase?.name ?? ""} · ${t("left", number(Math.max(0, (all - course.n) * now.period_s), 0))}`);
        bar.value = course.n / all;
      },
    };
  }

  // What the plan asks: answered here or at no other place.
  function question(site, asked) {
    const why = h("p", { class: "refused", role: "alert" });
    const give = (answer) => post("/api/answer", { site, prompt: asked.id, answer }).catch((e) => say(why, e.message));
    const button = (text, answer, kind = "") => h("button", { type: "button", class: `answer ${kind}`, onclick: () => give(answer) }, text);
    const typed = (label) => {
      const input = h("input", { id: `answer-${site}`, autocomplete: "off", maxlength: 200, inputmode: asked.kind === "number" ? "decimal" : null });
      return h("form", { class: "typed", onsubmit: (e) => { e.preventDefault(); give(input.value); } }, h("label", { for: `answer-${site}` }, label), input, h("button", { class: "go" }, t("give")));
    };
    const how = { confirm: () => [button(t("yes"), "yes", "yes"), button(t("no"), "no")], number: () => typed(t("number_in", asked.unit)), choice: () => asked.options.map((o) => button(o, o)), remark: () => typed(t("remark")) };
    return h("div", { class: "question" }, h("p", { class: "next" }, asked.text),
      asked.picture ? h("img", { src: `/picture/${site}?${asked.id}`, alt: t("picture") }) : null, acts ? h("div", { class: "answers" }, how[asked.kind]()) : null, why);
  }

  function unsafe(site) {
    return h("div", { class: "alarm", role: "alert" }, h("p", {}, t("unsafe")), h("p", { class: "small" }, t("unsafe_help")),
      acts ? h("button", { type: "button", onclick: () => post("/api/acknowledge", { site }).catch((e) => tell(e.message, "refused")) }, t("acknowledge")) : null);
  }

  const running_of = (run) => h("p", { class: "under" }, h("b", {}, run.serial), ` ${t("attempt", run.attempt)} · ${run.operator}`);

  // As large as the card lets it be: it is read from three metres.
  function word(outcome) {
    const text = t(outcome), element = h("div", { class: `word ${outcome}` }, sign(outcome), h("span", {}, text));
    element.style.setProperty("--letters", Math.max(...text.split(" ").map((part) => part.length)));
    return element;
  }

  function verdict(v) {
    return [
      word(v.outcome),
      v.origin && v.origin !== "real" ? h("p", { class: "origin-line" }, h("span", { class: "origin" }, t(v.origin)), ` ${t("not_real")}`) : null,
      h("p", { class: "next" }, t(`next_${v.outcome}`)),
      h("p", { class: "under" }, h("b", {}, v.serial), ` ${t("attempt", v.attempt)} · ${v.operator} · ${t("stored", clock(v.at))} `,
        v.record ? h("a", { href: `/record/${v.record}`, target: "_blank", rel: "noopener" }, t("report")) : null),
      v.reasons.map((r) => h("p", { class: "reason" }, told(r))),
      v.failed.length ? [h("h4", {}, t("outside")), h("ul", { class: "failed" }, v.failed.map((f) => h("li", {}, h("b", {}, f[0]), ` ${f[1]} (${f[2]})`)))] : null,
      v.safe_state ? h("p", { class: v.safe_state.confirmed ? "safe" : "reason" }, t(v.safe_state.confirmed ? "safe_confirmed" : "safe_unknown", told(v.safe_state.evidence))) : null,
    ];
  }

  return {
    board(board) {
      if (product.options.length !== board.products.length) {
        fill(product, board.products.map((p) => h("option", { value: p.id, selected: p.id === kept("product") }, p.title)));
      }
      if (cards.length !== board.sites.length) {
        cards.push(...board.sites.slice(cards.length).map((site, k) => card(site, k)));
        fill(sites, cards.map((c) => c.element));
        if (chosen >= cards.length) chosen = 0;
        choose(chosen);
        sites.classList.toggle("several", cards.length > 1);
        operator.value || !acts ? focus() : operator.focus();
      }
      board.sites.forEach((site, k) => { cards[k].board(site); cards[k].samples(); });
    },
    samples: (site) => cards[site]?.samples(),
    gone() {
      document.removeEventListener("keydown", keyed, true);
      window.removeEventListener("focus", blurred);
      document.removeEventListener("focusout", blurred);
    },
  };
}
