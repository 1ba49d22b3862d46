import { expect, test } from "vitest";

import type { Snapshot, TrackState } from "../documents";
import { World } from "./world";

function track(track_id: number, x_m: number, ended = false): TrackState {
  return {
    track_id,
    name: `t${track_id}`,
    stamp: "2026-01-05T09:00:00Z",
    x_m,
    y_m: 0,
    z_m: null,
    heading_rad: null,
    speed_mps: null,
    length_m: null,
    width_m: null,
    cov_xx_m2: null,
    cov_xy_m2: null,
    cov_yy_m2: null,
    rooms: [],
    ended,
  };
}

const FIRST: Snapshot = {
  stamp: "2026-01-05T09:00:00Z",
  tracks: [track(1, 0), track(2, 5)],
  doors: [{ instance_id: 7, name: "D", state: "open", since: null }],
  rooms: { "3": 2 },
};
const NOTHING = { stamp: "2026-01-05T09:00:01Z", tracks: [], gone: [], doors: [], rooms: {} };

test("a delta changes what it names and nothing else", () => {
  const world = new World();
  world.take(FIRST, 0);
  const before = world.occupancy;
  world.change({ ...NOTHING, tracks: [track(1, 1)] }, 100);
  expect(world.movers.get(1)!.state.x_m).toBe(1);
  expect(world.movers.get(2)!.state.x_m).toBe(5);
  expect(world.occupancy).toBe(before);
  world.change(
    {
      ...NOTHING,
      rooms: { "3": 1, "4": 1 },
      doors: [{ instance_id: 7, name: "D", state: "closed", since: null }],
    },
    200,
  );
  expect([...world.occupancy]).toEqual([
    [3, 1],
    [4, 1],
  ]);
  expect([...before]).toEqual([[3, 2]]);
  expect(world.doors.get(7)!.state).toBe("closed");
});

test("who has gone or ended is removed, also by a later snapshot", () => {
  const world = new World();
  world.take(FIRST, 0);
  world.change({ ...NOTHING, gone: [1], tracks: [track(2, 5, true)] }, 100);
  expect([...world.movers.keys()]).toEqual([]);
  world.take(FIRST, 200);
  world.take({ ...FIRST, tracks: [track(2, 6)] }, 300);
  expect([...world.movers.keys()]).toEqual([2]);
});

test("it moves on until all are where they were told to be", () => {
  const world = new World();
  world.take(FIRST, 0);
  world.take({ ...FIRST, tracks: [track(1, 1), track(2, 5)] }, 100);
  expect(world.move(110)).toBe(true);
  expect(world.move(10_000)).toBe(false);
  expect(world.movers.get(1)!.x_m).toBe(1);
});
