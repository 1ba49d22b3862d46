import { expect, test } from "vitest";

import { limitsOf, warmthOf } from "./warmth";

const HOURS = new Map([
  [1, 0],
  [2, 0.1],
  [3, 4],
  [4, 8],
  [5, 6.1],
]);

test("rooms have the colours of their share of the most", () => {
  expect([...warmthOf(HOURS)]).toEqual([
    [1, 0],
    [2, 1],
    [3, 2],
    [4, 5],
    [5, 5],
  ]);
  expect(limitsOf(HOURS)).toEqual([0, 2, 4, 6, 8]);
});

test("where nobody was anywhere, no room has a colour", () => {
  expect([...warmthOf(new Map([[1, 0]]))]).toEqual([[1, 0]]);
  expect(limitsOf(new Map())).toEqual([0, 0, 0, 0, 0]);
});
