/** Draws the timeline on a canvas, only what is seen, and knows afterwards what lies where. */

import type { EventDocument } from "../documents";
import type { OverlayEvent } from "../app";
import { trackColourName } from "../scene/colours";
import type { Span } from "../state";
import { zoneName } from "./clock";
import { firstAt, type Happened, type Stay } from "./history";
import { heightOf, type Row } from "./rows";
import { pixelOf, ticksOf } from "./scale";

export const LABELS_PX = 128;
export const AXIS_PX = 24;
const MARK_PX = 4.5;
const LEAST_BAR_PX = 1.5;
const NAME_FROM_PX = 34;
/** Events nearer to each other are one mark. */
const TOGETHER_PX = 5;
const NEAR_PX = 8;

export interface Scenery {
  span: Span;
  rows: readonly Row[];
  scroll_px: number;
  /** What is known; what happened before and after it was not read. */
  loaded: Span | null;
  events: readonly Happened[];
  found: readonly OverlayEvent[];
  /** The moment that is shown, or the newest. */
  at: number | null;
  isLive: boolean;
  selected: string | null;
}

export type Target =
  | { kind: "event"; event: EventDocument; count: number }
  | { kind: "found"; event: OverlayEvent }
  | { kind: "stay"; stay: Stay; row: Row };

interface Spot {
  x: number;
  y: number;
  half: number;
  target: Target;
}

interface Inks {
  ink: string;
  soft: string;
  line: string;
  surface: string;
  raised: string;
  accent: string;
  select: string;
  open: string;
  moving: string;
  closed: string;
  unknown: string;
  unread: string;
  font: string;
}

export class Painter {
  private readonly canvas: HTMLCanvasElement;
  private readonly context: CanvasRenderingContext2D;
  private inks: Inks;
  private spots: Spot[] = [];
  private bars: { left: number; right: number; top: number; bottom: number; target: Target }[] = [];
  width_px = 1;
  height_px = 1;

  constructor(canvas: HTMLCanvasElement) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false })!;
    this.inks = readInks();
  }

  recolour(): void {
    this.inks = readInks();
  }

  resize(width_px: number, height_px: number): void {
    this.width_px = width_px;
    this.height_px = height_px;
    const ratio = Math.min(devicePixelRatio, 2);
    this.canvas.width = Math.round(width_px * ratio);
    this.canvas.height = Math.round(height_px * ratio);
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
  }

  get plot_px(): number {
    return Math.max(1, this.width_px - LABELS_PX);
  }

  paint(scenery: Scenery): void {
    const { context, inks } = this;
    this.spots = [];
    this.bars = [];
    context.fillStyle = inks.surface;
    context.fillRect(0, 0, this.width_px, this.height_px);
    this.paintUnread(scenery);
    this.paintTicks(scenery.span);
    context.save();
    context.beginPath();
    context.rect(0, AXIS_PX, this.width_px, this.height_px - AXIS_PX);
    context.clip();
    for (const row of scenery.rows) {
      const top = AXIS_PX + row.top_px - scenery.scroll_px;
      if (top > this.height_px || top + row.height_px < AXIS_PX) continue;
      this.paintRow(row, top, scenery);
    }
    this.paintEvents(scenery);
    this.paintScroll(scenery);
    context.restore();
    this.paintMoment(scenery);
  }

  /** What is drawn at a pixel: an event that is near, else a stay. */
  targetAt(x: number, y: number): Target | null {
    let nearest = NEAR_PX;
    let found: Target | null = null;
    for (const spot of this.spots) {
      const distance = Math.max(Math.abs(spot.x - x) - spot.half + MARK_PX, Math.abs(spot.y - y));
      if (distance < nearest) [found, nearest] = [spot.target, distance];
    }
    if (found) return found;
    return (
      this.bars.find((bar) => x >= bar.left && x <= bar.right && y >= bar.top && y <= bar.bottom)?.target ??
      null
    );
  }

  private x(span: Span, moment: number): number {
    return LABELS_PX + pixelOf(span, this.plot_px, moment);
  }

  private paintTicks(span: Span): void {
    const { context, inks } = this;
    context.font = `11.5px ${inks.font}`;
    context.textBaseline = "middle";
    context.textAlign = "left";
    for (const tick of ticksOf(span, this.plot_px)) {
      const x = Math.round(this.x(span, tick.moment)) + 0.5;
      if (x < LABELS_PX) continue;
      context.strokeStyle = inks.line;
      context.lineWidth = tick.isDay ? 2 : 1;
      line(context, x, AXIS_PX - 6, x, this.height_px);
      context.fillStyle = tick.isDay ? inks.ink : inks.soft;
      context.fillText(tick.label, x + 4, AXIS_PX / 2);
    }
    context.fillStyle = inks.soft;
    context.fillText(zoneName(span.to), 10, AXIS_PX / 2);
    context.lineWidth = 1;
    context.strokeStyle = inks.line;
    line(context, 0, AXIS_PX - 0.5, this.width_px, AXIS_PX - 0.5);
  }

  /** Time of which nothing is known is grey: left white, it would look as if nothing had happened. */
  private paintUnread({ span, loaded }: Scenery): void {
    const newest = Math.min(span.to, this.newest(span));
    const parts: [number, number][] = loaded
      ? [
          [span.from, Math.min(loaded.from, newest)],
          [Math.max(loaded.to, span.from), newest],
        ]
      : [[span.from, newest]];
    this.context.fillStyle = this.inks.unread;
    for (const [from, to] of parts) {
      const left = Math.max(LABELS_PX, this.x(span, from));
      const width = this.x(span, to) - left;
      if (width > 0) this.context.fillRect(left, AXIS_PX, width, this.height_px - AXIS_PX);
    }
  }

  private paintRow(row: Row, top: number, { span }: Scenery): void {
    const { context, inks } = this;
    if (row.kind === "heading") {
      context.fillStyle = inks.soft;
      context.font = `600 11.5px ${inks.font}`;
      context.fillText(row.label, 10, top + row.height_px / 2 + 1);
      return;
    }
    context.save();
    context.beginPath();
    context.rect(LABELS_PX, top, this.plot_px, row.height_px);
    context.clip();
    if (row.kind === "room") this.paintStays(row, top, span);
    else if (row.kind === "door") this.paintPositions(row, top, span);
    context.restore();
    context.strokeStyle = inks.line;
    line(context, LABELS_PX, top + row.height_px - 0.5, this.width_px, top + row.height_px - 0.5);
    context.fillStyle = inks.ink;
    context.font = `12.5px ${inks.font}`;
    context.fillText(fitted(context, row.label, LABELS_PX - 20), 10, top + row.height_px / 2 + 0.5);
  }

  private paintStays(row: Row & { kind: "room" }, top: number, span: Span): void {
    const { context, inks } = this;
    const lane_px = (row.height_px - 5) / row.laneCount;
    context.font = `11px ${inks.font}`;
    row.stays.forEach((stay, i) => {
      if ((stay.to ?? Infinity) < span.from || stay.from > span.to) return;
      const left = Math.max(LABELS_PX - 4, this.x(span, stay.from));
      const right = Math.max(
        left + LEAST_BAR_PX,
        Math.min(this.width_px + 4, this.x(span, stay.to ?? this.newest(span))),
      );
      const y = top + 2 + row.lanes[i]! * lane_px;
      const height = Math.max(1.5, lane_px - 1);
      const colour = trackColourName(stay.trackId);
      context.globalAlpha = 0.32;
      context.fillStyle = colour;
      context.fillRect(left, y, right - left, height);
      context.globalAlpha = 1;
      context.fillRect(left, y, 2, height);
      if (stay.to !== null) context.fillRect(right - 1, y, 1, height);
      if (height >= 9 && right - left > NAME_FROM_PX) {
        context.fillStyle = inks.ink;
        context.fillText(fitted(context, stay.name, right - left - 10), left + 6, y + height / 2 + 0.5);
      }
      this.bars.push({ left, right, top: y, bottom: y + height, target: { kind: "stay", stay, row } });
    });
  }

  private paintPositions(row: Row & { kind: "door" }, top: number, span: Span): void {
    const { context, inks } = this;
    const middle = top + row.height_px / 2;
    for (const position of row.positions) {
      if ((position.to ?? Infinity) < span.from || position.from > span.to) continue;
      const left = Math.max(LABELS_PX - 4, this.x(span, position.from));
      const right = Math.max(
        left + LEAST_BAR_PX,
        Math.min(this.width_px + 4, this.x(span, position.to ?? this.newest(span))),
      );
      // The height tells the state as well as the colour: an open door is a high bar, a closed one a line.
      const [colour, half] = {
        open: [inks.open, 5],
        opening: [inks.moving, 3.5],
        closing: [inks.moving, 2.5],
        closed: [inks.closed, 1],
        unknown: [inks.unknown, 0.5],
      }[position.state] as [string, number];
      context.fillStyle = colour;
      context.fillRect(left, middle - half, right - left, 2 * half);
    }
  }

  private newestAt: number | null = null;
  private newest(span: Span): number {
    return this.newestAt ?? span.to;
  }

  /** How far intervals that go on are drawn. */
  upTo(newest: number | null): void {
    this.newestAt = newest;
  }

  private paintEvents({ span, rows, scroll_px, events, found, selected }: Scenery): void {
    const middles = new Map<number, number>();
    let other: number | null = null;
    for (const row of rows) {
      // Below the middle of a room's row, where its bars leave their names to be read.
      const middle =
        AXIS_PX + row.top_px - scroll_px + (row.kind === "room" ? row.height_px - 6 : row.height_px / 2);
      if ("id" in row) middles.set(row.id, middle);
      else if (row.kind === "other") other = middle;
    }
    const lastOf = new Map<number, Spot>();
    for (
      let i = firstAt(events, span.from - (span.to - span.from) * 0.02);
      i < events.length && events[i]!.at <= span.to;
      i++
    ) {
      const { event, at } = events[i]!;
      const y = (event.instance && middles.get(event.instance.id)) ?? other;
      if (y === null || y < AXIS_PX || y > this.height_px) continue;
      const x = this.x(span, at);
      if (x < LABELS_PX) continue;
      const isEdge = event.cause !== null;
      const last = lastOf.get(y);
      if (
        last &&
        last.target.kind === "event" &&
        x - last.x < TOGETHER_PX &&
        event.event_id !== selected &&
        last.target.event.event_id !== selected
      ) {
        last.target.count++;
        // What a pattern found says more than that somebody came or went.
        if (!isEdge && last.target.event.cause !== null) last.target.event = event;
        continue;
      }
      const spot: Spot = { x, y, half: MARK_PX, target: { kind: "event", event, count: 1 } };
      lastOf.set(y, spot);
      this.spots.push(spot);
    }
    for (const spot of this.spots) {
      if (spot.target.kind === "event")
        this.paintMark(spot, spot.target.event, spot.target.count, spot.target.event.event_id === selected);
    }
    for (const event of found) {
      const x = this.x(span, Date.parse(event.stamp));
      const y = (event.instance && middles.get(event.instance.id)) ?? other ?? AXIS_PX + 8;
      if (x < LABELS_PX || x > this.width_px) continue;
      this.diamond(x, y, MARK_PX + 2.5, null, this.inks.select);
      this.spots.push({ x, y, half: MARK_PX, target: { kind: "found", event } });
    }
  }

  private paintMark({ x, y }: Spot, event: EventDocument, count: number, isSelected: boolean): void {
    const { context, inks } = this;
    if (isSelected) this.diamond(x, y, MARK_PX + 4, null, inks.select);
    if (event.cause !== null) {
      context.fillStyle =
        event.type.startsWith("left") || event.cause === "disappeared" ? inks.surface : inks.soft;
      context.strokeStyle = inks.soft;
      context.lineWidth = 1.2;
      context.beginPath();
      context.arc(x, y, count > 1 ? 3.6 : 2.6, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
    } else this.diamond(x, y, count > 1 ? MARK_PX + 1 : MARK_PX, inks.accent, inks.surface);
    context.lineWidth = 1;
  }

  private diamond(x: number, y: number, half: number, fill: string | null, stroke: string): void {
    const { context } = this;
    context.beginPath();
    context.moveTo(x, y - half);
    context.lineTo(x + half, y);
    context.lineTo(x, y + half);
    context.lineTo(x - half, y);
    context.closePath();
    if (fill) {
      context.fillStyle = fill;
      context.fill();
    }
    context.strokeStyle = stroke;
    context.lineWidth = fill ? 1 : 2;
    context.stroke();
    context.lineWidth = 1;
  }

  /** Where the rows that are seen are among all of them. */
  private paintScroll({ rows, scroll_px }: Scenery): void {
    const shown_px = this.height_px - AXIS_PX;
    const whole_px = heightOf(rows);
    if (whole_px <= shown_px) return;
    this.context.fillStyle = this.inks.line;
    const top = AXIS_PX + (scroll_px / whole_px) * shown_px;
    this.context.fillRect(LABELS_PX - 5, top, 4, (shown_px / whole_px) * shown_px);
  }

  private paintMoment({ span, at, isLive }: Scenery): void {
    if (at === null) return;
    const { context, inks } = this;
    const x = this.x(span, at);
    if (x < LABELS_PX || x > this.width_px) return;
    const colour = isLive ? inks.open : inks.accent;
    context.strokeStyle = colour;
    context.lineWidth = 2;
    line(context, x, 8, x, this.height_px);
    context.lineWidth = 1;
    context.fillStyle = colour;
    context.beginPath();
    context.moveTo(x - 6, 2);
    context.lineTo(x + 6, 2);
    context.lineTo(x + 6, 9);
    context.lineTo(x, 16);
    context.lineTo(x - 6, 9);
    context.fill();
  }
}

function line(context: CanvasRenderingContext2D, x: number, y: number, toX: number, toY: number): void {
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(toX, toY);
  context.stroke();
}

function fitted(context: CanvasRenderingContext2D, text: string, width_px: number): string {
  if (context.measureText(text).width <= width_px) return text;
  let [least, most] = [1, text.length - 1];
  while (least < most) {
    const middle = (least + most + 1) >> 1;
    if (context.measureText(`${text.slice(0, middle)}…`).width <= width_px) least = middle;
    else most = middle - 1;
  }
  return `${text.slice(0, least)}…`;
}

function readInks(): Inks {
  const style = getComputedStyle(document.documentElement);
  const of = (name: string): string => style.getPropertyValue(`--${name}`).trim();
  return {
    ink: of("ink"),
    soft: of("ink-soft"),
    line: of("line"),
    surface: of("surface"),
    raised: of("raised"),
    accent: of("accent"),
    select: of("map-select"),
    open: of("door-open"),
    moving: of("door-moving"),
    closed: of("door-closed"),
    unknown: of("door-unknown"),
    unread: of("map-unread"),
    font: getComputedStyle(document.body).fontFamily,
  };
}
