/** The colours of the picture: the theme's, and those of tracks. */

import { Color } from "three";

import { OCCUPANCY_STEPS } from "./steps";

const NAMES = [
  "map-ground",
  "map-wall",
  "map-label",
  "map-label-halo",
  "map-ring",
  "map-thing",
  "map-thing-line",
  "map-grid",
  "map-window",
  "map-select",
  "map-unread",
  "door-open",
  "door-moving",
  "door-closed",
  "door-unknown",
] as const;

export type Colours = Readonly<Record<(typeof NAMES)[number], Color>> & { occupancy: readonly Color[] };

/** The colours as the theme says now. */
export function readColours(): Colours {
  const style = getComputedStyle(document.documentElement);
  const named = (name: string): Color => new Color(style.getPropertyValue(`--${name}`).trim());
  const entries = NAMES.map((name) => [name, named(name)] as const);
  return {
    ...(Object.fromEntries(entries) as Record<(typeof NAMES)[number], Color>),
    occupancy: OCCUPANCY_STEPS.map((step) => named(`occupancy-${step}`)),
  };
}

export function occupancyStep(count: number): number {
  let step = 0;
  OCCUPANCY_STEPS.forEach((least, i) => {
    if (count >= least) step = i;
  });
  return step;
}

/** Okabe and Ito's colours, which most colour-blind people tell apart, without the blue that rooms are tinted with. */
const TRACKS = [
  "#d55e00",
  "#009e73",
  "#cc79a7",
  "#e69f00",
  "#7b4fb5",
  "#8c6d1f",
  "#b5303f",
  "#2a9fb8",
] as const;
const asColours = TRACKS.map((each) => new Color(each));

export function trackColour(trackId: number): Color {
  return asColours[trackId % asColours.length]!;
}

export function trackColourName(trackId: number): string {
  return TRACKS[trackId % TRACKS.length]!;
}
