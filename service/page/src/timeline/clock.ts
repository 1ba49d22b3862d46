/** Moments, in milliseconds since 1970, as people say them: by one clock on the whole page, always with its zone. */

import { signal } from "@preact/signals";

import { fixed, language, locale, t } from "../language/catalogue";

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

const named = new Intl.DateTimeFormat(language === "en" ? "en-GB" : locale, { timeZoneName: "short" });

const dated =
  language === "en"
    ? null
    : new Intl.DateTimeFormat(locale, { day: "2-digit", month: "2-digit", year: "numeric", timeZone: "UTC" });
/** What stands between seconds and their tenths. */
const DECIMAL = fixed(0.5, 1).replace(/\p{Nd}/gu, "");

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

/** The date as it is written in the language; in English, whose readers write it in two orders, as ISO 8601 does. */
export function dateText(moment: number): string {
  return dated === null ? dayText(moment) : dated.format(moment + offsetOf(moment));
}

/** The date as fields and requests take it: 2026-11-24. */
export function dayText(moment: number): string {
  return shown(moment).slice(0, 10);
}

/** The time of day, as exactly as steps of this length need; its zone stands elsewhere. */
export function timeText(moment: number, step_ms: number): string {
  const time = shown(moment).slice(11, step_ms < S ? 21 : step_ms < MIN ? 19 : 16);
  return time.replace(".", DECIMAL);
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
  if (seconds < 60) return t("{0} s", fixed(seconds, seconds < 10 ? 1 : 0));
  if (length_ms < H) return t("{0} min {1} s", Math.floor(seconds / 60), two(Math.floor(seconds % 60)));
  if (length_ms < D)
    return t("{0} h {1} min", Math.floor(length_ms / H), two(Math.floor((length_ms % H) / MIN)));
  return t("{0} d", Math.floor(length_ms / D));
}

/** How long ago something was, in one word of time: now, 25 s ago, 10 months ago; or how far ahead of this clock. */
export function agoText(ago_ms: number): string {
  const far = Math.abs(ago_ms);
  if (far < NOW_MS) return t("now");
  const units: readonly [number, string, string][] = [
    [365 * D, t("{0} year"), t("{0} years")],
    [30 * D, t("{0} month"), t("{0} months")],
    [D, t("{0} day"), t("{0} days")],
    [H, t("{0} h"), t("{0} h")],
    [MIN, t("{0} min"), t("{0} min")],
    [S, t("{0} s"), t("{0} s")],
  ];
  const [length, one, many] = units.find(([each]) => far >= each)!;
  const count = Math.floor(far / length);
  const text = (count === 1 ? one : many).replace("{0}", String(count));
  return ago_ms > 0 ? t("{0} ago", text) : t("{0} ahead", text);
}

/** A moment by the clock, as if that were UTC. */
function shown(moment: number): string {
  return new Date(moment + offsetOf(moment)).toISOString();
}

function two(value: number): string {
  return String(value).padStart(2, "0");
}
