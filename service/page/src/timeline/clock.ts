/** Moments, in milliseconds since 1970, as people say them: by one clock on the whole page, always with its zone. */

import { signal } from "@preact/signals";

const KEY = "semap.zone";
const S = 1000;
const MIN = 60 * S;
const H = 60 * MIN;
const D = 24 * H;
const NOW_MS = 10 * S;

export type Zone = "local" | "utc";

/** Whose clock: that of this machine, or UTC. */
export const zone = signal<Zone>(kept()?.getItem(KEY) === "utc" ? "utc" : "local");

export function switchZone(): void {
  zone.value = zone.peek() === "utc" ? "local" : "utc";
  kept()?.setItem(KEY, zone.peek());
}

/** Tests run where there is no browser. */
function kept(): Storage | null {
  return typeof document === "undefined" ? null : localStorage;
}

const named = new Intl.DateTimeFormat("en-GB", { timeZoneName: "short" });

/** The name of the zone at a moment, as it changes with summer time: CET, GMT+9. */
export function zoneName(moment: number): string {
  if (zone.value === "utc") return "UTC";
  return named.formatToParts(moment).find((each) => each.type === "timeZoneName")?.value ?? "";
}

/** How far the clock is ahead of UTC at a moment, in milliseconds. */
export function offsetOf(moment: number): number {
  return zone.value === "utc" ? 0 : -new Date(moment).getTimezoneOffset() * MIN;
}

/** Date and time with tenths of a second, and the zone. */
export function momentText(moment: number): string {
  return `${dateText(moment)} ${clockText(moment, 100)}`;
}

/** The time of day, and the zone. */
export function clockText(moment: number, step_ms: number): string {
  return `${timeText(moment, step_ms)} ${zoneName(moment)}`;
}

export function dateText(moment: number): string {
  return shown(moment).slice(0, 10);
}

/** The time of day, as exactly as steps of this length need; its zone stands elsewhere. */
export function timeText(moment: number, step_ms: number): string {
  return shown(moment).slice(11, step_ms < S ? 21 : step_ms < MIN ? 19 : 16);
}

/** A moment by the clock as RFC 3339, which can be typed and read again. */
export function stampText(moment: number): string {
  const minutes = offsetOf(moment) / MIN;
  const sign = minutes < 0 ? "-" : "+";
  const far = `${sign}${two(Math.floor(Math.abs(minutes) / 60))}:${two(Math.abs(minutes) % 60)}`;
  return shown(moment).slice(0, -1) + (zone.value === "utc" ? "Z" : far);
}

/** A text of the service with its stamps by the clock. */
export function withClock(text: string): string {
  return text.replace(/\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:\.\d+)?(?:Z|[+-]\d\d:?\d\d)/g, (stamp) => {
    const moment = Date.parse(stamp.replace(" ", "T"));
    return Number.isNaN(moment) ? stamp : momentText(moment);
  });
}

/** A length of time in words as short as it may be: 4.2 s, 3 min 05 s, 2 h 10 min, 3 d. */
export function durationText(length_ms: number): string {
  const seconds = length_ms / S;
  if (seconds < 60) return `${seconds < 10 ? seconds.toFixed(1) : Math.round(seconds)} s`;
  if (length_ms < H) return `${Math.floor(seconds / 60)} min ${two(Math.floor(seconds % 60))} s`;
  if (length_ms < D) return `${Math.floor(length_ms / H)} h ${two(Math.floor((length_ms % H) / MIN))} min`;
  return `${Math.floor(length_ms / D)} d`;
}

/** How long ago something was, in one word of time: now, 25 s ago, 10 months ago; or how far ahead of this clock. */
export function agoText(ago_ms: number): string {
  const far = Math.abs(ago_ms);
  if (far < NOW_MS) return "now";
  const units: readonly [number, string, string][] = [
    [365 * D, "year", "years"],
    [30 * D, "month", "months"],
    [D, "day", "days"],
    [H, "h", "h"],
    [MIN, "min", "min"],
    [S, "s", "s"],
  ];
  const [length, one, many] = units.find(([each]) => far >= each)!;
  const count = Math.floor(far / length);
  return `${count} ${count === 1 ? one : many} ${ago_ms > 0 ? "ago" : "ahead"}`;
}

/** A moment by the clock, as if that were UTC. */
function shown(moment: number): string {
  return new Date(moment + offsetOf(moment)).toISOString();
}

function two(value: number): string {
  return String(value).padStart(2, "0");
}
