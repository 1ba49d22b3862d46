/** Thinking about outlines in the plane; metres. */

import type { Bounds, Outline, Point, Thing } from "./model";

/** The middle line of an outline along its longest edge: where the leaf of a door is, that has a shape. */
export function longestAxis(outlines: readonly Outline[]): [Point, Point] | null {
  const ring = outlines[0]?.[0];
  if (!ring || ring.length < 2) return null;
  let along: Point = [0, 0];
  let longest = 0;
  ring.forEach(([x, y], i) => {
    const [nextX, nextY] = ring[(i + 1) % ring.length]!;
    const length = Math.hypot(nextX - x, nextY - y);
    if (length > longest) {
      longest = length;
      along = [(nextX - x) / length, (nextY - y) / length];
    }
  });
  if (longest === 0) return null;
  const [ux, uy] = along;
  const alongs = ring.map(([x, y]) => x * ux + y * uy);
  const acrosses = ring.map(([x, y]) => y * ux - x * uy);
  const across = (Math.min(...acrosses) + Math.max(...acrosses)) / 2;
  const at = (s: number): Point => [s * ux - across * uy, s * uy + across * ux];
  return [at(Math.min(...alongs)), at(Math.max(...alongs))];
}

/** A place inside of a ring with room around it, for its name: the best of a grid of candidates. */
export function visualMiddle(ring: readonly Point[]): Point {
  const xs = ring.map(([x]) => x);
  const ys = ring.map(([, y]) => y);
  const [xMin, xMax, yMin, yMax] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  let best: Point = [(xMin + xMax) / 2, (yMin + yMax) / 2];
  // A little more than the middle of a convex room, so that only others have their names moved.
  let bestRoom_m = contains(ring, best) ? distanceToEdge(ring, best) * 1.15 : -1;
  for (const steps of [9, 27, 81]) {
    for (let i = 1; i < steps; i++) {
      for (let j = 1; j < steps; j++) {
        const candidate: Point = [xMin + ((xMax - xMin) * i) / steps, yMin + ((yMax - yMin) * j) / steps];
        if (!contains(ring, candidate)) continue;
        const room_m = distanceToEdge(ring, candidate);
        if (room_m > bestRoom_m) [best, bestRoom_m] = [candidate, room_m];
      }
    }
    // A finer grid is for rooms so narrow that none of it lies inside.
    if (bestRoom_m > 0) break;
  }
  return best;
}

/** Whether a ring has a place inside (even-odd rule). */
export function contains(ring: readonly Point[], [x, y]: Point): boolean {
  let inside = false;
  for (let i = 0, j = ring.length - 1; i < ring.length; j = i++) {
    const [xi, yi] = ring[i]!;
    const [xj, yj] = ring[j]!;
    if (yi > y !== yj > y && x < ((xj - xi) * (y - yi)) / (yj - yi) + xi) inside = !inside;
  }
  return inside;
}

/** Whether an outline has a place inside, and not in one of its holes. */
export function outlineContains(outline: Outline, place: Point): boolean {
  const [outer, ...holes] = outline;
  return outer !== undefined && contains(outer, place) && !holes.some((hole) => contains(hole, place));
}

function distanceToEdge(ring: readonly Point[], [x, y]: Point): number {
  let least = Infinity;
  for (let i = 0, j = ring.length - 1; i < ring.length; j = i++) {
    const [ax, ay] = ring[j]!;
    const [bx, by] = ring[i]!;
    const squared = (bx - ax) ** 2 + (by - ay) ** 2;
    const t =
      squared === 0 ? 0 : Math.max(0, Math.min(1, ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / squared));
    least = Math.min(least, Math.hypot(x - ax - t * (bx - ax), y - ay - t * (by - ay)));
  }
  return least;
}

/** Area of an outline [m^2], without its holes. */
export function areaOf(outline: Outline): number {
  const shoelace = (ring: readonly Point[]): number =>
    Math.abs(
      ring.reduce((sum, [x, y], i) => {
        const [nextX, nextY] = ring[(i + 1) % ring.length]!;
        return sum + x * nextY - nextX * y;
      }, 0),
    ) / 2;
  return outline.reduce((area, ring, i) => (i === 0 ? shoelace(ring) : area - shoelace(ring)), 0);
}

/** What things reach over; null where there is none. */
export function boundsOf(things: readonly Thing[]): Bounds | null {
  let [xMin_m, yMin_m, xMax_m, yMax_m] = [Infinity, Infinity, -Infinity, -Infinity];
  const extend = ([x, y]: Point): void => {
    xMin_m = Math.min(xMin_m, x);
    xMax_m = Math.max(xMax_m, x);
    yMin_m = Math.min(yMin_m, y);
    yMax_m = Math.max(yMax_m, y);
  };
  for (const thing of things) {
    for (const outline of thing.outlines) outline[0]?.forEach(extend);
    thing.line?.forEach(extend);
    extend(thing.place);
  }
  return xMin_m <= xMax_m ? { xMin_m, yMin_m, xMax_m, yMax_m } : null;
}
