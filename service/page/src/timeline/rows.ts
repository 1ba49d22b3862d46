/** Which rows the timeline has, and where they are. */

import type { MapModel, Thing } from "../map/model";
import { lanesOf, type History, type Position, type Stay } from "./history";
import { t } from "../language/catalogue";

const ROOM_PX = 24;
const DOOR_PX = 18;
const OTHER_PX = 22;
const HEADING_PX = 19;

export type Row = { top_px: number; height_px: number; label: string } & (
  | { kind: "heading" }
  | { kind: "room"; id: number; stays: readonly Stay[]; lanes: readonly number[]; laneCount: number }
  | { kind: "door"; id: number; positions: readonly Position[] }
  | { kind: "other" }
);

type WithoutPlace<T> = T extends unknown ? Omit<T, "top_px" | "height_px"> : never;

/** The rows of a map: its rooms, its doors of which something is known, and one for what happened elsewhere. */
export function rowsOf(map: MapModel, storey: string | null, history: History): Row[] {
  const isShown = (each: Thing): boolean => storey === null || each.storey === null || each.storey === storey;
  const rooms = map.things.filter((each) => each.kind === "room" && isShown(each));
  const doors = map.things.filter(
    (each) =>
      each.kind === "door" &&
      isShown(each) &&
      ((history.positions.get(each.id)?.length ?? 0) > 0 || "leaf" in each.attributes),
  );
  const rows: Row[] = [];
  let top_px = 0;
  const add = (height_px: number, row: WithoutPlace<Row>): void => {
    rows.push({ top_px, height_px, ...row } as Row);
    top_px += height_px;
  };
  if (rooms.length > 0) add(HEADING_PX, { kind: "heading", label: t("Rooms") });
  for (const room of rooms.sort(byName)) {
    const stays = history.stays.get(room.id) ?? [];
    const { lanes, count } = lanesOf(stays);
    add(ROOM_PX, {
      kind: "room",
      id: room.id,
      label: room.alias ?? room.name,
      stays,
      lanes,
      laneCount: Math.max(count, 1),
    });
  }
  if (doors.length > 0) add(HEADING_PX, { kind: "heading", label: t("Doors") });
  for (const door of doors.sort(byName)) {
    add(DOOR_PX, {
      kind: "door",
      id: door.id,
      label: door.alias ?? door.name,
      positions: history.positions.get(door.id) ?? [],
    });
  }
  const ids = new Set(rows.flatMap((row) => ("id" in row ? [row.id] : [])));
  if (history.events.some(({ event }) => event.instance === null || !ids.has(event.instance.id))) {
    add(OTHER_PX, { kind: "other", label: t("Elsewhere") });
  }
  return rows;
}

export function heightOf(rows: readonly Row[]): number {
  const last = rows[rows.length - 1];
  return last ? last.top_px + last.height_px : 0;
}

function byName(a: Thing, b: Thing): number {
  return (a.alias ?? a.name).localeCompare(b.alias ?? b.name, undefined, { numeric: true });
}
