/** Days, by the clock of the page: from midnight to midnight, which is not always 24 hours. */

import type { Span } from "../state";
import { dayText, zone } from "./clock";

/** The day that a moment is in. */
export function dayOf(moment: number): Span {
  const [year, month, day] = partsOf(dayText(moment));
  return { from: momentOf(year, month, day), to: momentOf(year, month, day + 1) };
}

/** The month that a moment is in. */
export function monthOf(moment: number): Span {
  const [year, month] = partsOf(dayText(moment));
  return { from: momentOf(year, month, 1), to: momentOf(year, month + 1, 1) };
}

/** A moment from a date and a time of day as fields give them; null where they are none. */
export function momentFrom(date: string, time: string): number | null {
  if (!/^\d{4,}-\d\d-\d\d$/.test(date) || !/^\d\d:\d\d/.test(time)) return null;
  const [hours = 0, minutes = 0, seconds = 0] = time.split(":").map(Number);
  return momentOf(...partsOf(date), hours, minutes, seconds);
}

function partsOf(date: string): [year: number, month: number, day: number] {
  const [year = 0, month = 1, day = 1] = date.split("-").map(Number);
  return [year, month, day];
}

function momentOf(year: number, month: number, day: number, ...time: [number?, number?, number?]): number {
  const [hours = 0, minutes = 0, seconds = 0] = time;
  return zone.value === "utc"
    ? Date.UTC(year, month - 1, day, hours, minutes, seconds)
    : new Date(year, month - 1, day, hours, minutes, seconds).getTime();
}
