/** A door in a wall: where it stands, and which rooms it joins. Metres of the map frame. */

import type { Point, Thing } from "../map/model";
import { outlineContains } from "../map/shape";
import { clamp, distance, nearestOn, sidesOf, type Segment } from "./plane";

/** How far to either side of a doorway its rooms are sought: walls are drawn with or without thickness. */
const BESIDE_M = [0.05, 0.15, 0.3];

export interface Doorway {
  middle: Point;
  /** Along the doorway, from the map's x axis. */
  yaw_rad: number;
  width_m: number;
  /** The names of the rooms on its left and right; one name where one side is outside. */
  joins: string[];
}

/** The wall that is nearest to a place; null where there is none. */
export function wallNear(place: Point, rooms: readonly Thing[]): Segment | null {
  let best: Segment | null = null;
  let least_m = Infinity;
  for (const side of rooms.flatMap((room) => room.outlines.flatMap((outline) => outline.flatMap(sidesOf)))) {
    const far_m = distance(nearestOn(side, place).point, place);
    if (far_m < least_m) [best, least_m] = [side, far_m];
  }
  return best;
}

/** A door at the place of a wall that is nearest, as wide as wanted or as the wall allows. */
export function doorwayAt(
  place: Point,
  rooms: readonly Thing[],
  wanted_m: number,
  grid_m: number,
): Doorway | null {
  const wall = wallNear(place, rooms);
  if (wall === null) return null;
  const [a, b] = rightwards(wall);
  const length_m = distance(a, b);
  if (length_m === 0) return null;
  const width_m = Math.min(wanted_m, length_m);
  const wished_m = Math.round((nearestOn([a, b], place).along * length_m) / grid_m) * grid_m;
  const along = clamp(wished_m, width_m / 2, length_m - width_m / 2) / length_m;
  const middle: Point = [a[0] + along * (b[0] - a[0]), a[1] + along * (b[1] - a[1])];
  const yaw_rad = Math.atan2(b[1] - a[1], b[0] - a[0]);
  return { middle, yaw_rad, width_m, joins: roomsBeside(middle, yaw_rad, rooms) };
}

/** The rooms on either side of a doorway, by name. */
export function roomsBeside(middle: Point, yaw_rad: number, rooms: readonly Thing[]): string[] {
  const found: string[] = [];
  for (const side of [1, -1]) {
    for (const far_m of BESIDE_M) {
      const point: Point = [
        middle[0] - side * far_m * Math.sin(yaw_rad),
        middle[1] + side * far_m * Math.cos(yaw_rad),
      ];
      const room = rooms.find((each) => each.outlines.some((outline) => outlineContains(outline, point)));
      if (room !== undefined && !found.includes(room.name)) {
        found.push(room.name);
        break;
      }
    }
  }
  return found;
}

/** The ends of a doorway, the one with the hinge of a left leaf first. */
export function endsOf({ middle, yaw_rad, width_m }: Doorway): Segment {
  const [x, y] = [(Math.cos(yaw_rad) * width_m) / 2, (Math.sin(yaw_rad) * width_m) / 2];
  return [
    [middle[0] - x, middle[1] - y],
    [middle[0] + x, middle[1] + y],
  ];
}

/** The same wall from its left to its right, or from below: two rooms that share it run along it both ways. */
function rightwards([a, b]: Segment): Segment {
  const isRight = b[0] - a[0] > 1e-9 || (Math.abs(b[0] - a[0]) <= 1e-9 && b[1] > a[1]);
  return isRight ? [a, b] : [b, a];
}
