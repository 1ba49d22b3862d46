import { expect, test } from "vitest";

import { Pace } from "./pace";

function run(pace: Pace, frames: number, interval_ms: number): number {
  let changes = 0;
  for (let i = 0; i < frames; i++) if (pace.drawn(i * interval_ms, true)) changes++;
  return changes;
}

test("frames that follow fast keep all pixels", () => {
  const pace = new Pace();
  expect(run(pace, 500, 16)).toBe(0);
  expect(pace.scale).toBe(1);
});

test("slow frames get fewer pixels, down to a limit", () => {
  const pace = new Pace();
  expect(run(pace, 1000, 90)).toBe(3);
  expect(pace.scale).toBe(0.6);
});

test("pauses between frames that were asked for one by one are not slowness", () => {
  const pace = new Pace();
  for (let i = 0; i < 500; i++) expect(pace.drawn(i * 1000, false)).toBe(false);
});
