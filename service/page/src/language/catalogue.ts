/**
 * All that the page says, in the language of its reader: English is the key, the others are in a file each.
 *
 * The file of a language is read before anything is drawn (a module waits for it), and none is read for English, so that
 * a text that stands in a table of a module is said in the right language as well. Another language is another load.
 */

import type { ComponentChildren } from "preact";

export type Texts = Readonly<Record<string, string>>;

/** The languages, by their tags (BCP 47), as their own readers call them. */
export const LANGUAGES = { en: "English", de: "Deutsch", ar: "العربية" } as const;
export type Language = keyof typeof LANGUAGES;

const RIGHT_TO_LEFT: ReadonlySet<Language> = new Set(["ar"]);
const KEY = "semap.language";

/** The language that was chosen, else the first that the browser is set to and that there is, else English. */
export function chosenOf(kept: string | null, wanted: readonly string[]): Language {
  const known = (tag: string): tag is Language => Object.hasOwn(LANGUAGES, tag);
  return [kept ?? "", ...wanted.map((tag) => tag.toLowerCase().split("-")[0]!)].find(known) ?? "en";
}

/** Tests run where there is no browser. */
const isBrowser = typeof document !== "undefined";

export const language: Language = isBrowser ? chosenOf(localStorage.getItem(KEY), navigator.languages) : "en";

/** For dates and numbers: the reader's own variant of the language, where the browser says one. */
export const locale: string =
  (isBrowser && navigator.languages.find((tag) => tag.toLowerCase().split("-")[0] === language)) || language;

const texts: Texts = await read(language);

if (isBrowser) {
  document.documentElement.lang = language;
  document.documentElement.dir = RIGHT_TO_LEFT.has(language) ? "rtl" : "ltr";
}

async function read(wanted: Language): Promise<Texts> {
  if (wanted === "de") return (await import("./de")).TEXTS;
  if (wanted === "ar") return (await import("./ar")).TEXTS;
  return {};
}

/** Loads the page again in another language; what it shows is in its address. */
export function speak(wanted: Language): void {
  localStorage.setItem(KEY, wanted);
  location.reload();
}

/** A name or number within a text, which keeps its own direction where one reads from right to left. */
export function within(value: unknown): string {
  return RIGHT_TO_LEFT.has(language) ? `\u2068${String(value)}\u2069` : String(value);
}

/** A text, with {0}, {1} … in it filled in. */
export function t(text: string, ...values: readonly unknown[]): string {
  const said = texts[text] ?? text;
  return values.length === 0
    ? said
    : said.replace(/\{(\d)\}/g, (_, i: string) => within(values[Number(i)] ?? ""));
}

/** The same where elements are filled in. */
export function say(text: string, ...values: readonly ComponentChildren[]): ComponentChildren {
  return (texts[text] ?? text)
    .split(/\{(\d)\}/)
    .map((part, i) => (i % 2 === 1 ? values[Number(part)] : part));
}

const written = new Map<number, Intl.NumberFormat>();

/** A number with so many digits after the point, as it is written in the language. */
export function fixed(value: number, digits: number): string {
  let format = written.get(digits);
  if (format === undefined) {
    format = new Intl.NumberFormat(locale, {
      minimumFractionDigits: digits,
      maximumFractionDigits: digits,
      useGrouping: false,
    });
    written.set(digits, format);
  }
  return format.format(value);
}

const counted = new Intl.NumberFormat(locale, { maximumFractionDigits: 3 });

/** A number as it is written in the language, as exactly as it is known. */
export function numbered(value: number): string {
  return counted.format(value);
}
