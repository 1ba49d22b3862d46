import { expect, test } from "vitest";

import { propertyOf, sentenceOf, titleOf } from "./words";

const told = { track: { id: 1, name: "Bob" }, instance: { id: 2, name: "office 2" }, measures: {}, key: {} };

test("names become titles", () => {
  expect(["left_then_closed", "room_visits", "whoIsThere", "came-in", "_"].map(titleOf)).toEqual([
    "Left, then closed",
    "Room visits",
    "Who is there",
    "Came in",
    "_",
  ]);
});

test("properties have a title, and their unit beside the value", () => {
  expect(propertyOf("gap_s", 1.8)).toEqual(["Gap", "1.8 s"]);
  expect(propertyOf("fire_rating_w_m2", 3.14159)).toEqual(["Fire rating", "3.142 W/m²"]);
  expect(propertyOf("likelihood", 0.7606)).toEqual(["Likelihood", "76 %"]);
  expect(propertyOf("is_external", true)).toEqual(["Is external", "yes"]);
  expect(propertyOf("leaf", { hinge: "left", max_deg: 95 })).toEqual(["Leaf", "Hinge left, Max 95°"]);
});

test("events are told in sentences", () => {
  expect(sentenceOf({ ...told, type: "entered" }, null)).toBe("Bob entered office 2");
  const closed = { ...told, instance: { id: 3, name: "door 2" }, key: { room: "office 2" } };
  expect(sentenceOf({ ...closed, type: "left_then_closed", measures: { gap_s: 1.1 } }, null)).toBe(
    "Bob left office 2 and closed the door, 1.1 s later",
  );
});

test("what no word is known of is told by its title", () => {
  expect(sentenceOf({ ...told, type: "too_many_people" }, null)).toBe("Too many people: Bob, office 2");
  expect(sentenceOf({ ...told, track: null, type: "crowded" }, null)).toBe("Crowded: office 2");
  expect(sentenceOf({ ...told, track: null, instance: null, type: "a_b" }, null)).toBe("A b");
});
