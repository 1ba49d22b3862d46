import { describe, expect, it } from "vitest";

import { momentText } from "../timeline/clock";
import { keyOf, lossOf, madeBy, offsetOf, readBy, withNewLine } from "./text";

const TEXT = "name: a\nemit:\n  began: b\n";

describe("offsetOf", () => {
  it("finds a place, or the end before it", () => {
    expect(offsetOf(TEXT, 1, 1)).toBe(0);
    expect(TEXT.slice(offsetOf(TEXT, 3, 3))).toBe("began: b\n");
    expect(offsetOf(TEXT, 1, 99)).toBe(7);
    expect(offsetOf(TEXT, 99, 1)).toBe(TEXT.length);
  });
});

describe("withNewLine", () => {
  it("goes further in after a colon", () =>
    expect(withNewLine("emit:", 5, 5)).toEqual({ text: "emit:\n  ", caret: 8 }));

  it("keeps to the line before, and replaces what is chosen", () =>
    expect(withNewLine("emit:\n  a: b", 12, 12).text).toBe("emit:\n  a: b\n  "));

  it("replaces what is chosen", () => expect(withNewLine("abcd", 1, 3)).toEqual({ text: "a\nd", caret: 2 }));
});

describe("a declaration", () => {
  it("says what it makes, reads and tells apart", () => {
    const declared = {
      input: ["track_in_room", { object_state: "door", actor_within_m: 1.5 }, { map: true }],
      partition_by: ["track", "room"],
      emit: { match: "a", timeout: "b" },
    };
    expect(madeBy(declared)).toEqual(["a", "b"]);
    expect(madeBy({ emit: "a" })).toEqual(["a"]);
    expect(readBy(declared)).toEqual(["track_in_room", "door", "the map"]);
    expect(readBy({ input: { rule: "visits" } })).toEqual(["visits"]);
    expect(keyOf(declared)).toEqual(["track", "room"]);
    expect(keyOf({ partition_by: "room" })).toEqual(["room"]);
    expect(keyOf({})).toEqual([]);
  });
});

describe("lossOf", () => {
  it("names the first stamp and its key", () => {
    const first = "2026-01-31T12:00:00Z";
    expect(lossOf({ attempts: 2, first, key: { track: "ann", room: "Room07" } })).toContain(
      `begin at ${momentText(Date.parse(first))} or later may be missing (first of track ann, room Room07). Give`,
    );
    expect(lossOf({ attempts: 1, first, key: {} })).toContain("may be missing. Give");
    expect(lossOf({ attempts: 0, first, key: {}, matches: 6382 })).toMatch(
      /^6,382 matches were .*may be missing. Say how/,
    );
  });
});
