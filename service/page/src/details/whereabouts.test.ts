import { expect, test } from "vitest";

import { lengthOf, staysOf, whereAt } from "./whereabouts";

const DAY = Date.parse("2026-01-05T00:00:00Z");
const S = 1000;
const at = (seconds: number): string => new Date(DAY + seconds * S).toISOString();
const stays = staysOf(
  [
    { instance_id: 3, name: "hall", from: at(300), to: null },
    { instance_id: 2, name: "lab", from: at(100), to: at(160) },
    { instance_id: 1, name: "kitchen", from: at(0), to: at(100) },
  ],
  DAY + 400 * S,
);
const parts = [
  [
    [0, 0, DAY],
    [3, 4, DAY + 200 * S],
  ],
  [
    [3, 4, DAY + 290 * S],
    [3, 8, DAY + 400 * S],
  ],
] as const;

test("where somebody was is the rooms of that moment, no room, or not known", () => {
  const told = [-10, 0, 99, 100, 180, 250, 295, 300, 999].map((seconds) => {
    const found = whereAt({ stays, parts }, DAY + seconds * S);
    if (found.kind === "rooms") return found.stays.map((each) => each.name).join();
    return found.kind === "outside" || found.since === null ? found.kind : (found.since - DAY) / S;
  });
  expect(told).toEqual(["unseen", "kitchen", "kitchen", "lab", "outside", 200, "outside", "hall", "hall"]);
});

test("the way is as long as its lines, and nothing where he was not seen", () => {
  expect(lengthOf(parts)).toBe(9);
});
