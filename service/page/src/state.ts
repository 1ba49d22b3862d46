/** What the page shows: one store of signals, which panels read and the scene and timeline follow. */

import { computed, signal, type ReadonlySignal } from "@preact/signals";

import { EVERYTHING, type EventFilter } from "./events/filter";
import { warmthOf } from "./heat/warmth";
import type { CallerDocument, EventDocument, MapDocument, Problem } from "./documents";
import type { MapModel, Point } from "./map/model";

export type Selection =
  { kind: "instance"; id: number } | { kind: "track"; id: number } | { kind: "event"; event: EventDocument };

/** How the page stands with the service; moments in milliseconds since 1970, of this machine's clock. */
export type Connection =
  | { state: "loading" }
  | { state: "live"; resumed: boolean }
  | { state: "disconnected"; since: number; retryAt: number };

export type View = "plan" | "space";

export type Tab = "details" | "events" | "edit" | "rules" | "queries" | "import" | "access";

/** An interval of event time, in milliseconds since 1970. */
export interface Span {
  from: number;
  to: number;
}

/** What the colours of rooms tell: who is there now, or the hours that people spent there over a day or a week. */
export type Heat = "now" | "day" | "week";

/** The way that somebody went, as it is drawn on the map; `storey` null: on whichever is shown. */
export interface Way {
  trackId: number;
  lines: readonly { from: Point; to: Point; storey: string | null }[];
}

export class State {
  /** null until they were read. */
  readonly maps = signal<MapDocument[] | null>(null);
  readonly mapName = signal<string | null>(null);
  /** The map itself: what stands on it; null while it is being read, or where there is none. */
  readonly map = signal<MapModel | null>(null);
  /** Why the maps or the map could not be read. */
  readonly problem = signal<Problem | null>(null);
  /** The service asks for a token: why, as it said. */
  readonly unauthorised = signal<Problem | null>(null);
  /** Whose token it is, and what it allows; null until it was read. */
  readonly caller = signal<CallerDocument | null>(null);
  readonly connection = signal<Connection>({ state: "loading" });

  readonly view = signal<View>("plan");
  /** The name of the storey that is shown; null: all. */
  readonly storey = signal<string | null>(null);
  /** Whether all storeys are pulled apart while they are shown together. */
  readonly isApart = signal(false);
  readonly heat = signal<Heat>("now");
  /** By the instance's id; null: not read yet. */
  readonly hours = signal<ReadonlyMap<number, number> | null>(null);
  readonly warmth: ReadonlySignal<ReadonlyMap<number, number> | null> = computed(
    () => this.hours.value && warmthOf(this.hours.value),
  );
  readonly selection = signal<Selection | null>(null);
  readonly way = signal<Way | null>(null);
  /** What the list of all that is on the map is narrowed to. */
  readonly find = signal("");
  /** What the list of events is narrowed to. */
  readonly eventFilter = signal<EventFilter>(EVERYTHING);
  readonly tab = signal<Tab>("events");
  /** The name of the rule that the panel for rules shall open; null: none. */
  readonly wantedRule = signal<string | null>(null);

  /** The moment that is shown, in milliseconds since 1970; null: what is now. */
  readonly at = signal<number | null>(null);
  readonly isLive: ReadonlySignal<boolean> = computed(() => this.at.value === null);
  /** What the timeline shows. */
  readonly span = signal<Span>({ from: Date.now() - 600_000, to: Date.now() });
  /** The newest stamp that was told, in milliseconds since 1970: where event time has come to. */
  readonly newest = signal<number | null>(null);

  /** Whether it is known how it was at the moment that is shown; what is not known is grey. */
  readonly isKnown = signal(false);
  /** Why it is not known; null: it is being read. */
  readonly unread = signal<Problem | null>(null);

  /** How many are in each room, by the instance's id, at the moment that is shown. */
  readonly occupancy = signal<ReadonlyMap<number, number>>(new Map());
  /** The newest events of the map, newest first. */
  readonly events = signal<readonly EventDocument[]>([]);
  /** The number of the newest event as the map was opened; null until that is known. */
  readonly eventsSince = signal<number | null>(null);
}
