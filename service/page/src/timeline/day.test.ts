import { afterEach, expect, test } from "vitest";

import { dateText, timeText, zone } from "./clock";
import { dayOf, momentFrom, monthOf } from "./day";

afterEach(() => (zone.value = "local"));

test("a day is from midnight to midnight by the clock, and a month from its first day", () => {
  for (const each of ["utc", "local"] as const) {
    zone.value = each;
    const moment = momentFrom("2026-02-28", "23:59:59")!;
    for (const { from, to } of [dayOf(moment), monthOf(moment)]) {
      expect([timeText(from, 1000), timeText(to, 1000), dateText(to)]).toEqual([
        "00:00:00",
        "00:00:00",
        "2026-03-01",
      ]);
    }
    expect([dateText(dayOf(moment).from), dateText(monthOf(moment).from)]).toEqual([
      "2026-02-28",
      "2026-02-01",
    ]);
  }
});

test("what is no date or time is no moment", () => {
  expect([momentFrom("", "09:00"), momentFrom("2026-01-05", ""), momentFrom("5 Jan", "9")]).toEqual([
    null,
    null,
    null,
  ]);
});
