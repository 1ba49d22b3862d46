import { expect, test } from "vitest";

import { durationText } from "./clock";
import { following, momentAt, panned, pixelOf, ticksOf, zoomed } from "./scale";

const SPAN = { from: 1_000_000, to: 1_100_000 };

test("pixels and moments are each other's inverse", () => {
  for (const x of [0, 1, 333.3, 800]) expect(pixelOf(SPAN, 800, momentAt(SPAN, 800, x))).toBeCloseTo(x, 6);
  expect(pixelOf(SPAN, 800, SPAN.to)).toBe(800);
});

test("zooming keeps the moment that it is around at its pixel", () => {
  const around = momentAt(SPAN, 800, 250);
  for (const factor of [0.01, 0.5, 1, 3]) {
    const next = zoomed(SPAN, factor, around);
    expect(pixelOf(next, 800, around)).toBeCloseTo(250, 6);
    expect(next.to - next.from).toBeCloseTo(100_000 / factor, 3);
  }
});

test("zooming has its limits", () => {
  const nearest = zoomed(SPAN, 1e9, 1_050_000);
  expect(nearest.to - nearest.from).toBe(2000);
  const farthest = zoomed(SPAN, 1e-9, 1_050_000);
  expect((farthest.to - farthest.from) / 86_400_000).toBe(400);
});

test("following moves only when the newest moment leaves the picture, and keeps the length", () => {
  expect(following(SPAN, 1_050_000)).toBe(SPAN);
  const next = following(SPAN, 1_099_500);
  expect(next.to - next.from).toBe(100_000);
  expect(next.to).toBeGreaterThan(1_099_500);
  expect(following(SPAN, 5_000_000).from).toBeLessThan(5_000_000);
  expect(panned(SPAN, -500)).toEqual({ from: 999_500, to: 1_099_500 });
});

test("ticks are at whole steps, far enough from each other to be read, at any length", () => {
  for (let length = 2000; length < 4e10; length *= 1.7) {
    const span = { from: 1_767_600_123_456, to: 1_767_600_123_456 + length };
    const ticks = ticksOf(span, 900);
    expect(ticks.length).toBeGreaterThan(0);
    expect(ticks.length).toBeLessThan(11);
    for (const { moment } of ticks) {
      expect(moment).toBeGreaterThanOrEqual(span.from);
      expect(moment).toBeLessThanOrEqual(span.to);
    }
    const gaps = ticks.slice(1).map(({ moment }, i) => moment - ticks[i]!.moment);
    for (const gap of gaps) expect((gap / length) * 900).toBeGreaterThanOrEqual(91);
    expect(new Set(gaps).size).toBeLessThan(2);
  }
});

test("lengths of time in words", () => {
  expect([420, 42_000, 185_000, 7_800_000, 200_000_000].map(durationText)).toEqual([
    "0.4 s",
    "42 s",
    "3 min 05 s",
    "2 h 10 min",
    "2 d",
  ]);
});
