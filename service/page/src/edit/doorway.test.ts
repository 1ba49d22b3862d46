import { describe, expect, it } from "vitest";

import type { Point, Thing } from "../map/model";
import { doorwayAt, endsOf } from "./doorway";

function room(name: string, ...ring: Point[]): Thing {
  return {
    id: 1,
    uid: "",
    name,
    alias: null,
    concept: "Room",
    kind: "room",
    storey: null,
    outlines: [[ring]],
    line: null,
    place: [0, 0],
    zMin_m: 0,
    zMax_m: null,
    joins: [],
    attributes: {},
  };
}

const KITCHEN = room("kitchen", [0, 0], [6, 0], [6, 4], [0, 4]);
const HALL = room("hall", [6, 0], [8, 0], [8, 4], [6, 4]);

describe("doorwayAt", () => {
  it("stands in the wall between two rooms and joins them", () => {
    const door = doorwayAt([6.2, 2.02], [KITCHEN, HALL], 0.9, 0.1);
    expect(door?.middle[0]).toBe(6);
    expect(door?.middle[1]).toBeCloseTo(2);
    expect(door?.yaw_rad).toBeCloseTo(Math.PI / 2);
    expect(door?.joins).toEqual(["kitchen", "hall"]);
  });

  it("joins one room where the other side is outside", () =>
    expect(doorwayAt([3, -0.2], [KITCHEN, HALL], 0.9, 0.1)?.joins).toEqual(["kitchen"]));

  it("stays within its wall, and is no wider than that", () => {
    expect(doorwayAt([6, 3.9], [KITCHEN, HALL], 1, 0.1)?.middle).toEqual([6, 3.5]);
    expect(doorwayAt([7, 0], [KITCHEN, HALL], 3, 0.1)?.width_m).toBe(2);
  });

  it("finds rooms behind a wall that is thick", () =>
    expect(
      doorwayAt([6, 2], [KITCHEN, room("lab", [6.25, 0], [9, 0], [9, 4], [6.25, 4])], 1, 0.1)?.joins,
    ).toEqual(["kitchen", "lab"]));

  it("is nowhere without rooms", () => expect(doorwayAt([0, 0], [], 1, 0.1)).toBeNull());

  it("has its hinge at its beginning", () => {
    const door = doorwayAt([3, 0], [KITCHEN], 1, 0.1);
    expect(door === null ? null : endsOf(door)).toEqual([
      [2.5, 0],
      [3.5, 0],
    ]);
  });
});
