/**
 * Where tracks are drawn between the states that are told.
 *
 * A state arrives every now and then; what is drawn moves from where it was drawn to where it was told to be, in the
 * time that usually passes between two states of this track. So it is one state behind and never jumps, at any pace of
 * a recording. Pure: the time is passed in, milliseconds of one steady clock. Nothing is allocated by `moveAll`.
 */

import type { TrackState } from "../documents";

/** A move as long as this is a jump: nobody walked it. */
const JUMP_M = 5;
const FIRST_INTERVAL_MS = 150;
const SHORTEST_MS = 20;
const LONGEST_MS = 1200;
/** How much the newest interval counts in the usual one. */
const WEIGHT = 0.25;
const TRAIL_POINTS = 64;
/** Steps shorter than this are not kept in the trail. */
const TRAIL_STEP_M = 0.08;

/** A track as it is drawn. */
export interface Mover {
  state: TrackState;
  x_m: number;
  y_m: number;
  z_m: number;
  /** Where it faces; where it goes, while that is not told. */
  heading_rad: number;
  hasHeading: boolean;
  fromX_m: number;
  fromY_m: number;
  fromHeading_rad: number;
  toHeading_rad: number;
  toldAt_ms: number;
  interval_ms: number;
  /** x and y of where it was, the newest last: a ring whose next place is `trailNext`. */
  trail: Float32Array;
  trailLength: number;
  trailNext: number;
}

/** A turn by the shorter way, in (-pi, pi]. */
export function turn(from_rad: number, to_rad: number): number {
  const difference = (to_rad - from_rad) % (2 * Math.PI);
  if (difference > Math.PI) return difference - 2 * Math.PI;
  return difference <= -Math.PI ? difference + 2 * Math.PI : difference;
}

export function newMover(state: TrackState, now_ms: number): Mover {
  const heading = state.heading_rad ?? 0;
  const mover: Mover = {
    state,
    x_m: state.x_m,
    y_m: state.y_m,
    z_m: state.z_m ?? 0,
    heading_rad: heading,
    hasHeading: state.heading_rad !== null,
    fromX_m: state.x_m,
    fromY_m: state.y_m,
    fromHeading_rad: heading,
    toHeading_rad: heading,
    toldAt_ms: now_ms,
    interval_ms: FIRST_INTERVAL_MS,
    trail: new Float32Array(2 * TRAIL_POINTS),
    trailLength: 0,
    trailNext: 0,
  };
  if (state.trail) for (const [x, y] of state.trail) addToTrail(mover, x, y);
  addToTrail(mover, state.x_m, state.y_m);
  if (!mover.hasHeading && mover.trailLength > 1) {
    const [last, before] = [trailIndex(mover, 0), trailIndex(mover, 1)];
    const [dx, dy] = [
      mover.trail[last]! - mover.trail[before]!,
      mover.trail[last + 1]! - mover.trail[before + 1]!,
    ];
    mover.heading_rad = mover.fromHeading_rad = mover.toHeading_rad = Math.atan2(dy, dx);
    mover.hasHeading = true;
  }
  return mover;
}

/** Takes a newer state: from now on it moves there. */
export function tell(mover: Mover, state: TrackState, now_ms: number): void {
  // Where it would be drawn now, though a page in the background draws nothing.
  move(mover, now_ms);
  const passed_ms = now_ms - mover.toldAt_ms;
  const moved_m = Math.hypot(state.x_m - mover.state.x_m, state.y_m - mover.state.y_m);
  mover.interval_ms = clamp(
    mover.interval_ms + WEIGHT * (clamp(passed_ms, SHORTEST_MS, LONGEST_MS) - mover.interval_ms),
    SHORTEST_MS,
    LONGEST_MS,
  );
  const jumps = Math.hypot(state.x_m - mover.x_m, state.y_m - mover.y_m) > JUMP_M;
  const goesTo =
    state.heading_rad ??
    (moved_m > TRAIL_STEP_M ? Math.atan2(state.y_m - mover.state.y_m, state.x_m - mover.state.x_m) : null);
  if (goesTo !== null && !mover.hasHeading) mover.heading_rad = goesTo;
  mover.hasHeading ||= goesTo !== null;
  mover.fromX_m = jumps ? state.x_m : mover.x_m;
  mover.fromY_m = jumps ? state.y_m : mover.y_m;
  mover.fromHeading_rad = mover.heading_rad;
  mover.toHeading_rad = goesTo ?? mover.toHeading_rad;
  mover.z_m = state.z_m ?? mover.z_m;
  mover.toldAt_ms = now_ms;
  mover.state = state;
  if (state.trail) {
    mover.trailLength = 0;
    for (const [x, y] of state.trail) addToTrail(mover, x, y);
  } else if (jumps) mover.trailLength = 0;
  addToTrail(mover, state.x_m, state.y_m);
}

/** Moves to where it is at a time; whether it will move on without a further state. */
export function move(mover: Mover, now_ms: number): boolean {
  const part = clamp((now_ms - mover.toldAt_ms) / mover.interval_ms, 0, 1);
  mover.x_m = mover.fromX_m + part * (mover.state.x_m - mover.fromX_m);
  mover.y_m = mover.fromY_m + part * (mover.state.y_m - mover.fromY_m);
  mover.heading_rad = mover.fromHeading_rad + part * turn(mover.fromHeading_rad, mover.toHeading_rad);
  return part < 1;
}

/** Puts it where it was told to be, without a move. */
export function settle(mover: Mover): void {
  mover.fromX_m = mover.x_m = mover.state.x_m;
  mover.fromY_m = mover.y_m = mover.state.y_m;
  mover.fromHeading_rad = mover.heading_rad = mover.toHeading_rad;
}

/** Moves all; whether one will move on. */
export function moveAll(movers: Iterable<Mover>, now_ms: number): boolean {
  let goesOn = false;
  for (const mover of movers) if (move(mover, now_ms)) goesOn = true;
  return goesOn;
}

/** The point of a trail that is `i` before the newest, as an index into `trail`. */
export function trailIndex(mover: Mover, i: number): number {
  return 2 * ((mover.trailNext - 1 - i + 2 * TRAIL_POINTS) % TRAIL_POINTS);
}

function addToTrail(mover: Mover, x_m: number, y_m: number): void {
  if (mover.trailLength > 0) {
    const last = trailIndex(mover, 0);
    if (Math.hypot(mover.trail[last]! - x_m, mover.trail[last + 1]! - y_m) < TRAIL_STEP_M) return;
  }
  mover.trail[2 * mover.trailNext] = x_m;
  mover.trail[2 * mover.trailNext + 1] = y_m;
  mover.trailNext = (mover.trailNext + 1) % TRAIL_POINTS;
  mover.trailLength = Math.min(mover.trailLength + 1, TRAIL_POINTS);
}

function clamp(value: number, least: number, most: number): number {
  return Math.min(most, Math.max(least, value));
}
