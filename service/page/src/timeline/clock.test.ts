import { afterEach, expect, test } from "vitest";

import { agoText, clockText, momentText, stampText, withClock, zone } from "./clock";

const WINTER = Date.parse("2026-01-05T09:00:30.25Z");
const D = 86_400_000;

afterEach(() => (zone.value = "local"));

test("a moment has its zone, and UTC is the same everywhere", () => {
  zone.value = "utc";
  expect(momentText(WINTER)).toBe("2026-01-05 09:00:30.2 UTC");
  expect(clockText(WINTER, 60_000)).toBe("09:00 UTC");
  expect(stampText(WINTER)).toBe("2026-01-05T09:00:30.250Z");
});

test("what is written can be read again, by either clock", () => {
  for (const each of ["utc", "local"] as const) {
    zone.value = each;
    expect(Date.parse(stampText(WINTER))).toBe(WINTER);
  }
});

test("the stamps of a text are by the same clock", () => {
  zone.value = "utc";
  expect(withClock("E at 2026-01-05T09:00:30.250000Z, then 2026-01-05 10:00:31+01:00.")).toBe(
    "E at 2026-01-05 09:00:30.2 UTC, then 2026-01-05 09:00:31.0 UTC.",
  );
});

test("how long ago something was is one word of time", () => {
  expect([0, 25_000, 3_600_000, D, 320 * D, -7_200_000].map(agoText)).toEqual([
    "now",
    "25 s ago",
    "1 h ago",
    "1 day ago",
    "10 months ago",
    "2 h ahead",
  ]);
});
