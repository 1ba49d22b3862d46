import { describe, expect, it } from "vitest";

import { durationOf, freeName, listed, partsOf } from "./phrase";

describe("a sentence with gaps", () => {
  it("is texts and gaps in turn", () =>
    expect(partsOf("{person} is in {room}.")).toEqual(["", "person", " is in ", "room", "."]));

  it("lists words", () =>
    expect([listed([]), listed(["a"]), listed(["a", "b", "c"])]).toEqual(["", "a", "a, b and c"]));
});

describe("a duration", () => {
  it.each([
    ["10 min", "10", "min"],
    ["1.5h", "1.5", "h"],
    ["90", "90", "s"],
    ["250 ms", "0.25", "s"],
    [" min", "", "min"],
    ["", "", "s"],
  ])("%j", (text, count, unit) => expect(durationOf(text)).toEqual({ count, unit }));
});

describe("freeName", () => {
  it("counts on", () => {
    expect(freeName("dwelt", ["other"])).toBe("dwelt");
    expect(freeName("dwelt", ["dwelt", "dwelt_2"])).toBe("dwelt_3");
  });
});
