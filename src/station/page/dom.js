// Builds elements: h("p", { class: "x", onclick: f }, "text", element). Texts are texts, never markup.
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  put(element, attributes, children);
  return element;
}

const SVG = "http" + "://www.w3.org/2000/svg";

// The same for SVG.
export function s(tag, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, tag);
  put(element, attributes, children);
  return element;
}

function put(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children.flat(Infinity).filter((c) => c !== null && c !== undefined && c !== false));
}

// Puts children in place of those that are there.
export function fill(element, ...children) {
  element.replaceChildren(...children.flat(Infinity).filter((c) => c !== null && c !== undefined && c !== false));
  return element;
}

// Says a text in an element, where it is not said already: a reader speaks only what changes.
export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// A number with its digits, as the language writes it.
export const number = (value, digits) =>
  value === null || value === undefined || !isFinite(value) ? "–" : value.toLocaleString(document.documentElement.lang, { minimumFractionDigits: digits, maximumFractionDigits: digits });

// A time of the day.
export const clock = (text) => new Date(text).toLocaleTimeString(document.documentElement.lang);

// A date with its time.
export const moment = (text) => new Date(text).toLocaleString(document.documentElement.lang);
