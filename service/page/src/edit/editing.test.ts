import { describe, expect, it } from "vitest";

import type { Point, Thing } from "../map/model";
import { Editing } from "./editing";

const PIXEL_M = 0.01;

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

function editing(...rooms: Thing[]): Editing {
  return new Editing(
    () => ({ rooms, outlines: rooms.flatMap((each) => each.outlines) }),
    () => PIXEL_M,
  );
}

function draw(tool: Editing, ...corners: Point[]): void {
  tool.drawRoom();
  for (const corner of corners) tool.press(corner, false);
}

describe("a room", () => {
  it("is closed at its first corner", () => {
    const tool = editing();
    draw(tool, [0, 0], [4, 0], [4, 3], [0.05, 0.05]);
    expect(tool.draft.value).toEqual({
      kind: "room",
      corners: [
        [0, 0],
        [4, 0],
        [4, 3],
      ],
      isClosed: true,
    });
    expect(tool.fault.value).toBeNull();
  });

  it("is not closed while its sides cross", () => {
    const tool = editing();
    draw(tool, [0, 0], [4, 3], [4, 0], [0, 3], [0, 0]);
    expect(tool.fault.value).toBe("Its sides cross.");
    expect(tool.draft.value).toMatchObject({ isClosed: false });
  });

  it("goes back corner by corner", () => {
    const tool = editing();
    draw(tool, [0, 0], [4, 0], [4, 3], [0, 0]);
    tool.back();
    tool.back();
    expect(tool.draft.value).toEqual({
      kind: "room",
      corners: [
        [0, 0],
        [4, 0],
      ],
      isClosed: false,
    });
  });

  it("takes no corner twice at one place", () => {
    const tool = editing();
    draw(tool, [0, 0], [4, 0], [4, 0]);
    expect(tool.draft.value).toMatchObject({
      corners: [
        [0, 0],
        [4, 0],
      ],
    });
  });
});

describe("a door", () => {
  it("follows the pointer along the wall until it is placed", () => {
    const tool = editing(KITCHEN);
    tool.drawDoor();
    tool.point([3, 0.1], false);
    expect(tool.draft.value).toMatchObject({
      isPlaced: false,
      doorway: { middle: [3, 0], joins: ["kitchen"] },
    });
    tool.press([2, 0.1], false);
    tool.point([5, 0.1], false);
    expect(tool.draft.value).toMatchObject({ isPlaced: true, doorway: { middle: [2, 0] } });
  });
});

describe("a shape", () => {
  it("moves as a whole when its inside is dragged", () => {
    const tool = editing();
    tool.change(KITCHEN);
    tool.press([3, 2], false);
    tool.point([4, 1], false);
    tool.release();
    tool.point([9, 9], false);
    const draft = tool.draft.value;
    expect(draft).toMatchObject({ moved: [1, -1], isReshaped: false });
    expect(draft?.kind === "shape" ? draft.rings : null).toEqual([
      [
        [1, -1],
        [7, -1],
        [7, 3],
        [1, 3],
      ],
    ]);
  });

  it("has a corner dragged, or one added in a side", () => {
    const tool = editing();
    tool.change(KITCHEN);
    tool.press([6, 4.05], false);
    tool.point([6, 5], false);
    tool.release();
    expect(tool.draft.value).toMatchObject({
      isReshaped: true,
      rings: [
        [
          [0, 0],
          [6, 0],
          [6, 5],
          [0, 4],
        ],
      ],
    });
    tool.press([3, 0.05], false);
    tool.point([3, -1], false);
    tool.release();
    expect(tool.draft.value).toMatchObject({
      rings: [
        [
          [0, 0],
          [3, -1],
          [6, 0],
          [6, 5],
          [0, 4],
        ],
      ],
    });
    tool.removeCorner(0, 1);
    expect(tool.draft.value).toMatchObject({
      rings: [
        [
          [0, 0],
          [6, 0],
          [6, 5],
          [0, 4],
        ],
      ],
    });
  });

  it("keeps three corners at least", () => {
    const tool = editing();
    tool.change(room("a", [0, 0], [1, 0], [0, 1]));
    tool.removeCorner(0, 0);
    expect(tool.draft.value).toMatchObject({ isReshaped: false });
  });
});
