/** The timeline: what can be done on its canvas. */

import { effect, signal } from "@preact/signals";
import { render } from "preact";

import type { App, OverlayEvent } from "../app";
import { openEvent } from "../events/open";
import type { MapModel } from "../map/model";
import type { Showing } from "../showing";
import type { State } from "../state";
import { theme } from "../chrome/theme";
import { zone } from "./clock";
import { firstAt } from "./history";
import { AXIS_PX, LABELS_PX, Painter, type Target } from "./painter";
import { heightOf, rowsOf, type Row } from "./rows";
import { momentAt, panned, pixelOf, zoomed } from "./scale";
import { Tools, type TimelineTools } from "./tools";
import { t } from "../language/catalogue";

const CLICK_PX = 5;
const WHEEL_ZOOM = 0.0018;
const KEY_PART = 1 / 100;
const KEY_ZOOM = 1.3;
const HANDLE_PX = 10;

export class Timeline implements TimelineTools {
  readonly found = signal<{ events: readonly OverlayEvent[]; title: string }>({ events: [], title: "" });
  readonly hover = signal<{ target: Target; x: number; y: number } | null>(null);
  readonly speed = signal<number>(1);
  private readonly state: State;
  private readonly showing: Showing;
  private app: App | null = null;
  private painter: Painter | null = null;
  private rows: readonly Row[] = [];
  /** What the rows were laid for. */
  private of: { map: MapModel | null; storey: string | null; version: number } = {
    map: null,
    storey: null,
    version: -1,
  };
  private scroll_px = 0;
  private frame = 0;
  private readonly fingers = new Map<number, { x: number; startX: number; startY: number; y: number }>();
  private action: "pan" | "scrub" | null = null;

  constructor(state: State, showing: Showing) {
    this.state = state;
    this.showing = showing;
  }

  overlay(events: readonly OverlayEvent[], title = t("Found")): void {
    this.found.value = { events, title };
  }

  show(from: number, to: number): void {
    this.showing.follows.value = false;
    this.state.span.value = { from, to };
  }

  get map(): MapModel | null {
    return this.state.map.value;
  }

  mount(element: HTMLElement, app: App): void {
    this.app = app;
    render(<Tools app={app} showing={this.showing} timeline={this} />, element);
    const canvas = element.querySelector("canvas")!;
    this.painter = new Painter(canvas);
    const box = canvas.parentElement!;
    new ResizeObserver(() => {
      this.painter!.resize(box.clientWidth, box.clientHeight);
      this.draw();
    }).observe(box);
    this.listen(canvas);
    effect(() => {
      void [theme.value, zone.value];
      this.painter?.recolour();
      this.draw();
    });
    effect(() => {
      const { map, storey, span, at, newest, selection } = this.state;
      void [map.value, storey.value, span.value, at.value, newest.value, selection.value];
      void [this.showing.beat.value, this.found.value];
      this.draw();
    });
  }

  zoom(factor: number): void {
    const span = this.state.span.peek();
    const at = this.state.at.peek() ?? this.state.newest.peek();
    const around = at !== null && at > span.from && at < span.to ? at : (span.from + span.to) / 2;
    this.state.span.value = zoomed(span, factor, around);
  }

  /** Shows all that is known to have happened. */
  async fit(): Promise<void> {
    const extent = await this.showing.extent();
    if (extent) this.show(extent.from, extent.to);
  }

  /** Goes to the event before or after the moment that is shown. */
  step(direction: 1 | -1): void {
    const { events } = this.showing.history;
    const at = this.state.at.peek() ?? this.state.newest.peek() ?? Infinity;
    const i = direction === 1 ? firstAt(events, at + 1) : firstAt(events, at) - 1;
    const next = events[i];
    if (!next || !this.app) return;
    openEvent(this.app, next.event);
    this.reveal(next.at);
  }

  private draw(): void {
    if (this.frame === 0) this.frame = requestAnimationFrame(this.paint);
  }

  private readonly paint = (): void => {
    this.frame = 0;
    const { map, storey, span, at, newest, selection } = this.state;
    if (!this.painter) return;
    this.layRows(map.peek(), storey.peek());
    this.scrollBy(0);
    const selected = selection.peek();
    this.painter.upTo(newest.peek());
    this.painter.paint({
      span: span.peek(),
      rows: this.rows,
      scroll_px: this.scroll_px,
      loaded: this.showing.history.loaded,
      events: this.showing.history.events,
      found: this.found.peek().events,
      at: at.peek() ?? newest.peek(),
      isLive: at.peek() === null,
      selected: selected?.kind === "event" ? selected.event.event_id : null,
    });
  };

  /** Rows are laid anew only when something in them changed: not while one pans or zooms. */
  private layRows(map: MapModel | null, storey: string | null): void {
    const version = this.showing.historyVersion.peek();
    const { of } = this;
    if (of.map === map && of.storey === storey && of.version === version) return;
    this.of = { map, storey, version };
    this.rows = map ? rowsOf(map, storey, this.showing.history) : [];
  }

  private listen(canvas: HTMLCanvasElement): void {
    canvas.addEventListener("pointerdown", this.down);
    canvas.addEventListener("pointermove", this.move);
    canvas.addEventListener("pointerup", this.up);
    canvas.addEventListener("pointercancel", this.up);
    canvas.addEventListener("pointerleave", () => (this.hover.value = null));
    canvas.addEventListener("wheel", this.wheel, { passive: false });
    canvas.addEventListener("keydown", this.key);
  }

  private readonly down = (event: PointerEvent): void => {
    const { offsetX: x, offsetY: y } = event;
    (event.currentTarget as HTMLElement).setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, { x, y, startX: x, startY: y });
    this.action = y <= AXIS_PX || Math.abs(x - this.momentX()) < HANDLE_PX / 2 ? "scrub" : null;
    if (y <= AXIS_PX && this.fingers.size === 1) this.scrub(x);
  };

  private readonly move = (event: PointerEvent): void => {
    const { offsetX: x, offsetY: y } = event;
    const finger = this.fingers.get(event.pointerId);
    if (!finger) {
      const target = this.painter?.targetAt(x, y) ?? null;
      this.hover.value = target && { target, x, y };
      (event.currentTarget as HTMLElement).style.cursor =
        target && target.kind !== "stay" ? "pointer" : y <= AXIS_PX ? "ew-resize" : "default";
      return;
    }
    this.hover.value = null;
    if (this.fingers.size === 2) this.pinch(event.pointerId, finger.x, x);
    else if (this.action === "scrub") this.scrub(x);
    else if (this.action === "pan" || Math.hypot(x - finger.startX, y - finger.startY) > CLICK_PX) {
      this.action = "pan";
      this.pan(finger.x - x);
      this.scrollBy(finger.y - y);
    } else return;
    finger.x = x;
    finger.y = y;
  };

  private readonly up = (event: PointerEvent): void => {
    const wasOnly = this.fingers.size === 1;
    if (!this.fingers.delete(event.pointerId) || !wasOnly) return;
    const action = this.action;
    this.action = null;
    if (action !== null || event.type !== "pointerup" || event.button !== 0) return;
    this.click(event.offsetX, event.offsetY);
  };

  private click(x: number, y: number): void {
    const target = this.painter?.targetAt(x, y) ?? null;
    if (!this.app) return;
    if (target?.kind === "event") openEvent(this.app, target.event);
    else if (target?.kind === "found") this.app.moveTo(Date.parse(target.event.stamp));
    else if (x < LABELS_PX) {
      const row = this.rows.find(
        (each) =>
          y + this.scroll_px - AXIS_PX >= each.top_px &&
          y + this.scroll_px - AXIS_PX < each.top_px + each.height_px,
      );
      if (row && "id" in row) {
        this.state.selection.value = { kind: "instance", id: row.id };
        this.state.tab.value = "details";
      }
    } else {
      if (target?.kind === "stay") {
        this.state.selection.value = { kind: "track", id: target.stay.trackId };
        this.state.tab.value = "details";
      }
      this.scrub(x);
    }
  }

  private momentX(): number {
    const at = this.state.at.peek() ?? this.state.newest.peek();
    return at === null
      ? -Infinity
      : LABELS_PX + pixelOf(this.state.span.peek(), this.painter?.plot_px ?? 1, at);
  }

  private momentOf(x: number): number {
    return momentAt(this.state.span.peek(), this.painter?.plot_px ?? 1, x - LABELS_PX);
  }

  /** Shows the moment at a pixel; beyond the newest it is live. */
  private scrub(x: number): void {
    const at = this.momentOf(Math.max(x, LABELS_PX));
    const newest = this.state.newest.peek();
    this.app?.moveTo(newest !== null && at >= newest ? null : at);
  }

  private pan(by_px: number): void {
    const span = this.state.span.peek();
    this.showing.follows.value = false;
    this.state.span.value = panned(span, (by_px / (this.painter?.plot_px ?? 1)) * (span.to - span.from));
  }

  private scrollBy(by_px: number): void {
    const most = Math.max(0, heightOf(this.rows) - ((this.painter?.height_px ?? 0) - AXIS_PX));
    const next = Math.min(most, Math.max(0, this.scroll_px + by_px));
    if (next === this.scroll_px) return;
    this.scroll_px = next;
    this.draw();
  }

  private pinch(id: number, before: number, after: number): void {
    const other = [...this.fingers].find(([each]) => each !== id)?.[1];
    if (!other || Math.abs(before - other.x) < 8 || Math.abs(after - other.x) < 8) return;
    const factor = Math.abs(after - other.x) / Math.abs(before - other.x);
    this.state.span.value = zoomed(this.state.span.peek(), factor, this.momentOf(other.x));
    const finger = this.fingers.get(id);
    if (finger) finger.x = after;
  }

  private readonly wheel = (event: WheelEvent): void => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 24 : 1;
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY))
      this.pan((event.deltaX || event.deltaY) * lines);
    else if (event.offsetX < LABELS_PX) this.scrollBy(event.deltaY * lines);
    else {
      const factor = Math.exp(-event.deltaY * lines * WHEEL_ZOOM * (event.ctrlKey ? 5 : 1));
      this.state.span.value = zoomed(this.state.span.peek(), factor, this.momentOf(event.offsetX));
    }
  };

  private readonly key = (event: KeyboardEvent): void => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const span = this.state.span.peek();
    const step = (span.to - span.from) * KEY_PART * (event.shiftKey ? 10 : 1);
    if (event.key === "ArrowLeft" || event.key === "ArrowRight")
      this.moveBy(event.key === "ArrowLeft" ? -step : step);
    else if (event.key === "ArrowUp" || event.key === "ArrowDown")
      this.scrollBy(event.key === "ArrowUp" ? -24 : 24);
    else if (event.key === "PageUp") this.step(-1);
    else if (event.key === "PageDown") this.step(1);
    else if (event.key === "Home") this.moveBy(-Infinity);
    else if (event.key === "End") this.app?.moveTo(null);
    else if (event.key === "+" || event.key === "=") this.zoom(KEY_ZOOM);
    else if (event.key === "-") this.zoom(1 / KEY_ZOOM);
    else return;
    event.preventDefault();
    event.stopPropagation();
  };

  private moveBy(by_ms: number): void {
    const newest = this.state.newest.peek();
    if (newest === null) return;
    const first = this.showing.history.loaded?.from ?? this.state.span.peek().from;
    const next = Math.max(first, (this.state.at.peek() ?? newest) + by_ms);
    this.app?.moveTo(next >= newest ? null : next);
    this.reveal(next);
  }

  /** Moves the span so that a moment is in it, if it is not. */
  reveal(at: number): void {
    const span = this.state.span.peek();
    const margin = (span.to - span.from) * 0.2;
    if (at < span.from) this.state.span.value = panned(span, at - span.from - margin);
    else if (at > span.to) this.state.span.value = panned(span, at - span.to + margin);
  }
}
