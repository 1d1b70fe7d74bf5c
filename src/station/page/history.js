// What is stored of a serial number.
import { t } from "./texts.js";
import { fill, h, moment } from "./dom.js";
import { get } from "./link.js";

export function history(main) {
  const serial = h("input", { id: "of", autocomplete: "off", spellcheck: "false", maxlength: 200 });
  const found = h("div", { "aria-live": "polite" });
  async function search(event) {
    event?.preventDefault();
    const answer = await get(`/api/records?serial=${encodeURIComponent(serial.value.trim())}`).catch((e) => e);
    fill(found, answer instanceof Error ? h("p", { class: "refused" }, answer.message) : table(answer.attempts));
    serial.select();
  }
  fill(main, h("section", { class: "card" }, h("h2", {}, t("history")),
    h("form", { class: "search", onsubmit: search }, h("label", { for: "of" }, t("serial")), serial, h("button", { class: "go" }, t("search"))), found));
  serial.focus();
  search();
  return {};
}

// Attempts, each with its report.
export function table(attempts) {
  if (!attempts.length) return h("p", {}, t("none_found"));
  const head = ["at", "valve", "attempt_short", "verdict", "plan", "batch", "report"].map((c) => h("th", { scope: "col" }, c === "attempt_short" ? "#" : t(c)));
  const row = (a) => h("tr", {}, h("td", {}, moment(a.at)), h("td", {}, a.serial), h("td", {}, a.attempt),
    h("td", {}, h("span", { class: `outcome ${a.outcome}` }, t(a.outcome)), a.simulated || a.emulated ? h("span", { class: "origin" }, t(a.simulated ? "simulated" : "emulated")) : null),
    h("td", {}, a.plan), h("td", {}, a.batch), h("td", {}, h("a", { href: `/record/${a.id}`, target: "_blank", rel: "noopener" }, t("report"))));
  return h("div", { class: "wide", tabindex: 0 }, h("table", {}, h("thead", {}, h("tr", {}, head)), h("tbody", {}, attempts.map(row))));
}
