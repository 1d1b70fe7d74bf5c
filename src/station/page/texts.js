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

const meant = (text) => text.replace(/[.*+?^$()|[\]\\]/g, "\\$&");
const sentences = languages[language].said.map(([english, own]) => [new RegExp(`^${meant(english).replace(/\{\d\}/g, "([^]*?)")}$`), own]);

// What the program says, in the language of the page where it has the sentence.
export function told(text) {
  for (const [sentence, own] of sentences) {
    const found = sentence.exec(text);
    if (found) return own.replace(/\{(\d)\}/g, (_, k) => told(found[Number(k) + 1]));
  }
  return text;
}

export const other = language === "de" ? "en" : "de";

export function choose(next) {
  localStorage.setItem("hil-language", next);
  location.reload();
}
