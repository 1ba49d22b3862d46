/** Words for people, made of the names that rules and files give to events and properties. */

import type { EventDocument } from "./documents";
import { numbered, t, within } from "./language/catalogue";
import type { MapModel } from "./map/model";
import { durationText } from "./timeline/clock";

type Told = Pick<EventDocument, "type" | "track" | "instance" | "measures"> & { key?: EventDocument["key"] };

/** What somebody does with a room, and with a door. */
const OF_ROOMS: Readonly<Record<string, string>> = {
  entered: t("entered {0}"),
  left: t("left {0}"),
  visited: t("visited {0}"),
  passed: t("passed {0}"),
  stayed: t("stayed in {0}"),
  dwelt: t("dwelt in {0}"),
  waited: t("waited in {0}"),
  fell: t("fell in {0}"),
  slept: t("slept in {0}"),
  appeared: t("appeared in {0}"),
  met: t("met in {0}"),
};
const OF_DOORS: Readonly<Record<string, string>> = {
  opened: t("opened the door"),
  closed: t("closed the door"),
  locked: t("locked the door"),
  unlocked: t("unlocked the door"),
};

/** Endings of names that say a unit. */
const UNITS: readonly (readonly [RegExp, string])[] = [
  [/_w_m2$/, "W/m²"],
  [/_mps2$/, "m/s²"],
  [/_mps$/, "m/s"],
  [/_m2$/, "m²"],
  [/_m3$/, "m³"],
  [/_rad$/, "rad"],
  [/_deg$/, "°"],
  [/_px$/, "px"],
  [/_kg$/, "kg"],
  [/_m$/, "m"],
];
const PARTS_OF_ONE: ReadonlySet<string> = new Set(["likelihood", "probability", "confidence"]);

/** `left_then_closed`: Left, then closed; `whoIsThere`: Who is there. */
export function titleOf(name: string): string {
  const words = name
    .replace(/([a-z\d])([A-Z])/g, (_, before: string, after: string) => `${before} ${after.toLowerCase()}`)
    .replace(/[_-]+/g, " ")
    .trim()
    .replace(/ then /g, ", then ");
  return words === "" ? name : words[0]!.toUpperCase() + words.slice(1);
}

/** A property by its title and its value with its unit: gap_s 1.8 is Gap, 1.8 s. */
export function propertyOf(name: string, value: unknown): readonly [title: string, text: string] {
  if (typeof value === "number") {
    if (/_s$/.test(name)) return [titleOf(name.slice(0, -2)), durationText(1000 * value)];
    if (PARTS_OF_ONE.has(name) && value >= 0 && value <= 1)
      return [titleOf(name), `${Math.round(100 * value)} %`];
    const unit = UNITS.find(([ending]) => ending.test(name));
    const rounded = Number.isInteger(value) ? String(value) : numbered(value);
    if (unit)
      return [titleOf(name.replace(unit[0], "")), unit[1] === "°" ? `${rounded}°` : `${rounded} ${unit[1]}`];
    return [titleOf(name), rounded];
  }
  return [titleOf(name), textOf(value)];
}

function textOf(value: unknown): string {
  if (typeof value === "string") return value;
  if (typeof value === "boolean") return value ? t("yes") : t("no");
  if (Array.isArray(value)) return value.map(textOf).join(", ");
  if (typeof value === "object" && value !== null)
    return Object.entries(value)
      .map(([name, each]) => propertyOf(name, each).join(" "))
      .join(", ");
  return value === null || value === undefined ? "" : String(value);
}

/** What happened, as one would tell it: Bob left Office 2 and closed the door, 1.1 s later. */
export function sentenceOf(event: Told, map: MapModel | null): string {
  const who = event.track?.name ?? (typeof event.measures["who"] === "string" ? event.measures["who"] : "");
  const verbs = event.type.split("_then_");
  const told = verbs.map((verb) => partOf(verb, event, map));
  if (who === "" || told.some((each) => each === null)) return plainly(event, who, map);
  const gap_s = event.measures["gap_s"];
  const done = `${within(who)} ${told.join(t(" and "))}`;
  if (verbs.length < 2 || typeof gap_s !== "number") return done;
  return t("{0}, {1} later", done, durationText(1000 * gap_s));
}

/** One thing that somebody did, with what he did it to; null: that is not known of such a word. */
function partOf(verb: string, event: Told, map: MapModel | null): string | null {
  const ofDoor = OF_DOORS[verb];
  if (ofDoor !== undefined) return ofDoor;
  const room = roomOf(event, map);
  const ofRoom = OF_ROOMS[verb];
  return room === null || ofRoom === undefined ? null : ofRoom.replace("{0}", () => within(room));
}

/** What it is about is the door where one was closed: then the room is what the rule goes by. */
function roomOf({ key, instance }: Told, map: MapModel | null): string | null {
  const named = key?.["room"];
  if (typeof named === "string") {
    const thing = map?.things.find((each) => each.name === named);
    return thing?.alias ?? named;
  }
  return instance === null ? null : nameIn(map, instance.id, instance.name);
}

function plainly(event: Told, who: string, map: MapModel | null): string {
  const where = event.instance === null ? "" : nameIn(map, event.instance.id, event.instance.name);
  const about = [who, where].filter((each) => each !== "").join(", ");
  return about === "" ? titleOf(event.type) : `${titleOf(event.type)}: ${about}`;
}

/** The one name by which something of the map is called everywhere: its alias, where it has one. */
export function nameIn(map: MapModel | null, id: number, otherwise: string | null): string {
  const thing = map?.byId.get(id);
  return thing ? (thing.alias ?? thing.name) : (otherwise ?? "");
}

const DOOR_STATES: Readonly<Record<string, string>> = {
  open: t("open"),
  opening: t("opening"),
  closing: t("closing"),
  closed: t("closed"),
  unknown: t("not known"),
};

/** How a door stands, in a word. */
export function doorState(state: string): string {
  return DOOR_STATES[state] ?? state;
}
