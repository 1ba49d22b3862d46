import { describe, expect, it } from "vitest";

import type { RuleWords } from "../documents";
import { completionAt } from "./completion";

const WORDS: RuleWords = {
  clauses: ["name", "input", "where", "partition_by", "pattern", "define", "emit"],
  properties: ["track", "track_id", "type", "instance", "occupants"],
  functions: ["first", "count"],
  pattern_words: ["followed", "by", "not"],
  formula_words: ["always"],
  room: ["kitchen", "O'Brien", "Lab"],
  door: ["kitchen door"],
  instance: ["table"],
  person: ["Ann", "Bob"],
  concept: ["Room", "Door"],
  query: ["track_in_room"],
  rule: ["visits"],
  state: ["door"],
  value: ["open", "closed"],
};
const HEAD = "name: a\ninput: track_in_room\n";

/** What is offered where | stands. */
function offered(marked: string, isAsked = false): string[] {
  const found = completionAt(marked.replace("|", ""), marked.indexOf("|"), WORDS, isAsked);
  return (found?.options ?? []).map((each) => each.word);
}

/** The text after the first option was taken. */
function taken(marked: string): string {
  const text = marked.replace("|", "");
  const found = completionAt(text, marked.indexOf("|"), WORDS)!;
  return text.slice(0, found.from) + found.options[0]!.inserted + text.slice(found.to);
}

describe("what is offered", () => {
  it.each([
    ["wh|", ["where"]],
    ["name: ki|", []],
    ["name: a\ninput: tr|", ["track_in_room"]],
    ["name: a\ninput: [track_in_room, {object_state: d|", ["door"]],
    ["name: a\ninput: {obj|", ["object_state"]],
    [`${HEAD}where: "instance = '|`, ["kitchen", "O'Brien", "Lab", "kitchen door", "table"]],
    [`${HEAD}where: "room = 'K|`, ["kitchen"]],
    [`${HEAD}where: "room in ('Lab', 'o|`, ["O'Brien"]],
    [`${HEAD}where: isA('|')`, ["Room", "Door"]],
    [`${HEAD}where: "first(O.actor) = 'b|`, ["Bob"]],
    [`${HEAD}where: "type = 'b|`, ["began"]],
    [`${HEAD}where: "type = 'began' and in|`, ["instance"]],
    [`${HEAD}where: occ|`, ["occupants"]],
    [`${HEAD}where: occupants|`, []],
    [`${HEAD}partition_by: [track, in|`, ["instance"]],
    [`${HEAD}pattern: Open fol|`, ["followed"]],
    [`${HEAD}pattern: Open Enter\ndefine:\n  En|`, ["Enter", "Open"]],
    [`${HEAD}pattern: Open Enter\ndefine:\n  Enter: track_id = Open.|`, WORDS.properties],
    [`${HEAD}pattern: Open Enter\ndefine:\n  Enter: track_id = Op|`, ["Open"]],
    [`${HEAD}emit: {beg|`, ["began"]],
    [`${HEAD}emit: {began: be|`, []],
    [`${HEAD}where: occupants > 1   # whe|`, []],
    [`${HEAD}where: |`, []],
  ])("%j", (text, options) => expect(offered(text)).toEqual(options));

  it("is all that fits where it is asked for", () =>
    expect(offered(`${HEAD}partition_by: |`, true)).toEqual(WORDS.properties));
});

describe("what is taken", () => {
  it.each([
    ["wh|", "where: "],
    [`${HEAD}where: "room = 'o|`, `${HEAD}where: "room = 'O''Brien'`],
    [`${HEAD}where: "room = 'O''B|'"`, `${HEAD}where: "room = 'O''Brien'"`],
    [`${HEAD}where: fir|`, `${HEAD}where: first(`],
  ])("%j", (text, written) => expect(taken(text)).toBe(written));
});
