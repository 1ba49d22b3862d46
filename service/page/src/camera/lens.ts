/**
 * How a fixed camera sees and where it hangs, from points of the floor and where they are in its picture: the same
 * camera that the service finds when it reads the rig (square pixels, the axis through the middle of the picture;
 * first by Zhang 2000, section 3.1, then by least squares of the pixels). Metres of the map; pixels from the upper
 * left corner.
 */

import type { Point } from "../map/model";

type Triple = [number, number, number];
/** By columns. */
type Matrix = [Triple, Triple, Triple];

export interface Pair {
  readonly pixel: Point;
  readonly place: Point;
}

export interface Lens {
  readonly focal_px: number;
  /** Its place over the floor: x and y, and how high. */
  readonly place: Point;
  readonly height_m: number;
  /** How far each point's pixel is from where the lens sees it [px]. */
  readonly off_px: readonly number[];
  /** The pixel at which it sees a place of the floor; null: it is behind it. */
  see(place: Point): Point | null;
}

export type Fault = "line" | "mirror" | "crossed" | "focal";

/** Of what the two equations hold: with less they tell no focal length. */
const LEAST_SHARE = 1e-3;
/** How far from a line points have to be, of how far they are from one another. */
const LEAST_ASIDE = 0.03;
const ROUNDS = 30;
const SLOPE_STEP = 1e-6;
const POLAR_ROUNDS = 12;

/** The lens, or why there is none; `focal_px` null: as the points tell. */
export function lensOver(pairs: readonly Pair[], size: Point, focal_px: number | null): Lens | Fault {
  const middle: Point = [size[0] / 2, size[1] / 2];
  const pixels = pairs.map(({ pixel }): Point => [pixel[0] - middle[0], pixel[1] - middle[1]]);
  const centre = meanOf(pairs.map(({ place }) => place));
  const places = pairs.map(({ place }): Point => [place[0] - centre[0], place[1] - centre[1]]);
  if (isOnLine(pixels) || isOnLine(places)) return "line";
  const found = homography(places, pixels);
  if (found === null) return "line";
  const sides = places.map(([x, y]) => found[0][2] * x + found[1][2] * y + found[2][2]);
  if (!(Math.min(...sides) > 0)) return "crossed";
  // Seen from above, the floor turns the other way in a picture, whose y axis points down.
  if (dot(cross(found[0], found[1]), found[2]) > 0) return "mirror";
  const focal = focal_px ?? focalOf(found);
  if (focal === null) return "focal";
  const pose = refined(poseOf(found, focal), places, pixels, focal_px === null);
  const [x, y, height_m] = pose.turn.map((axis) => -dot(axis, pose.origin)) as Triple;
  const see = ([x_m, y_m]: Point): Point | null => {
    const seen = seenBy(pose, [x_m - centre[0], y_m - centre[1]]);
    return seen && [seen[0] + middle[0], seen[1] + middle[1]];
  };
  const off_px = pairs.map(({ pixel, place }) => {
    const seen = see(place);
    return seen === null ? Infinity : Math.hypot(seen[0] - pixel[0], seen[1] - pixel[1]);
  });
  return { focal_px: pose.focal_px, place: [x + centre[0], y + centre[1]], height_m, off_px, see };
}

/** Whether all of them lie on one line, or all but one: then they say nothing about what is beside it. */
function isOnLine(points: readonly Point[]): boolean {
  const spans = [0, 1]
    .map((axis) => points.map((each) => each[axis]!))
    .map((all) => Math.max(...all) - Math.min(...all));
  const least = LEAST_ASIDE * Math.max(...spans);
  const isLine = ([ax, ay]: Point, [bx, by]: Point): boolean => {
    const [x, y] = [bx - ax, by - ay];
    const length = Math.hypot(x, y);
    const isAside = ([cx, cy]: Point): boolean => Math.abs(x * (cy - ay) - y * (cx - ax)) > least * length;
    return length > least && points.filter(isAside).length < 2;
  };
  return least === 0 || points.some((a, i) => points.slice(i + 1).some((b) => isLine(a, b)));
}

/** From the floor to the picture, by the linear equations; the places and the pixels are about their middles. */
function homography(places: readonly Point[], pixels: readonly Point[]): Matrix | null {
  const m = Math.max(...places.map(([x, y]) => Math.hypot(x, y)));
  const p = Math.max(...pixels.map(([u, v]) => Math.hypot(u, v)));
  const h = leastSquares(
    places.flatMap(([x_m, y_m], i) => {
      const [x, y, u, v] = [x_m / m, y_m / m, pixels[i]![0] / p, pixels[i]![1] / p];
      return [
        [x, y, 1, 0, 0, 0, -u * x, -u * y, u],
        [0, 0, 0, x, y, 1, -v * x, -v * y, v],
      ];
    }),
  );
  if (h === null) return null;
  const [a, b, c, d, e, f, g, k] = h as [number, number, number, number, number, number, number, number];
  return [
    [(a * p) / m, (d * p) / m, g / m],
    [(b * p) / m, (e * p) / m, k / m],
    [c * p, f * p, 1],
  ];
}

/** What solves rows of coefficients and a right side best; null: they say too little (Gauss, with pivots). */
function leastSquares(rows: readonly number[][]): number[] | null {
  const count = rows[0]!.length - 1;
  const sums = Array.from({ length: count }, (_, i) =>
    Array.from({ length: count + 1 }, (_, j) => rows.reduce((sum, row) => sum + row[i]! * row[j]!, 0)),
  );
  for (let i = 0; i < count; i++) {
    const best = sums.reduce(
      (at, row, j) => (j > i && Math.abs(row[i]!) > Math.abs(sums[at]![i]!) ? j : at),
      i,
    );
    [sums[i], sums[best]] = [sums[best]!, sums[i]!];
    const pivot = sums[i]!;
    if (!(Math.abs(pivot[i]!) > 1e-14)) return null;
    for (const row of sums) {
      if (row === pivot) continue;
      const share = row[i]! / pivot[i]!;
      for (let j = i; j <= count; j++) row[j]! -= share * pivot[j]!;
    }
  }
  return sums.map((row, i) => row[count]! / row[i]!);
}

function focalOf([one, two]: Matrix): number | null {
  const a: Point = [one[0] * two[0] + one[1] * two[1], square(one) - square(two)];
  const b: Point = [one[2] * two[2], one[2] ** 2 - two[2] ** 2];
  const found = -(a[0] ** 2 + a[1] ** 2) / (a[0] * b[0] + a[1] * b[1]);
  const isTold = Math.max(Math.abs(a[0]), Math.abs(a[1])) >= LEAST_SHARE * (square(one) + square(two));
  return found > 0 && isTold ? Math.sqrt(found) : null;
}

function square([x, y]: Triple): number {
  return x * x + y * y;
}

/** turn: the axes of the map as the camera sees them; origin: so is the middle of the places [m]. */
interface Pose {
  focal_px: number;
  turn: Matrix;
  origin: Triple;
}

function poseOf(found: Matrix, focal_px: number): Pose {
  let ways = found.map(([x, y, z]): Triple => [x / focal_px, y / focal_px, z]) as Matrix;
  const scale = Math.sqrt(Math.hypot(...ways[0]) * Math.hypot(...ways[1]));
  ways = ways.map((way) => way.map((each) => each / scale)) as Matrix;
  return { focal_px, turn: nearestTurn([ways[0], ways[1], cross(ways[0], ways[1])]), origin: ways[2] };
}

/** From the middle of the picture; null: behind the camera. */
function seenBy({ focal_px, turn: [right, ahead], origin }: Pose, [x, y]: Point): Point | null {
  const [u, v, depth] = origin.map((each, i) => each + right[i]! * x + ahead[i]! * y) as Triple;
  return depth > 0 ? [(focal_px * u) / depth, (focal_px * v) / depth] : null;
}

/** The pose whose pixels miss the clicked ones least (Levenberg and Marquardt's steps). */
function refined(
  first: Pose,
  places: readonly Point[],
  pixels: readonly Point[],
  isFocalFree: boolean,
): Pose {
  const missed = (pose: Pose): number[] =>
    places.flatMap((place, i) => {
      const seen = seenBy(pose, place);
      return seen === null ? [Infinity, Infinity] : [seen[0] - pixels[i]![0], seen[1] - pixels[i]![1]];
    });
  const costOf = (misses: readonly number[]): number => misses.reduce((sum, each) => sum + each * each, 0);
  let [pose, misses, damping] = [first, missed(first), 1e-3];
  for (let round = 0; round < ROUNDS; round++) {
    const slopes = Array.from({ length: isFocalFree ? 7 : 6 }, (_, j) => {
      const moved = missed(movedBy(pose, unit(j, SLOPE_STEP)));
      return moved.map((each, i) => (each - misses[i]!) / SLOPE_STEP);
    });
    const rows = misses.map((miss, i) => [...slopes.map((slope) => slope[i]!), -miss]);
    const damps = slopes.map((slope, j) => [
      ...unit(j, Math.sqrt(damping * costOf(slope)), slopes.length),
      0,
    ]);
    const step = leastSquares([...rows, ...damps]);
    if (step === null) break;
    const next = movedBy(pose, step);
    const nextMisses = missed(next);
    if (costOf(nextMisses) < costOf(misses)) [pose, misses, damping] = [next, nextMisses, damping / 10];
    else damping *= 10;
  }
  return pose;
}

function unit(at: number, value: number, length = 7): number[] {
  return Array.from({ length }, (_, i) => (i === at ? value : 0));
}

/** Turned by the first three [rad], moved by the next three [m], and zoomed by the last, as a logarithm. */
function movedBy({ focal_px, turn, origin }: Pose, [a, b, c, x, y, z, zoom]: readonly number[]): Pose {
  const about: Triple = [a!, b!, c!];
  const turned = turn.map((way): Triple => {
    const [i, j, k] = cross(about, way);
    return [way[0] + i, way[1] + j, way[2] + k];
  }) as Matrix;
  return {
    focal_px: focal_px * Math.exp(zoom ?? 0),
    turn: nearestTurn(turned),
    origin: [origin[0] + x!, origin[1] + y!, origin[2] + z!],
  };
}

/** The rotation that is nearest to a matrix (polar decomposition by Newton's steps: Higham 1986). */
function nearestTurn(matrix: Matrix): Matrix {
  let turn = matrix;
  for (let round = 0; round < POLAR_ROUNDS; round++) {
    const [a, b, c] = turn;
    const [bc, ca, ab] = [cross(b, c), cross(c, a), cross(a, b)];
    const volume = dot(a, bc);
    const inverse: Matrix = [bc, ca, ab];
    turn = turn.map((way, i) => way.map((each, j) => (each + inverse[i]![j]! / volume) / 2)) as Matrix;
  }
  return turn;
}

function cross(a: Triple, b: Triple): Triple {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

function dot(a: Triple, b: Triple): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function meanOf(points: readonly Point[]): Point {
  const sum = points.reduce(([x, y], each): Point => [x + each[0], y + each[1]], [0, 0]);
  return [sum[0] / points.length, sum[1] / points.length];
}
