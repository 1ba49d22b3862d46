/** What is under the pointer. */

import { Box3, Vector3, type Ray } from "three";

import type { Place } from "../app";
import type { Mover } from "../live/movement";
import type { Thing } from "../map/model";
import { areaOf, outlineContains } from "../map/shape";
import type { Selection } from "../state";
import { radiusOf, type Crowd } from "./crowds";
import type { View } from "./view";

const NEAR_TRACK_PX = 15;
const NEAR_DOOR_PX = 9;
const NEAR_POINT_PX = 12;

/** A floor, and what stands on it. */
export interface Level {
  readonly z_m: number;
  readonly things: readonly Thing[];
}

/** The floors of rooms, the highest first, each with what stands between it and the next. */
export function levelsOf(things: readonly Thing[]): Level[] {
  const floors = things.filter((each) => each.kind === "room").map((each) => each.zMin_m);
  const levels = [...new Set(floors.length > 0 ? floors : [0])]
    .sort((a, b) => b - a)
    .map((z_m) => ({ z_m, things: [] as Thing[] }));
  for (const thing of things)
    (levels.find((each) => each.z_m <= thing.zMin_m) ?? levels.at(-1)!).things.push(thing);
  return levels;
}

/** The instance at a place: a door that is near, else the smallest thing or room around it. */
export function instanceAt(
  things: readonly Thing[],
  { x_m, y_m }: Place,
  metresPerPixel: number,
): number | null {
  let found: number | null = null;
  let smallest = Infinity;
  for (const thing of things) {
    if (
      thing.kind === "door" &&
      thing.line &&
      distanceToLine(thing.line, x_m, y_m) < NEAR_DOOR_PX * metresPerPixel
    )
      return thing.id;
    for (const outline of thing.outlines) {
      if (!outlineContains(outline, [x_m, y_m])) continue;
      const area = areaOf(outline);
      if (area < smallest) [found, smallest] = [thing.id, area];
    }
    if (thing.outlines.length === 0 && thing.line === null) {
      if (Math.hypot(thing.place[0] - x_m, thing.place[1] - y_m) < NEAR_POINT_PX * metresPerPixel)
        [found, smallest] = [thing.id, 0];
    }
  }
  return found;
}

/** The thing with heights that a line of sight meets first; rooms are looked into. */
export function instanceAlong(levels: readonly Level[], ray: Ray): number | null {
  const box = new Box3();
  const hit = new Vector3();
  let found: number | null = null;
  let nearest = Infinity;
  for (const thing of levels.flatMap((each) => each.things)) {
    if (thing.kind === "room" || thing.zMax_m === null) continue;
    box.makeEmpty();
    for (const point of thing.outlines.flatMap((outline) => outline[0] ?? []).concat(thing.line ?? [])) {
      box.expandByPoint(hit.set(point[0], point[1], thing.zMin_m));
    }
    if (box.isEmpty()) continue;
    box.max.z = thing.zMax_m;
    box.expandByScalar(0.03);
    if (ray.intersectBox(box, hit) === null) continue;
    const distance = hit.distanceTo(ray.origin);
    if (distance < nearest) [found, nearest] = [thing.id, distance];
  }
  return found;
}

/** What is under a pixel: a track that is near, else an instance. */
export function pick(
  view: View,
  levels: readonly Level[],
  movers: readonly Mover[],
  floorOf: (mover: Mover) => number | null,
  x_px: number,
  y_px: number,
): Selection | null {
  view.camera();
  const at = { x: 0, y: 0 };
  let nearest = NEAR_TRACK_PX;
  let track: number | null = null;
  for (const mover of movers) {
    const floor = floorOf(mover);
    if (floor === null || !view.project(mover.x_m, mover.y_m, floor, at)) continue;
    const distance = Math.hypot(at.x - x_px, at.y - y_px);
    if (distance < nearest) [track, nearest] = [mover.state.track_id, distance];
  }
  if (track !== null) return { kind: "track", id: track };
  const id = (view.mix > 0 ? instanceAlong(levels, view.sight(x_px, y_px)) : null) ?? onFloors();
  return id === null ? null : { kind: "instance", id };

  /** A floor covers those below it. */
  function onFloors(): number | null {
    for (const { z_m, things } of levels) {
      const found = instanceAt(things, view.placeAt(x_px, y_px, z_m), view.metresPerPixel());
      if (found !== null) return found;
    }
    return null;
  }
}

/** The crowd whose mark is under a pixel. */
export function crowdAt(view: View, crowds: readonly Crowd[], x_px: number, y_px: number): Crowd | null {
  view.camera();
  const at = { x: 0, y: 0 };
  for (const crowd of crowds) {
    if (!view.project(crowd.x_m, crowd.y_m, crowd.floor_m, at)) continue;
    if (Math.hypot(at.x - x_px, at.y - y_px) < radiusOf(crowd.count)) return crowd;
  }
  return null;
}

function distanceToLine([[ax, ay], [bx, by]]: NonNullable<Thing["line"]>, x: number, y: number): number {
  const squared = (bx - ax) ** 2 + (by - ay) ** 2;
  const t =
    squared === 0 ? 0 : Math.max(0, Math.min(1, ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / squared));
  return Math.hypot(x - ax - t * (bx - ax), y - ay - t * (by - ay));
}
