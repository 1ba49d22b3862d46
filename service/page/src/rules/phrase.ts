/** Sentences with gaps, and durations as a number and a unit. */

import { t } from "../language/catalogue";

/** Texts and, at odd places, names of gaps: `a {b} c` is a, b, c. */
export function partsOf(phrase: string): string[] {
  return phrase.split(/\{(\w+)\}/);
}

export const UNITS = { s: t("seconds"), min: t("minutes"), h: t("hours"), d: t("days") } as const;
export type Unit = keyof typeof UNITS;

/** `1.5 h`, `90`; one of another unit is in seconds. */
export function durationOf(text: string): { count: string; unit: Unit } {
  const [, count = "", unit = ""] = /^\s*([\d.]*)\s*([a-z]*)\s*$/.exec(text) ?? [];
  if (unit in UNITS) return { count, unit: unit as Unit };
  const seconds = Number(count) / ({ us: 1e6, ms: 1e3 }[unit] ?? 1);
  return { count: count === "" ? "" : String(seconds), unit: "s" };
}

/** The first of `name`, `name_2` … that no rule has. */
export function freeName(name: string, taken: readonly string[]): string {
  let found = name;
  for (let n = 2; taken.includes(found); n++) found = `${name}_${n}`;
  return found;
}

/** `a`, `a and b`, `a, b and c`. */
export function listed(words: readonly string[]): string {
  return words.length < 2
    ? words.join("")
    : t("{0} and {1}", words.slice(0, -1).join(", "), words[words.length - 1]);
}
