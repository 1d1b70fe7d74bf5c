// The language of the page: what was chosen here before, else the browser's.
import english from "./text.en.js";
import german from "./text.de.js";

const languages = { en: english, de: german };
const kept = localStorage.getItem("hil-language");
export const language = kept in languages ? kept : navigator.language.startsWith("de") ? "de" : "en";
document.documentElement.lang = language;

// A text with {0}, {1} replaced; a key without a text shows itself.
export function t(key, ...values) {
  const text = languages[language][key] ?? key;
  return text.replace(/\{(\d)\}/g, (_, k) => values[k] ?? "");
}

export const other = language === "de" ? "en" : "de";

export function choose(next) {
  localStorage.setItem("hil-language", next);
  location.reload();
}
