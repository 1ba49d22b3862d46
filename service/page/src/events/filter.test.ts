import { expect, test } from "vitest";

import { EVERYTHING, isEverything, merged } from "./filter";

const event = (event_id: string, second: number, seq: number) => ({
  event_id,
  stamp: `2026-01-05T09:00:0${second}.000000Z`,
  seq,
});

test("lists are put together, the newest first, each event once", () => {
  const [a, b, c] = [event("a", 1, 4), event("b", 2, 2), event("c", 2, 3)];
  expect(merged([a, b], [c, a])).toEqual([c, b, a]);
  expect(merged([])).toEqual([]);
});

test("everything is wanted where nothing is said", () => {
  expect(isEverything(EVERYTHING)).toBe(true);
  expect(isEverything({ ...EVERYTHING, day: "2026-01-05" })).toBe(false);
});
