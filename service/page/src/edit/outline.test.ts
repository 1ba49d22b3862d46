import { describe, expect, it } from "vitest";

import type { Point } from "../map/model";
import { faultOf, mayFollow, polygonOf } from "./outline";

const SQUARE: Point[] = [
  [0, 0],
  [4, 0],
  [4, 3],
  [0, 3],
];

describe("faultOf", () => {
  it("finds nothing wrong with a square, in either direction, or with a room round a corner", () => {
    expect(faultOf(SQUARE)).toBeNull();
    expect(faultOf([...SQUARE].reverse())).toBeNull();
    expect(
      faultOf([
        [6, 0],
        [8, 0],
        [8, 4],
        [14, 4],
        [14, 6],
        [0, 6],
        [0, 4],
        [6, 4],
      ]),
    ).toBeNull();
  });

  it.each<[string, Point[]]>([
    ["Place the first corner.", []],
    [
      "An area needs three corners.",
      [
        [0, 0],
        [1, 0],
      ],
    ],
    [
      "Two corners are at the same place.",
      [
        [0, 0],
        [1, 0],
        [1, 0],
        [0, 1],
      ],
    ],
    [
      "Its sides cross.",
      [
        [0, 0],
        [4, 3],
        [4, 0],
        [0, 3],
      ],
    ],
    [
      "Its sides cross.",
      [
        [0, 0],
        [4, 0],
        [2, 0],
        [2, 2],
      ],
    ],
    [
      "Its sides touch.",
      [
        [0, 0],
        [4, 0],
        [4, 3],
        [2, 0],
        [0, 3],
      ],
    ],
    [
      "It has no area.",
      [
        [0, 0],
        [1e-3, 0],
        [0, 1e-3],
      ],
    ],
  ])("says: %s", (fault, ring) => expect(faultOf(ring)).toBe(fault));
});

describe("mayFollow", () => {
  it("refuses a side that crosses another, and the same corner again", () => {
    expect(
      mayFollow(
        [
          [0, 0],
          [4, 0],
          [4, 3],
        ],
        [2, -1],
      ),
    ).toBe(false);
    expect(
      mayFollow(
        [
          [0, 0],
          [4, 0],
          [4, 3],
        ],
        [0, 3],
      ),
    ).toBe(true);
    expect(mayFollow([[0, 0]], [0, 0])).toBe(false);
  });
});

describe("polygonOf", () => {
  it("closes the ring and turns it counter-clockwise", () =>
    expect(
      polygonOf([
        [
          [0, 3],
          [4, 3],
          [4, 0],
          [0, 0],
        ],
      ]).coordinates,
    ).toEqual([
      [
        [0, 0],
        [4, 0],
        [4, 3],
        [0, 3],
        [0, 0],
      ],
    ]));

  it("turns a hole the other way", () =>
    expect(
      polygonOf([
        SQUARE,
        [
          [1, 1],
          [2, 1],
          [2, 2],
        ],
      ]).coordinates[1],
    ).toEqual([
      [2, 2],
      [2, 1],
      [1, 1],
      [2, 2],
    ]));
});
