import { expect, test } from "vitest";

import { EVERYTHING } from "../events/filter";
import { shownIn, textOf, type Shown } from "./address_text";

const FIRST: Shown = {
  map: "office",
  view: "plan",
  storey: null,
  isApart: false,
  at: null,
  chosen: null,
  heat: "now",
  tab: "events",
  find: "",
  events: EVERYTHING,
  span: null,
  eye: null,
  isSideOpen: null,
};
const AT = Date.parse("2026-01-05T09:00:45.250Z");

test("what is as at first is not said", () => {
  expect(textOf(FIRST)).toBe("map=office");
  expect(shownIn("map=office")).toEqual(FIRST);
});

test.each<Partial<Shown>>([
  { map: "Büro & Werk #2/a=b" },
  { view: "space", storey: "*", isApart: true, eye: [1.25, -3, 12.5, 0.35, 0.85] },
  { storey: "1. Stock" },
  {
    events: { text: "bob & ann", type: "left_then_closed", track: "", instance: "Raum 1", day: "2026-01-05" },
  },
  { at: AT, span: { from: AT - 1000, to: AT + 5 }, isSideOpen: false },
  { heat: "week", view: "space" },
  { chosen: { kind: "track", id: 7 }, tab: "details", find: "bob & ann" },
  { chosen: { kind: "instance", id: 9_007_199_254_740_991 }, isSideOpen: true },
  { chosen: { kind: "event", id: "0f8e", stamp: "2026-01-05T09:00:45.250001+00:00" }, tab: "rules" },
])("what is shown is read again as it was: %o", (some) => {
  const shown = { ...FIRST, ...some };
  expect(shownIn(textOf(shown))).toEqual(shown);
});

test("what is said wrongly is as at first", () => {
  const wrong =
    "map=office&view=x&at=noon&track=a&event=1@b&tab=access&time=2026-01-05T09:00Z/2026-01-05T08:00Z&eye=1,2&panels=x";
  expect(shownIn(wrong)).toEqual(FIRST);
  expect(shownIn("map=office&eye=1,2,0,0,0&track=").eye).toBeNull();
});
