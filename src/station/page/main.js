// The page: enters the station, shows one of its views, says when nobody is there.
import { choose, other, t } from "./texts.js";
import { h, fill, say } from "./dom.js";
import { enter, join, leave, link, on } from "./link.js";
import { Curves } from "./curves.js";
import { operate } from "./operate.js";
import { engineer } from "./engineer.js";
import { history } from "./history.js";
import { diagnosis } from "./diagnosis.js";

const at = (id) => document.getElementById(id);
const views = { operate, engineer, history, diagnosis };
let shown = null;

say(at("language"), t("language"));
at("language").lang = other;
at("language").onclick = () => choose(other);
say(at("leave"), t("leave"));
at("leave").onclick = leave;

// The token stands behind the #, so that it is in no request and in no log; it leaves the address bar at once.
const token = location.hash.match(/^#([!-~]{16,})$/)?.[1];
if (token && !(token in views)) {
  window.history.replaceState(null, "", location.pathname);
  enter(decodeURIComponent(token)).catch(join);
} else join();

on("out", () => {
  shown = null;
  at("views").hidden = at("leave").hidden = at("lost").hidden = true;
  say(at("who"), "");
  const field = h("input", { id: "token", type: "password", autocomplete: "off", required: true });
  const why = h("p", { role: "alert", class: "refused" });
  const form = h("form", { class: "card enter", onsubmit: (event) => {
    event.preventDefault();
    enter(field.value).catch((e) => say(why, e.message));
  } }, h("h2", {}, t("enter_title")), h("p", {}, t("enter_help")), h("label", { for: "token" }, t("token")), field, h("button", { class: "go" }, t("enter")), why);
  fill(at("main"), form);
  field.focus();
});

on("entered", () => {
  say(at("who"), link.role === "viewer" ? t("viewer") : "");
  at("leave").hidden = false;
});

on("lost", () => { say(at("lost"), t("lost")); at("lost").hidden = false; document.body.classList.add("away"); });
on("found", () => { at("lost").hidden = true; document.body.classList.remove("away"); });

// Curves of all sites live as long as the page: a view that is opened later shows them whole.
export const curves = [];
on("board", (board) => {
  say(at("station"), board.station.id);
  document.title = `${board.station.id} – hil`;
  while (curves.length < board.sites.length) curves.push(new Curves());
  if (!shown) route();
  else shown.board?.(board);
});
on("course", (columns) => { curves[columns.s]?.add(columns, true); shown?.samples?.(columns.s); });
on("samples", (columns) => { curves[columns.s]?.add(columns); shown?.samples?.(columns.s); });

function route() {
  if (!link.board) return;
  const name = location.hash.slice(1) in views ? location.hash.slice(1) : "operate";
  at("views").hidden = false;
  fill(at("views"), Object.keys(views).map((v) => h("a", { href: `#${v}`, "aria-current": v === name ? "page" : null }, t(v))));
  shown?.gone?.();
  shown = views[name](at("main"), curves);
  shown.board?.(link.board);
}
window.addEventListener("hashchange", route);
