/** What is shown, as the text behind # of an address: readable, and without what is as it is at first. Pure. */

import { EVERYTHING, type EventFilter } from "../events/filter";
import type { Eye } from "../scene/view";
import type { Heat, Span, Tab, View } from "../state";

export type Chosen =
  | { kind: "instance"; id: number }
  | { kind: "track"; id: number }
  /** By its stamp it is found again. */
  | { kind: "event"; id: string; stamp: string };

export interface Shown {
  map: string | null;
  view: View;
  /** null: the first one. */
  storey: string | null;
  /** All storeys are pulled apart. */
  isApart: boolean;
  /** In milliseconds since 1970; null: what is now. */
  at: number | null;
  chosen: Chosen | null;
  heat: Heat;
  tab: Tab;
  find: string;
  events: EventFilter;
  /** What the timeline shows; null: it follows what is new. */
  span: Span | null;
  /** null: all of the map is seen. */
  eye: Eye | null;
  /** Whether the panels are open; null: as is usual on a window of that size. */
  isSideOpen: boolean | null;
}

const TABS: readonly Tab[] = ["details", "events", "edit", "rules", "queries", "import"];
const HEATS: readonly Heat[] = ["now", "day", "week"];
const FILTERS = Object.keys(EVERYTHING) as (keyof EventFilter)[];
const FIRST_TAB = "events";
const ALL_STOREYS = "*";
/** Less than a pixel, of lengths in metres and of angles in radians. */
const DIGITS = 4;

export function textOf(shown: Shown): string {
  const parts: [string, string][] = [];
  const add = (name: string, value: string | null): void => {
    if (value !== null && value !== "") parts.push([name, value]);
  };
  add("map", shown.map);
  add("view", shown.view === "space" ? "space" : null);
  add("storey", shown.storey);
  add("storeys", shown.isApart ? "apart" : null);
  add("at", shown.at === null ? null : stampOf(shown.at));
  if (shown.chosen?.kind === "event") add("event", `${shown.chosen.id}@${shown.chosen.stamp}`);
  else if (shown.chosen) add(shown.chosen.kind, `${shown.chosen.id}`);
  add("heat", shown.heat === "now" ? null : shown.heat);
  add("tab", shown.tab === FIRST_TAB ? null : shown.tab);
  add("find", shown.find);
  for (const each of FILTERS) add(`events-${each}`, shown.events[each]);
  add("time", shown.span && `${stampOf(shown.span.from)}/${stampOf(shown.span.to)}`);
  add("eye", shown.eye && shown.eye.map((each) => Number(each.toFixed(DIGITS))).join(","));
  add("panels", shown.isSideOpen === null ? null : shown.isSideOpen ? "open" : "closed");
  return new URLSearchParams(parts)
    .toString()
    .replaceAll("%3A", ":")
    .replaceAll("%2C", ",")
    .replaceAll("%2F", "/");
}

/** What an address asks for; what it does not say, or says wrongly, is as it is at first. */
export function shownIn(text: string): Shown {
  const said = new URLSearchParams(text);
  const tab = TABS.find((each) => each === said.get("tab"));
  return {
    map: said.get("map"),
    view: said.get("view") === "space" ? "space" : "plan",
    storey: said.get("storey"),
    isApart: said.get("storeys") === "apart",
    at: momentOf(said.get("at")),
    chosen: chosenOf(said),
    heat: HEATS.find((each) => each === said.get("heat")) ?? "now",
    tab: tab ?? FIRST_TAB,
    find: said.get("find") ?? "",
    events: {
      ...EVERYTHING,
      ...Object.fromEntries(FILTERS.map((each) => [each, said.get(`events-${each}`) ?? ""])),
    },
    span: spanOf(said.get("time")),
    eye: eyeOf(said.get("eye")),
    isSideOpen: { open: true, closed: false }[said.get("panels") ?? ""] ?? null,
  };
}

export const everyStorey = (storey: string | null): string => storey ?? ALL_STOREYS;

export function storeyOf(
  text: string | null,
  storeys: readonly { name: string }[],
): string | null | undefined {
  if (text === ALL_STOREYS) return null;
  return storeys.find((each) => each.name === text)?.name;
}

function chosenOf(said: URLSearchParams): Chosen | null {
  for (const kind of ["instance", "track"] as const) {
    const id = Number(said.get(kind) ?? NaN);
    if (Number.isSafeInteger(id)) return { kind, id };
  }
  const [id = "", stamp = ""] = (said.get("event") ?? "").split("@");
  return momentOf(stamp) === null ? null : { kind: "event", id, stamp };
}

function spanOf(text: string | null): Span | null {
  const [from, to] = (text ?? "").split("/").map(momentOf);
  return from != null && to != null && from < to ? { from, to } : null;
}

function eyeOf(text: string | null): Eye | null {
  const [x = NaN, y = NaN, height = NaN, azimuth = NaN, tilt = NaN] = (text ?? "").split(",").map(Number);
  const eye = [x, y, height, azimuth, tilt] as const;
  return eye.every(Number.isFinite) && height > 0 ? eye : null;
}

function momentOf(text: string | null): number | null {
  const moment = Date.parse(text ?? "");
  return Number.isNaN(moment) ? null : moment;
}

function stampOf(moment: number): string {
  return new Date(moment).toISOString();
}
