import { describe, expect, it } from "vitest";

import type { Outline, Point } from "../map/model";
import { gridFor, snap } from "./snapping";

const ROOM: Outline = [
  [
    [0, 0],
    [6, 0],
    [6, 4],
    [0, 4],
  ],
];
const NOTHING = { corners: [] as Point[], outlines: [] as Outline[], reach_m: 0.2, grid_m: 0.1 };

describe("snap", () => {
  it("keeps to the grid where nothing is near", () => {
    const { point, to } = snap([1.23, 4.56], NOTHING);
    expect(to).toBeNull();
    expect(point[0]).toBeCloseTo(1.2);
    expect(point[1]).toBeCloseTo(4.6);
  });

  it("goes to a corner before an edge", () =>
    expect(snap([6.1, 0.1], { ...NOTHING, outlines: [ROOM] })).toEqual({ point: [6, 0], to: "corner" }));

  it("goes onto an edge, and keeps to the grid along it", () => {
    const { point, to } = snap([6.1, 2.03], { ...NOTHING, outlines: [ROOM] });
    expect(to).toBe("edge");
    expect(point[0]).toBe(6);
    expect(point[1]).toBeCloseTo(2);
  });

  it("goes onto a slanting edge at the nearest place", () => {
    const { point } = snap([2, 1.8], {
      ...NOTHING,
      outlines: [
        [
          [
            [0, 0],
            [4, 4],
            [0, 4],
          ],
        ],
      ],
    });
    expect(point[0]).toBeCloseTo(1.9);
    expect(point[1]).toBeCloseTo(1.9);
  });

  it("lines up with the corners that are there", () =>
    expect(snap([8.13, 0.07], { ...NOTHING, corners: [[6, 0]] }).point[1]).toBe(0));

  it("closes the ring at its first corner, once it has three", () => {
    const corners: Point[] = [
      [1, 1],
      [3, 1],
      [3, 3],
    ];
    expect(snap([1.1, 1.1], { ...NOTHING, corners })).toEqual({ point: [1, 1], to: "start" });
    expect(snap([1.1, 1.1], { ...NOTHING, corners: corners.slice(0, 2) }).to).toBe("line");
  });

  it("keeps sides square", () =>
    expect(snap([5, 1.4], { ...NOTHING, corners: [[1, 1]], square: true }).point).toEqual([5, 1]));
});

describe("gridFor", () => {
  it("is as fine as can be aimed at", () => {
    expect([0.001, 0.01, 0.02, 0.1, 10].map(gridFor)).toEqual([0.01, 0.05, 0.1, 0.5, 1]);
  });
});
