/**
 * Where so many are near each other that no mark could be told from the next, one mark with their number stands for all.
 *
 * The map is divided into squares whose sides are powers of two metres, at least so many pixels long: they stay where they
 * are while the map is moved, so that what stands for whom changes only when people move or the map is zoomed.
 */

import type { Mover } from "../live/movement";

/** A square is from so many pixels to twice as many. */
const LEAST_PX = 18;
/** So many in one square are a crowd. */
const LEAST_PEOPLE = 5;

/** Many people in one place. */
export interface Crowd {
  x_m: number;
  y_m: number;
  floor_m: number;
  count: number;
}

export interface Parted {
  alone: readonly Mover[];
  crowds: readonly Crowd[];
}

/** The side of a square, for a scale. */
export function sideOf(metresPerPixel: number): number {
  return 2 ** Math.ceil(Math.log2(LEAST_PX * metresPerPixel));
}

/**
 * Parts those who are shown into those who stand alone and crowds.
 *
 * floorOf   height of the floor below one; null: he is not shown
 * isMarked  who stands alone always, as he was chosen
 */
export function part(
  movers: Iterable<Mover>,
  metresPerPixel: number,
  floorOf: (mover: Mover) => number | null,
  isMarked: (mover: Mover) => boolean,
): Parted {
  const side = sideOf(metresPerPixel);
  const alone: Mover[] = [];
  const squares = new Map<string, Mover[]>();
  for (const mover of movers) {
    const floor = floorOf(mover);
    if (floor === null) continue;
    if (isMarked(mover)) {
      alone.push(mover);
      continue;
    }
    const key = `${Math.floor(mover.x_m / side)} ${Math.floor(mover.y_m / side)} ${floor}`;
    const here = squares.get(key);
    if (here) here.push(mover);
    else squares.set(key, [mover]);
  }
  const crowds: Crowd[] = [];
  for (const here of squares.values()) {
    if (here.length < LEAST_PEOPLE) alone.push(...here);
    else crowds.push(crowdOf(here, floorOf(here[0]!)!));
  }
  return { alone, crowds };
}

function crowdOf(here: readonly Mover[], floor_m: number): Crowd {
  let [x_m, y_m] = [0, 0];
  for (const mover of here) {
    x_m += mover.x_m / here.length;
    y_m += mover.y_m / here.length;
  }
  return { x_m, y_m, floor_m, count: here.length };
}

/** How large the mark of a crowd is [px]. */
export function radiusOf(count: number): number {
  return 8 + 1.6 * Math.log2(count);
}
