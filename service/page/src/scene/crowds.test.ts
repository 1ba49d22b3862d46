import { expect, test } from "vitest";

import type { TrackState } from "../documents";
import { newMover, type Mover } from "../live/movement";
import { part, radiusOf, sideOf } from "./crowds";

function at(x_m: number, y_m: number, track_id = 1): Mover {
  return newMover(
    { track_id, x_m, y_m, z_m: null, heading_rad: null, rooms: [] } as unknown as TrackState,
    0,
  );
}

const ON_THE_FLOOR = (): number => 0;
const NOBODY = (): boolean => false;
const FIVE = [0.1, 0.2, 0.3, 0.4, 0.5].map((x, i) => at(x, 0.5, i));

test("a square is from 18 pixels to twice as many, by powers of two metres", () => {
  for (const scale of [0.001, 0.01, 0.05, 0.2, 1.7]) {
    const side = sideOf(scale);
    expect(Number.isInteger(Math.log2(side))).toBe(true);
    expect(side / scale).toBeGreaterThanOrEqual(18);
    expect(side / scale).toBeLessThan(36);
  }
});

test("five in one square are a crowd in their middle, four are not", () => {
  const { alone, crowds } = part(FIVE, 1 / 20, ON_THE_FLOOR, NOBODY);
  expect(alone).toEqual([]);
  expect(crowds).toEqual([{ x_m: expect.closeTo(0.3), y_m: expect.closeTo(0.5), floor_m: 0, count: 5 }]);
  expect(part(FIVE.slice(1), 1 / 20, ON_THE_FLOOR, NOBODY)).toEqual({ alone: FIVE.slice(1), crowds: [] });
});

test("nearer, each stands alone; so does who was chosen", () => {
  expect(part(FIVE, 1 / 400, ON_THE_FLOOR, NOBODY).crowds).toEqual([]);
  const chosen = part([...FIVE, at(0.6, 0.5, 9)], 1 / 20, ON_THE_FLOOR, (one) => one.state.track_id === 2);
  expect(chosen.alone.map((one) => one.state.track_id)).toEqual([2]);
  expect(chosen.crowds[0]!.count).toBe(5);
});

test("who is on another storey is in no crowd of this one", () => {
  const floors = (one: Mover): number | null => [0, 0, 3, 3, null][one.state.track_id]!;
  expect(part(FIVE, 1 / 20, floors, NOBODY)).toEqual({ alone: FIVE.slice(0, 4), crowds: [] });
});

test("marks of more people are larger", () => {
  expect(radiusOf(200)).toBeGreaterThan(radiusOf(5));
});
