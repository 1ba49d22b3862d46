import { expect, test } from "vitest";

import { concerns, isSame, webhookOf, type Alert } from "./alert";

const ANN: Alert = { map: "m", type: "entered", who: "Ann", where: null };
const event = { type: "entered", track: { id: 1, name: "Ann" }, instance: { id: 2, name: "lab" } };

test("an alert is of a type of events on one map, of somebody and somewhere or not", () => {
  expect(concerns(ANN, "m", event)).toBe(true);
  expect(concerns({ ...ANN, where: "lab" }, "m", event)).toBe(true);
  expect(concerns({ ...ANN, where: "hall" }, "m", event)).toBe(false);
  expect(concerns(ANN, "other", event)).toBe(false);
  expect(concerns({ ...ANN, type: "left" }, "m", event)).toBe(false);
  expect(concerns(ANN, "m", { ...event, track: null })).toBe(false);
  expect(concerns({ ...ANN, who: null }, "m", { ...event, track: null })).toBe(true);
});

test("alerts of the same are the same", () => {
  expect(isSame(ANN, { ...ANN })).toBe(true);
  expect(isSame(ANN, { ...ANN, where: "lab" })).toBe(false);
});

test("a webhook asks for the same by CQL2, with quotes doubled", () => {
  expect(webhookOf({ ...ANN, who: "O'Hara", where: "lab" }, "https://a.example")).toEqual({
    url: "https://a.example",
    maps: ["m"],
    type: "entered",
    filter: "track = 'O''Hara' AND instance = 'lab'",
  });
  expect(webhookOf({ ...ANN, who: null }, "https://a.example")["filter"]).toBe(null);
});
