/** Places in a text, and what the enter key does in YAML. */

import { withClock } from "../timeline/clock";
import { numbered, t } from "../language/catalogue";

/** line, column  from 1; beyond the end of a line or text it is that end */
export function offsetOf(text: string, line: number, column: number): number {
  const lines = text.split("\n");
  const before = lines.slice(0, line - 1).reduce((sum, each) => sum + each.length + 1, 0);
  const within = Math.min(column - 1, lines[line - 1]?.length ?? 0);
  return Math.min(before + within, text.length);
}

/** A new line begins where the one before it does, or further in after a colon. */
export function withNewLine(text: string, start: number, end: number): { text: string; caret: number } {
  const line = text.slice(text.lastIndexOf("\n", start - 1) + 1, start);
  const indent = /^ */.exec(line)?.[0] ?? "";
  const inserted = `\n${indent}${/:\s*$/.test(line) ? "  " : ""}`;
  return { text: text.slice(0, start) + inserted + text.slice(end), caret: start + inserted.length };
}

/** The types of the events that a declaration makes. */
export function madeBy(declaration: Record<string, unknown>): string[] {
  const { emit } = declaration;
  if (typeof emit === "string") return [emit];
  return typeof emit === "object" && emit !== null ? Object.values(emit).map(String) : [];
}

/** The names of what a declaration reads. */
export function readBy(declaration: Record<string, unknown>): string[] {
  const { input } = declaration;
  const inputs: unknown[] = Array.isArray(input) ? input : [input];
  return inputs.flatMap((each) => {
    if (typeof each === "string") return [each];
    if (typeof each !== "object" || each === null) return [];
    if ("map" in each) return [t("the map")];
    const [name] = ["query", "rule", "object_state"]
      .map((kind) => (each as Record<string, unknown>)[kind])
      .filter(Boolean);
    return name === undefined ? [] : [String(name)];
  });
}

/** The properties by which rows are told apart, whose values an explanation asks for. */
export function keyOf(declaration: Record<string, unknown>): string[] {
  const { partition_by } = declaration;
  if (typeof partition_by === "string") return [partition_by];
  return Array.isArray(partition_by) ? partition_by.map(String) : [];
}

type Lost = { attempts: number; first: string; key: Record<string, unknown>; matches?: number };

/** What may be missing of what a rule finds, and what to do. */
export function lossOf({ attempts, first, key, matches = 0 }: Lost): string {
  const of = Object.entries(key).map(([name, value]) => `${name} ${String(value)}`);
  return [
    attempts > 0 && t("More was under way in one key than a rule keeps."),
    matches > 0 && t("{0} matches were found and not told, as more ended at one row.", numbered(matches)),
    t(
      "Events that begin at {0} or later may be missing{1}.",
      withClock(first),
      of.length ? t(" (first of {0})", of.join(", ")) : "",
    ),
    attempts > 0 && t("Give it a window (within), a finer partition_by, or an after_match that skips more."),
    matches > 0 && t("Say how many are wanted: after_match: no skip, at most 100000."),
  ]
    .filter(Boolean)
    .join(" ");
}
