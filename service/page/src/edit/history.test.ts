import { describe, expect, it } from "vitest";

import type { ChangeSummary } from "../documents";
import { stepsOf } from "./history";

/** Changes from the oldest on: [author, what it undoes]. */
function history(...changes: [string, number?][]): ChangeSummary[] {
  return changes
    .map(([author, undoes], i) => ({
      id: i + 1,
      made_at: "",
      author,
      message: null,
      undoes: undoes ?? null,
      rows: 1,
    }))
    .reverse();
}

function ids(changes: ChangeSummary[], author = "ann"): [number | null, number | null] {
  const { undo, redo } = stepsOf(changes, author);
  return [undo?.id ?? null, redo?.id ?? null];
}

describe("stepsOf", () => {
  it("has nothing to undo at first", () => expect(ids([])).toEqual([null, null]));

  it("undoes the author's own newest change", () =>
    expect(ids(history(["ann"], ["ann"], ["bob"]))).toEqual([2, null]));

  it("goes back change by change", () => {
    const changes: [string, number?][] = [["ann"], ["ann"], ["ann", 2]];
    expect(ids(history(...changes))).toEqual([1, 3]);
    expect(ids(history(...changes, ["ann", 1]))).toEqual([null, 4]);
  });

  it("goes forward again in the same steps", () => {
    const back: [string, number?][] = [["ann"], ["ann"], ["ann", 2], ["ann", 1]];
    expect(ids(history(...back, ["ann", 4]))).toEqual([5, 3]);
    expect(ids(history(...back, ["ann", 4], ["ann", 3]))).toEqual([6, null]);
  });

  it("undoes what was done again", () => {
    const again: [string, number?][] = [["ann"], ["ann", 1], ["ann", 2]];
    expect(ids(history(...again))).toEqual([3, null]);
    expect(ids(history(...again, ["ann", 3]))).toEqual([null, 4]);
  });

  it("does nothing again once something else was changed", () =>
    expect(ids(history(["ann"], ["ann"], ["ann", 2], ["ann"]))).toEqual([4, null]));

  it("knows the author beside the name of a token", () =>
    expect(ids(history(["ann (laptop)"], ["anna"]))).toEqual([1, null]));

  it("leaves what others took back", () =>
    expect(ids(history(["ann"], ["ann"], ["bob", 2]))).toEqual([1, null]));
});
