/** From how many people on a room has which colour. */
export const OCCUPANCY_STEPS = [0, 1, 2, 3, 5] as const;
