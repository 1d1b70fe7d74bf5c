// The line to the station: who we are, what is the case, what happens. It mends itself.
import { told } from "./texts.js";

const SILENT = 900; // ms without an event after which nobody is believed to be there; the station sends one every 400 ms

export const link = { role: null, act: null, board: null, there: false };
const listeners = {};
let source = null, heard = 0, again = null;

export function on(name, listener) {
  (listeners[name] ??= []).push(listener);
}

function tell(name, value) {
  for (const listener of listeners[name] ?? []) listener(value);
}

async function answer(response) {
  const value = await response.json().catch(() => ({}));
  if (response.status === 401) out();
  if (!response.ok) throw new Error(value.refused ? told(value.refused) : `${response.status}`);
  return value;
}

export const get = (path) => fetch(path).then(answer);

export const post = (path, body = {}, kind = "application/json") =>
  fetch(path, { method: "POST", headers: { "content-type": kind, "x-hil-act": link.act ?? "" }, body: body instanceof Blob ? body : JSON.stringify(body) }).then(answer);

export async function enter(token) {
  Object.assign(link, await answer(await fetch("/enter", { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify({ token }) })));
  tell("entered");
  join();
}

export async function leave() {
  await post("/leave").catch(() => {});
  out();
}

function out() {
  source?.close();
  source = null;
  clearTimeout(again);
  if (link.role) { link.role = link.act = null; }
  tell("out");
}

function lost() {
  source?.close();
  source = null;
  if (link.there) { link.there = false; tell("lost"); }
  clearTimeout(again);
  again = setTimeout(join, 500);
}

// Asks who we are, and listens. A station that was started again with the same token knows us still.
export async function join() {
  clearTimeout(again);
  try {
    const response = await fetch("/api/me", { signal: AbortSignal.timeout(3000) });
    if (response.status === 401) return out();
    if (!response.ok) throw new Error();
    const was = link.role;
    Object.assign(link, await response.json());
    if (was !== link.role) tell("entered");
  } catch { return lost(); }
  source?.close();
  source = new EventSource("/api/events");
  heard = performance.now();
  const hear = (name, take) => source.addEventListener(name, (event) => {
    heard = performance.now();
    if (!link.there) { link.there = true; tell("found"); }
    take(JSON.parse(event.data));
  });
  hear("board", (board) => { link.board = board; tell("board", board); });
  hear("course", (columns) => tell("course", columns));
  hear("samples", (columns) => tell("samples", columns));
  hear("diagnosis", (value) => tell("diagnosis", value));
  hear("beat", () => {});
  source.onerror = lost;
}

setInterval(() => { if (source && performance.now() - heard > SILENT) lost(); }, 100);
