/** What may be typed at a place in a rule: told by the text before it, which need not be right yet. */

import type { RuleWords } from "../documents";

export interface Option {
  word: string;
  /** What it is, for people. */
  kind: string;
  /** What is written, and where it goes on (from the end of that). */
  inserted: string;
}

export interface Completion {
  /** The part of the text that an option replaces. */
  from: number;
  to: number;
  options: readonly Option[];
}

const MOST = 12;
const EDGES = ["began", "ended", "crossed"];
const OUTCOMES = [...EDGES, "match", "timeout", "empty", "unmatched", "holds", "fails"];
const INPUT_KEYS = ["query", "rule", "object_state", "actor_within_m", "map"];

type Named = readonly (readonly [kind: string, words: readonly string[]])[];

/** isAsked  also where nothing of a word is there yet; null: there is nothing to offer */
export function completionAt(
  text: string,
  caret: number,
  words: RuleWords,
  isAsked = false,
): Completion | null {
  const before = text.slice(0, caret);
  const line = before.slice(before.lastIndexOf("\n") + 1);
  if (/(^|\s)#/.test(line.replace(/"[^"]*"|'[^']*'/g, ""))) return null;
  const literal = literalOf(line);
  if (literal !== null) {
    const closing = text[caret] === "'" ? "" : "'";
    return among(literal.prefix, caret, namesFor(literal.property, words), (word) => quoted(word) + closing);
  }
  const prefix = /\w*$/.exec(line)![0];
  if (prefix === "" && !isAsked && !/\w\.$/.test(line)) return null;
  const found = wordsFor(before, line, prefix, words);
  const after = text.slice(caret);
  return among(prefix, caret, found, (word, kind) => {
    if (kind === "clause" && !after.startsWith(":")) return `${word}: `;
    return kind === "function" && !after.startsWith("(") ? `${word}(` : word;
  });
}

/** The text within the quotes of CQL2 that are open at the end of a line, and of what it is compared to. */
function literalOf(line: string): { property: string; prefix: string } | null {
  const open =
    /([\w.]+)(?:\)|\()*\s*(?:=|<>|\bin\s*\((?:\s*'(?:[^']|'')*'\s*,)*|,|\()?\s*'((?:[^']|'')*)$/i.exec(line);
  if (open === null || (line.split("'").length - 1) % 2 === 0) return null;
  return { property: open[1]!, prefix: open[2]!.replaceAll("''", "'") };
}

function namesFor(property: string, words: RuleWords): Named {
  const { room, door, instance, person } = words;
  switch (property.split(".").pop()) {
    case "room":
    case "neighbours":
      return [["room", room]];
    case "instance":
      return [["room", room], ["door", door], ["object", instance]]; // prettier-ignore
    case "door":
      return [["door", door]];
    case "track":
    case "actor":
    case "other":
      return [["person", person]];
    case "subject":
      return [["object", instance]];
    case "concept":
    case "isA":
      return [["concept", words.concept]];
    case "input":
      return [["query", words.query], ["state of objects", words.state], ["rule", words.rule]]; // prettier-ignore
    case "type":
    case "previous":
      return [["change", EDGES], ["state", words.value]]; // prettier-ignore
    default:
      return [];
  }
}

/** Outside of quotes: by the clause that the place is in. */
function wordsFor(before: string, line: string, prefix: string, words: RuleWords): Named {
  if (line === prefix) return [["clause", words.clauses]];
  const clause = [...before.matchAll(/^(\w+):/gm)].pop()?.[1];
  const isKey = /^\s+\w*$/.test(line) || /[{,]\s*\w*$/.test(line.replace(/"[^"]*"/g, ""));
  const variables: Named = [["variable", variablesIn(before.slice(0, before.length - prefix.length), words)]];
  switch (clause) {
    case "input":
      if (/object_state:\s*\w*$/.test(line)) return [["state of objects", words.state]];
      if (/\{[^}]*$/.test(line) && isKey) return [["", INPUT_KEYS]];
      return [["query", words.query], ["state of objects", words.state], ["rule", words.rule]]; // prettier-ignore
    case "partition_by":
      return [["property", words.properties]];
    case "pattern":
      return [["", words.pattern_words], ...variables];
    case "formula":
      return [...variables, ["", words.formula_words]];
    case "when":
    case "about":
    case "after_match":
      return variables;
    case "emit":
      return isKey ? [["", OUTCOMES]] : [];
    case "define":
      if (isKey) return variables;
      break;
    case "where":
    case "measures":
      if (isKey && clause === "measures") return [];
      break;
    default:
      return [];
  }
  const properties: Named = [["property", words.properties]];
  if (/\w\.\w*$/.test(line)) return properties;
  return [...properties, ["function", words.functions], ...variables];
}

/** The variables that the pattern or the conditions before a place name. */
function variablesIn(before: string, words: RuleWords): string[] {
  const said = [...before.matchAll(/^(?:pattern|formula|when):(.*)$/gm)].map((each) => each[1]).join(" ");
  const known = new Set([...words.pattern_words, ...words.formula_words, "min", "ms", "us", "s", "h", "d"]);
  const named = [...said.replace(/#.*/, "").matchAll(/[A-Za-z_]\w*/g)].map((each) => each[0]);
  return [...new Set(named)].filter((each) => !known.has(each));
}

function among(
  prefix: string,
  caret: number,
  named: Named,
  inserted: (word: string, kind: string) => string,
): Completion | null {
  const wanted = prefix.toLowerCase();
  const all = named.flatMap(([kind, words]) => words.map((word) => ({ word, kind })));
  if (all.some(({ word }) => word === prefix)) return null;
  const fits = (how: "startsWith" | "includes") => all.filter(({ word }) => word.toLowerCase()[how](wanted));
  const found = [...new Set([...fits("startsWith"), ...fits("includes")])].slice(0, MOST);
  if (found.length === 0) return null;
  const options = found.map(({ word, kind }) => ({ word, kind, inserted: inserted(word, kind) }));
  return { from: caret - quoted(prefix).length, to: caret, options };
}

function quoted(word: string): string {
  return word.replaceAll("'", "''");
}
