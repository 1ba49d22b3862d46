/** The scale of the timeline: from moments, in milliseconds since 1970, to pixels. Pure. */

import type { Span } from "../state";
import { dateText, offsetOf, timeText } from "./clock";

const SHORTEST_MS = 2_000;
const LONGEST_MS = 400 * 86_400_000;
const LEAST_BETWEEN_TICKS_PX = 92;

const S = 1000;
const MIN = 60 * S;
const H = 60 * MIN;
const D = 24 * H;
const STEPS = [
  100,
  200,
  500,
  S,
  2 * S,
  5 * S,
  10 * S,
  15 * S,
  30 * S,
  MIN,
  2 * MIN,
  5 * MIN,
  10 * MIN,
  15 * MIN,
  30 * MIN,
  H,
  2 * H,
  3 * H,
  6 * H,
  12 * H,
  D,
  2 * D,
  7 * D,
  14 * D,
  28 * D,
  91 * D,
];

export function pixelOf(span: Span, width_px: number, moment: number): number {
  return ((moment - span.from) / (span.to - span.from)) * width_px;
}

export function momentAt(span: Span, width_px: number, x_px: number): number {
  return span.from + (x_px / width_px) * (span.to - span.from);
}

/** The span after zooming by a factor (above 1: nearer) around a moment, which stays where it is. */
export function zoomed(span: Span, factor: number, around: number): Span {
  const length = clamp((span.to - span.from) / factor, SHORTEST_MS, LONGEST_MS);
  const part = (around - span.from) / (span.to - span.from);
  const from = around - part * length;
  return { from, to: from + length };
}

export function panned(span: Span, by_ms: number): Span {
  return { from: span.from + by_ms, to: span.to + by_ms };
}

/** The span of the same length in which the newest moment is near the end; the span itself where it is seen already. */
export function following(span: Span, newest: number): Span {
  const length = span.to - span.from;
  if (newest >= span.from && newest <= span.to - 0.02 * length) return span;
  const to = newest + 0.12 * length;
  return { from: to - length, to };
}

export interface Tick {
  moment: number;
  label: string;
  /** At the begin of a day: the label is a date. */
  isDay: boolean;
}

/** Where times are written, by the clock that is chosen. */
export function ticksOf(span: Span, width_px: number): Tick[] {
  const perPixel = (span.to - span.from) / Math.max(width_px, 1);
  const step = STEPS.find((each) => each / perPixel >= LEAST_BETWEEN_TICKS_PX) ?? STEPS[STEPS.length - 1]!;
  const offset = -offsetOf(span.from);
  const ticks: Tick[] = [];
  for (let local = Math.ceil((span.from - offset) / step) * step; local + offset <= span.to; local += step) {
    const moment = local + offset;
    const isDay = local % D === 0;
    ticks.push({ moment, isDay, label: isDay ? dateText(moment) : timeText(moment, step) });
  }
  return ticks;
}

function clamp(value: number, least: number, most: number): number {
  return Math.min(most, Math.max(least, value));
}
