/** Points, lines and rings of the plan; metres of the map frame. */

import type { Point } from "../map/model";

export type Segment = readonly [Point, Point];

export function distance(a: Point, b: Point): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}

/** The point of a segment that is nearest, and how far along it that is, from 0 to 1. */
export function nearestOn([a, b]: Segment, point: Point): { point: Point; along: number } {
  const [x, y] = [b[0] - a[0], b[1] - a[1]];
  const length2 = x * x + y * y;
  const along = length2 === 0 ? 0 : clamp(((point[0] - a[0]) * x + (point[1] - a[1]) * y) / length2, 0, 1);
  return { point: [a[0] + along * x, a[1] + along * y], along };
}

export function clamp(value: number, low: number, high: number): number {
  return Math.min(Math.max(value, low), high);
}

/** The sides of a ring, the last one back to its first point. */
export function sidesOf(ring: readonly Point[]): Segment[] {
  return ring.map((point, i) => [point, ring[(i + 1) % ring.length] as Point]);
}

/** The area [m²]; negative where the ring runs clockwise. */
export function areaOf(ring: readonly Point[]): number {
  return sidesOf(ring).reduce((sum, [a, b]) => sum + a[0] * b[1] - b[0] * a[1], 0) / 2;
}

/** Whether two segments have more than an end in common. */
export function cross([a, b]: Segment, [c, d]: Segment): boolean {
  const turn = (p: Point, q: Point, r: Point) =>
    (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
  const [abc, abd, cda, cdb] = [turn(a, b, c), turn(a, b, d), turn(c, d, a), turn(c, d, b)];
  if (abc === 0 && abd === 0) {
    const axis = a[0] === b[0] ? 1 : 0;
    const [low, high] = [
      Math.max(lower(a, b, axis), lower(c, d, axis)),
      Math.min(upper(a, b, axis), upper(c, d, axis)),
    ];
    return low < high;
  }
  return abc * abd < 0 && cda * cdb < 0;
}

function lower(a: Point, b: Point, axis: 0 | 1): number {
  return Math.min(a[axis], b[axis]);
}

function upper(a: Point, b: Point, axis: 0 | 1): number {
  return Math.max(a[axis], b[axis]);
}
