/** Whether corners make an area that semap takes, and its document. */

import type { AreaDocument, PolygonDocument } from "../documents";
import type { Outline, Point } from "../map/model";
import { areaOf, cross, distance, nearestOn, sidesOf } from "./plane";
import { t } from "../language/catalogue";

const SAME_M = 1e-6;
const SMALLEST_M2 = 1e-4;

/** What is wrong with a ring of corners, as a sentence for its author; null: nothing. */
export function faultOf(ring: readonly Point[]): string | null {
  if (ring.length < 3)
    return ring.length === 0 ? t("Place the first corner.") : t("An area needs three corners.");
  const sides = sidesOf(ring);
  if (sides.some(([a, b]) => distance(a, b) < SAME_M)) return t("Two corners are at the same place.");
  for (const [i, side] of sides.entries()) {
    for (const [j, other] of sides.entries()) {
      if (j > i && cross(side, other)) return t("Its sides cross.");
      const isNext = j === i || j === (i + 1) % sides.length;
      if (!isNext && distance(nearestOn(other, side[1]).point, side[1]) < SAME_M)
        return t("Its sides touch.");
    }
  }
  return Math.abs(areaOf(ring)) < SMALLEST_M2 ? t("It has no area.") : null;
}

/** Whether a corner may follow those that are there: the new side crosses none of them. */
export function mayFollow(corners: readonly Point[], next: Point): boolean {
  const last = corners.at(-1);
  if (last === undefined) return true;
  if (distance(last, next) < SAME_M) return false;
  return !corners.slice(1).some((corner, i) => cross([corners[i] as Point, corner], [last, next]));
}

/** GeoJSON in metres; rings are closed and the outer one is counter-clockwise, as RFC 7946 (3.1.6) has them. */
export function polygonOf(rings: readonly (readonly Point[])[]): PolygonDocument {
  return {
    type: "Polygon",
    coordinates: rings.map((ring, i) => {
      const turned = areaOf(ring) > 0 === (i === 0) ? ring : [...ring].reverse();
      return [...turned, turned[0] as Point].map(([x, y]) => [metres(x), metres(y)]);
    }),
  };
}

/** To a tenth of a millimetre: no map is more exact, and the numbers stay readable. */
export function metres(value: number): number {
  return Math.round(value * 1e4) / 1e4;
}

/** Its parts, each a ring and its holes, without their first points repeated. */
export function outlinesOf(area: AreaDocument): Outline[] {
  const open = (ring: number[][]): Point[] => ring.slice(0, -1).map(([x, y]) => [x ?? 0, y ?? 0]);
  return (area.type === "Polygon" ? [area.coordinates] : area.coordinates).map((rings) => rings.map(open));
}
