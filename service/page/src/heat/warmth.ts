/** The hours that people spent in rooms, as colours: five steps, the last one from three quarters of the most. Pure. */

import { OCCUPANCY_STEPS } from "../scene/steps";

const STEPS = OCCUPANCY_STEPS.length - 1;

/** Instances' ids with how many people would have the colour that their hours have. */
export function warmthOf(hours: ReadonlyMap<number, number>): ReadonlyMap<number, number> {
  const most = Math.max(0, ...hours.values());
  const step = (each: number): number => (each === 0 ? 0 : Math.max(1, Math.ceil((STEPS * each) / most)));
  return new Map([...hours].map(([id, each]) => [id, OCCUPANCY_STEPS[step(each)]!]));
}

/** Up to how many hours each colour is, the first one of none. */
export function limitsOf(hours: ReadonlyMap<number, number>): number[] {
  const most = Math.max(0, ...hours.values());
  return OCCUPANCY_STEPS.map((_, i) => (most * i) / STEPS);
}
