/** What the parts of the page give each other. */

import type { ReadonlySignal } from "@preact/signals";

import type { EventDocument } from "./documents";
import type { Api } from "./api";
import type { State } from "./state";

/** A place that the pointer is at, in metres of the map frame, on the floor of the storey shown. */
export interface Place {
  x_m: number;
  y_m: number;
}

/** What a tool does with the pointer while it has it; true: the scene shall not use it as well. */
export interface PointerTool {
  cursor?: string;
  down?(place: Place, event: PointerEvent): boolean;
  move?(place: Place, event: PointerEvent): boolean;
  up?(place: Place, event: PointerEvent): boolean;
  doubleClick?(place: Place, event: MouseEvent): boolean;
}

/** The picture of the map, for tools that draw on it. */
export interface Surface {
  /** The element that gets the pointer and the keys. */
  readonly element: HTMLElement;
  /** Rises whenever places move on the screen, for what is laid over the picture. */
  readonly viewed: ReadonlySignal<number>;
  /** Gives the pointer to a tool, or back to the scene (null). Zooming and the second finger stay the scene's. */
  use(tool: PointerTool | null): void;
  placeOf(event: MouseEvent): Place;
  /** Where a place is in the element, in CSS pixels. */
  pixelOf(place: Place): { x: number; y: number };
  metresPerPixel(): number;
}

export type OverlayEvent = Pick<
  EventDocument,
  "event_id" | "type" | "stamp" | "since" | "track" | "instance" | "measures"
>;

/** The timeline, for those who have something to show on it. */
export interface TimelineView {
  /** Draws events as found by a dry run, beside what happened; an empty list removes them. */
  overlay(events: readonly OverlayEvent[], title?: string): void;
  /** Shows an interval, in milliseconds since 1970. */
  show(from: number, to: number): void;
}

export interface App {
  readonly api: Api;
  readonly state: State;
  readonly surface: Surface;
  readonly timeline: TimelineView;
  /** Says something for a moment, on the screen and to screen readers. */
  announce(text: string, kind?: "done" | "error"): void;
  /** Reads the map again after an edit; resolves when it is shown. */
  reloadMap(): Promise<void>;
  /** Reads the list of maps again and, with a name, shows that one. */
  reloadMaps(show?: string): Promise<void>;
  /** Shows a moment of the past, in milliseconds since 1970, or what is now (null). */
  moveTo(at: number | null): void;
}
