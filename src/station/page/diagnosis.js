// A recording and a model: what physics the model lacks. Candidates are shown as they come.
import { t } from "./texts.js";
import { fill, h, moment, number, say } from "./dom.js";
import { get, link, on, post } from "./link.js";

// What is known of the last diagnosis; it goes on while another view is open.
let now = { state: "none", tried: [] }, redraw = () => {};
on("diagnosis", (told) => {
  if (told.id !== now.id) now = { id: told.id, state: told.state, name: "", tried: [] };
  if (told.state === "tried") now.tried.push(told.tried);
  else Object.assign(now, told);
  redraw();
});

export function diagnosis(main) {
  const acts = link.role === "operator", models = link.board.models;
  const model = h("select", { id: "model" }, models.map((m) => h("option", { value: m }, m)));
  const file = h("input", { id: "file", type: "file", accept: ".csv,.parquet,.mf4", onchange: () => file.files[0] && begin(file.files[0]) });
  const record = h("select", { id: "record" });
  const said = h("p", { role: "alert", class: "refused" }), found = h("div", { "aria-live": "polite" });
  const place = h("section", { class: "card drop", "aria-label": t("diagnosis"), ondragover: (e) => e.preventDefault(), ondrop: (e) => { e.preventDefault(); if (acts && e.dataTransfer.files[0]) begin(e.dataTransfer.files[0]); } },
    h("h2", {}, t("diagnosis")),
    !acts ? h("p", {}, t("viewer")) : !models.length ? h("p", {}, t("no_models")) : [
      h("p", {}, t("diagnosis_help")),
      h("div", { class: "search" }, h("label", { for: "model" }, t("model")), model, h("label", { for: "file" }, t("recording")), file),
      h("div", { class: "search" }, h("label", { for: "record" }, t("records")), record,
        h("button", { type: "button", class: "go", onclick: () => record.value && send(() => post("/api/diagnose-record", { record: record.value, model: model.value })) }, t("diagnose"))),
    ], said, found);
  fill(main, place);

  async function send(ask) {
    say(said, "");
    await ask().catch((e) => say(said, `${t("refused")}: ${e.message}`));
  }
  function begin(chosen) {
    if (chosen.size > 64 * 2 ** 20) return say(said, t("too_large"));
    send(() => post(`/api/diagnose?name=${encodeURIComponent(chosen.name)}&model=${encodeURIComponent(model.value)}`, chosen, "application/octet-stream"));
  }

  redraw = () => {
    if (!found.isConnected) return;
    if (now.state === "none") return fill(found);
    const best = [...now.tried].map((c) => ({ ...c, gain: c.before_bar - c.rmse_bar })).sort((a, b) => a.beside.length - b.beside.length || b.gain - a.gain);
    const most = Math.max(...best.map((c) => c.gain), 1e-9);
    const row = (c) => h("tr", {}, h("td", {}, c.candidate), h("td", {}, c.beside.join(" + ") || "–"), h("td", { class: "gauge" }, h("meter", { min: 0, max: most, value: Math.max(0, c.gain), "aria-hidden": "true" }), ` ${number(c.gain, 4)}`), h("td", {}, number(c.rmse_bar, 4)));
    fill(found,
      h("h3", {}, now.state === "done" ? h("a", { href: `/diagnosis/${now.id}`, target: "_blank", rel: "noopener" }, t("diagnosis_page")) : now.state === "failed" ? t("diagnosis_failed") : t("diagnosing", now.name)),
      now.state === "failed" ? h("pre", { class: "refused" }, now.why) : null, now.state === "done" ? h("pre", {}, now.summary) : null,
      best.length ? h("div", { class: "wide", tabindex: 0 }, h("table", {}, h("thead", {}, h("tr", {}, h("th", { scope: "col" }, t("candidate")), h("th", { scope: "col" }, t("beside")), h("th", { scope: "col" }, t("gain")), h("th", { scope: "col" }, "RMSE [bar]"))), h("tbody", {}, best.map(row)))) : null);
  };
  redraw();
  if (acts) get("/api/records").then((answer) => fill(record, answer.attempts.slice(0, 200).map((a) => h("option", { value: a.id }, `${a.serial} #${a.attempt} ${a.outcome} ${moment(a.at)}`))), () => {});
  return {};
}
