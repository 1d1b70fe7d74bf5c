// Signs that are told apart by shape, without their colour.
import { s } from "./dom.js";

const shapes = {
  // A disc with a tick.
  PASS: () => [s("circle", { cx: 50, cy: 50, r: 46 }), s("path", { class: "mark", d: "M27 52 L44 69 L75 33" })],
  // A triangle with a tick.
  MARGINAL: () => [s("path", { d: "M50 4 L98 94 L2 94 Z" }), s("path", { class: "mark", d: "M33 66 L46 78 L68 50" })],
  // An octagon with a cross.
  FAIL: () => [s("path", { d: "M30 3 H70 L97 30 V70 L70 97 H30 L3 70 V30 Z" }), s("path", { class: "mark", d: "M32 32 L68 68 M68 32 L32 68" })],
  // A diamond with a question.
  INVALID: () => [s("path", { d: "M50 2 L98 50 L50 98 L2 50 Z" }), s("path", { class: "mark", d: "M38 40 Q38 27 50 27 Q62 27 62 39 Q62 47 50 52 V58 M50 70 V71" })],
  // A diamond with an exclamation mark.
  ERROR: () => [s("path", { d: "M50 2 L98 50 L50 98 L2 50 Z" }), s("path", { class: "mark", d: "M50 26 V58 M50 71 V72" })],
  // A square.
  ABORTED: () => [s("rect", { x: 6, y: 6, width: 88, height: 88, rx: 6 }), s("path", { class: "mark", d: "M34 34 H66 V66 H34 Z" })],
  NOT_RUN: () => [s("circle", { cx: 50, cy: 50, r: 44, class: "open" }), s("path", { class: "mark ink", d: "M32 50 H68" })],
};
shapes.NOT_STORED = shapes.ERROR;

export function sign(outcome) {
  return s("svg", { viewBox: "0 0 100 100", class: `sign ${outcome}`, "aria-hidden": "true" }, (shapes[outcome] ?? shapes.NOT_RUN)());
}

const lights = {
  idle: () => s("circle", { cx: 10, cy: 10, r: 7, class: "open" }),
  waiting: () => s("path", { d: "M3 3 H17 L10 10 L17 17 H3 L10 10 Z" }),
  asking: () => s("path", { d: "M2 3 H18 V14 H11 L7 19 V14 H2 Z" }),
  running: () => s("path", { d: "M4 2 L18 10 L4 18 Z" }),
  stopping: () => s("rect", { x: 3, y: 3, width: 14, height: 14 }),
  unsafe: () => s("path", { d: "M10 1 L19 18 H1 Z" }),
};

export function light(name) {
  return s("svg", { viewBox: "0 0 20 20", class: `light ${name}`, "aria-hidden": "true" }, lights[name]());
}
