/** Where a corner goes when it is placed near something: onto a corner, an edge, or in line with others. */

import type { Outline, Point } from "../map/model";
import { distance, nearestOn, sidesOf } from "./plane";

export interface Snapped {
  point: Point;
  /** What it was drawn to; null: nothing, so it is on the grid. */
  to: "start" | "corner" | "edge" | "line" | null;
}

export interface Drawing {
  /** Corners that are placed already, in their order. */
  corners: readonly Point[];
  outlines: readonly Outline[];
  /** Near means within this [m]. */
  reach_m: number;
  grid_m: number;
  /** Keeps sides along x and y. */
  square?: boolean;
}

/** A corner comes before an edge, an edge before being in line with the corners that are there. */
export function snap(place: Point, drawing: Drawing): Snapped {
  const { corners, reach_m } = drawing;
  const first = corners[0];
  if (first !== undefined && corners.length > 2 && distance(first, place) <= reach_m)
    return { point: first, to: "start" };
  const turned = drawing.square === true ? squared(place, corners.at(-1)) : place;
  const corner = nearest(
    turned,
    drawing.outlines.flatMap((outline) => outline.flat()),
  );
  if (corner !== null && distance(corner, turned) <= reach_m) return { point: corner, to: "corner" };
  const sides = drawing.outlines.flatMap((outline) => outline.flatMap(sidesOf));
  const onEdge = nearest(
    turned,
    sides.map((side) => nearestOn(side, turned).point),
  );
  if (onEdge !== null && distance(onEdge, turned) <= reach_m)
    return { point: alongEdge(onEdge, turned, sides, drawing), to: "edge" };
  return inLine(turned, drawing);
}

/** The point straight above, below or beside the last corner. */
function squared(place: Point, last: Point | undefined): Point {
  if (last === undefined) return place;
  return Math.abs(place[0] - last[0]) > Math.abs(place[1] - last[1])
    ? [place[0], last[1]]
    : [last[0], place[1]];
}

function nearest(place: Point, points: readonly Point[]): Point | null {
  let best: Point | null = null;
  for (const point of points)
    if (best === null || distance(point, place) < distance(best, place)) best = point;
  return best;
}

/** On an edge that runs along an axis the other coordinate keeps to the grid, or in line with a corner. */
function alongEdge(
  onEdge: Point,
  place: Point,
  sides: readonly (readonly [Point, Point])[],
  drawing: Drawing,
): Point {
  const side = sides.find((each) => distance(nearestOn(each, place).point, onEdge) === 0);
  if (side === undefined) return onEdge;
  const free = side[0][0] === side[1][0] ? 1 : side[0][1] === side[1][1] ? 0 : null;
  if (free === null) return onEdge;
  const wanted = inLine(place, drawing).point[free];
  const moved: [number, number] = [onEdge[0], onEdge[1]];
  moved[free] = wanted;
  return nearestOn(side, moved).point;
}

function inLine(place: Point, { corners, reach_m, grid_m }: Drawing): Snapped {
  const found: [number, number] = [onGrid(place[0], grid_m), onGrid(place[1], grid_m)];
  let to: Snapped["to"] = null;
  for (const axis of [0, 1] as const) {
    const near = corners
      .map((corner) => corner[axis])
      .filter((value) => Math.abs(value - place[axis]) <= reach_m);
    const value = near.sort((a, b) => Math.abs(a - place[axis]) - Math.abs(b - place[axis]))[0];
    if (value !== undefined) {
      found[axis] = value;
      to = "line";
    }
  }
  return { point: found, to };
}

function onGrid(value: number, grid_m: number): number {
  return Math.round(value / grid_m) * grid_m;
}

/** The step of the grid that is about as fine as can be aimed at: 1 cm to 1 m. */
export function gridFor(metresPerPixel: number): number {
  return [0.01, 0.05, 0.1, 0.5].find((step) => step >= 4 * metresPerPixel) ?? 1;
}
