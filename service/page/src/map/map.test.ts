import { expect, test } from "vitest";

import type { GridDocument } from "../documents";
import { leafOf } from "../scene/doors";
import { ellipse95 } from "../scene/ellipse";
import { readPgm, reduced, shadeOf } from "./grid";
import type { Point } from "./model";
import { modelOf } from "./read";
import { areaOf, contains, longestAxis, outlineContains, visualMiddle } from "./shape";

const SQUARE: Point[] = [
  [0, 0],
  [4, 0],
  [4, 4],
  [0, 4],
];
const L: Point[] = [
  [0, 0],
  [10, 0],
  [10, 1],
  [1, 1],
  [1, 10],
  [0, 10],
];

test("inside, outside, and in a hole", () => {
  const hole: Point[] = [
    [1, 1],
    [2, 1],
    [2, 2],
    [1, 2],
  ];
  expect(contains(SQUARE, [3, 3])).toBe(true);
  expect(contains(SQUARE, [5, 3])).toBe(false);
  expect(outlineContains([SQUARE, hole], [1.5, 1.5])).toBe(false);
  expect(outlineContains([SQUARE, hole], [0.5, 0.5])).toBe(true);
  expect(areaOf([SQUARE, hole])).toBe(15);
});

test("the name of a room is inside of it, also of one that is bent", () => {
  expect(visualMiddle(SQUARE)).toEqual([2, 2]);
  expect(contains(L, visualMiddle(L))).toBe(true);
});

test("the doorway of a door with a shape runs along its longer side, through its middle", () => {
  const [from, to] = longestAxis([
    [
      [
        [1, 2],
        [2, 2],
        [2, 2.2],
        [1, 2.2],
      ],
    ],
  ])!;
  expect([...from, ...to].map((each) => Math.round(each * 1000) / 1000)).toEqual([1, 2.1, 2, 2.1]);
});

test("a map is put together from what three answers say", () => {
  const model = modelOf(
    "office",
    {
      features: [
        {
          id: "u1",
          geometry: {
            type: "Polygon",
            coordinates: [
              [
                [0, 0],
                [4, 0],
                [4, 3],
                [0, 3],
                [0, 0],
              ],
            ],
          },
          properties: {
            name: "R",
            concept: "Kitchen",
            elevation_m: 3,
            height_m: 2.5,
            storey: "first",
            seats: 4,
            attributes: { name: "x" },
          },
        },
        {
          id: "u2",
          geometry: {
            type: "LineString",
            coordinates: [
              [4, 1],
              [4, 2],
            ],
          },
          properties: { name: "D", concept: "Door", joins: ["R"], leaf: "right" },
        },
        {
          id: "new",
          geometry: { type: "Point", coordinates: [1, 1] },
          properties: { name: "made just now" },
        },
      ],
      storeys: { first: 3, ground: 0 },
    },
    [
      { id: 1, uid: "u1", map: "office", name: "R", alias: null, concept: "Kitchen", storey: "first" },
      { id: 2, uid: "u2", map: "office", name: "D", alias: null, concept: "Door", storey: null },
    ],
    [
      { name: "Kitchen", parents: ["Room"] },
      { name: "Room", parents: ["Thing"] },
      { name: "Door", parents: ["Thing"] },
      { name: "Thing", parents: [] },
    ],
  );
  expect(model.things.map((each) => [each.id, each.kind, each.zMin_m, each.zMax_m])).toEqual([
    [1, "room", 3, 5.5],
    [2, "door", 0, null],
  ]);
  expect(model.byId.get(1)!.attributes).toEqual({ seats: 4, name: "x" });
  expect(model.storeys.map((each) => each.name)).toEqual(["ground", "first"]);
  expect(model.bounds).toEqual({ xMin_m: 0, yMin_m: 0, xMax_m: 4, yMax_m: 3 });
  const leaf = leafOf(model.byId.get(2)!)!;
  expect([leaf.hinge, leaf.width_m, leaf.sense]).toEqual([[4, 2], 1, -1]);
});

test("an ellipse holds 95 % of a Gaussian: along its axes it is 2.4477 standard deviations", () => {
  const into = { a_m: 0, b_m: 0, angle_rad: 0 };
  expect(ellipse95(4, 0, 1, into)).toBe(true);
  expect([into.a_m, into.b_m, into.angle_rad]).toEqual([2 * 2.447746830680816, 2.447746830680816, 0]);
  // The covariance of the same, turned by 30 degrees.
  const [c, s] = [Math.cos(Math.PI / 6), Math.sin(Math.PI / 6)];
  ellipse95(4 * c * c + s * s, 3 * s * c, 4 * s * s + c * c, into);
  expect(into.a_m).toBeCloseTo(2 * 2.447746830680816, 9);
  expect(into.angle_rad).toBeCloseTo(Math.PI / 6, 9);
  expect(ellipse95(null, null, null, into)).toBe(false);
  expect(ellipse95(0, 0, 0, into)).toBe(false);
});

test("a PGM with a comment is read, one that is cut off is not", () => {
  const bytes = new TextEncoder().encode("P5\n# from map_server\n3 2\n255\n");
  const whole = new Uint8Array([...bytes, 0, 205, 254, 254, 205, 0]);
  const image = readPgm(whole);
  expect([image.width, image.height, ...image.pixels]).toEqual([3, 2, 0, 205, 254, 254, 205, 0]);
  expect(() => readPgm(whole.subarray(0, whole.length - 1))).toThrow(RangeError);
  const grid = { negate: false, occupied_thresh: 0.65, free_thresh: 0.196 } as GridDocument;
  expect([...shadeOf(grid, image)]).toEqual([255, 45, 0, 0, 45, 255]);
});

test("a grid that is drawn smaller loses no wall", () => {
  const pixels = new Uint8Array(35).fill(0);
  pixels[2 * 7 + 6] = 255;
  const small = reduced({ width: 7, height: 5, pixels }, 4);
  expect([small.width, small.height, ...small.pixels]).toEqual([4, 3, 0, 0, 0, 0, 0, 0, 0, 255, 0, 0, 0, 0]);
});
