import { expect, test } from "vitest";

import type { TrackState } from "../documents";
import { move, newMover, settle, tell, trailIndex, turn } from "./movement";

function state(x_m: number, y_m: number, more: Partial<TrackState> = {}): TrackState {
  return {
    track_id: 1,
    name: "ann",
    stamp: "2026-01-05T09:00:00Z",
    x_m,
    y_m,
    z_m: null,
    heading_rad: null,
    speed_mps: null,
    length_m: null,
    width_m: null,
    cov_xx_m2: null,
    cov_xy_m2: null,
    cov_yy_m2: null,
    rooms: [],
    ended: false,
    ...more,
  };
}

test("a turn goes the shorter way", () => {
  expect(turn(0, 1)).toBeCloseTo(1);
  expect(turn(3, -3)).toBeCloseTo(2 * Math.PI - 6);
  expect(turn(-3, 3)).toBeCloseTo(6 - 2 * Math.PI);
  expect(turn(0, 7 * Math.PI)).toBeCloseTo(Math.PI);
});

test("it moves from where it is drawn to where it was told to be, and stays there", () => {
  const mover = newMover(state(0, 0), 0);
  for (let now = 100; now <= 2000; now += 100) {
    tell(mover, state(now / 1000, 0), now);
    move(mover, now + 50);
  }
  // States come every 100 ms: the time that a move takes has come to that.
  expect(mover.interval_ms).toBeGreaterThan(99);
  expect(mover.interval_ms).toBeLessThan(101);
  expect(move(mover, 2000 + mover.interval_ms - 1)).toBe(true);
  expect(mover.x_m).toBeLessThan(2);
  expect(move(mover, 2000 + mover.interval_ms)).toBe(false);
  expect(mover.x_m).toBe(2);
  expect(move(mover, 9000)).toBe(false);
  expect(mover.x_m).toBe(2);
});

test("between two states it never steps back or jumps, whenever it is drawn", () => {
  const mover = newMover(state(0, 0), 0);
  let last = 0;
  for (let now = 0; now < 5000; now += 7) {
    if (now % 98 === 0) tell(mover, state(now / 1000, 0), now);
    move(mover, now);
    expect(mover.x_m).toBeGreaterThanOrEqual(last);
    expect(mover.x_m - last).toBeLessThan(0.03);
    last = mover.x_m;
  }
});

test("what is too far to be walked is a jump, without a trail across", () => {
  const mover = newMover(state(0, 0), 0);
  tell(mover, state(1, 0), 100);
  tell(mover, state(40, 0), 200);
  move(mover, 201);
  expect(mover.x_m).toBe(40);
  expect(mover.trailLength).toBe(1);
});

test("it faces where it goes while no heading is told, and where it is told to face else", () => {
  const mover = newMover(state(0, 0), 0);
  expect(mover.hasHeading).toBe(false);
  tell(mover, state(0, 1), 100);
  expect(mover.hasHeading).toBe(true);
  expect(mover.heading_rad).toBeCloseTo(Math.PI / 2);
  tell(mover, state(0, 2, { heading_rad: 0 }), 200);
  move(mover, 5000);
  expect(mover.heading_rad).toBeCloseTo(0);
});

test("a trail keeps the newest places in their order", () => {
  const mover = newMover(state(0, 0), 0);
  for (let i = 1; i <= 200; i++) tell(mover, state(i / 10, 0), 100 * i);
  const xs = Array.from({ length: mover.trailLength }, (_, i) => mover.trail[trailIndex(mover, i)]!);
  expect(xs.length).toBe(64);
  xs.forEach((x, i) => expect(x).toBeCloseTo(20 - i / 10, 4));
});

test("settled, it is where it was told to be", () => {
  const mover = newMover(state(0, 0), 0);
  tell(mover, state(1, 1), 100);
  settle(mover);
  expect([mover.x_m, mover.y_m]).toEqual([1, 1]);
  move(mover, 101);
  expect([mover.x_m, mover.y_m]).toEqual([1, 1]);
});
