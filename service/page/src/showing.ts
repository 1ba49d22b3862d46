/** Brings what the service says onto the page: maps, what is now, and moments of the past. */

import { batch, effect, signal, untracked, type ReadonlySignal } from "@preact/signals";

import type { CallerDocument, Delta, EventDocument, MapDocument, Snapshot } from "./documents";
import { ApiError, allPages, path, type Api } from "./api";
import type { App } from "./app";
import { Live } from "./live/live";
import { World } from "./live/world";
import { readMap } from "./map/read";
import { MomentReader } from "./moment_reader";
import { backdropOf } from "./scene/backdrop";
import type { Stage } from "./scene/stage";
import type { Connection, Span, State } from "./state";
import { History } from "./timeline/history";
import { HistoryReader } from "./timeline/history_reader";
import { following } from "./timeline/scale";
import { askAgain, contact, problemOf, UNANSWERED } from "./unanswered";
import { t } from "./language/catalogue";

const MOST_EVENTS = 500;
const FIRST_SPAN_MS = 600_000;
const WHOLE_UP_TO_MS = 1_800_000;
const EDITED_AFTER_MS = 150;
const STEP_MS = 200;
const BEAT_MS = 250;
const RETRY_MS = 2000;

interface Extent {
  first: string | null;
  last: string | null;
}

export class Showing {
  readonly now = new World();
  readonly then = new World();
  readonly history = new History();
  /** Rises when the history changed. */
  readonly historyVersion = signal(0);
  /** Rises with what is told, a few times a second at most: for what is read rather than watched. */
  readonly beat = signal(0);
  /** How many times as fast as it happened the past is played; null: it stands. */
  readonly playing = signal<number | null>(null);
  /** Whether the timeline goes along with what is new. */
  readonly follows = signal(true);

  private readonly api: Api;
  private readonly state: State;
  private readonly announce: App["announce"];
  private stage: Stage | null = null;
  private live: Live | null = null;
  private reading = new AbortController();
  private readonly moments: MomentReader;
  private readonly reader: HistoryReader;
  private editedTimer = 0;
  private playTimer = 0;
  private retryTimer = 0;
  private beatTimer = 0;
  private wasLost = false;
  /** The map that was asked for, and is not there. */
  private missing: string | null = null;
  /** The newest stamp that was told; the state has it with the next beat. */
  private newest = -Infinity;

  constructor(api: Api, state: State, announce: App["announce"]) {
    this.api = api;
    this.state = state;
    this.announce = announce;
    this.moments = new MomentReader(api, state, {
      take: (snapshot) => this.takeThen(snapshot),
      forget: () => {
        this.then.clear();
        this.publish();
      },
    });
    this.reader = new HistoryReader(api, state, this.history, {
      present: () => this.now.snapshot(),
      told: () => this.told(),
      complain: (error) => this.complain(error),
    });
  }

  get isHistoryUnread(): ReadonlySignal<boolean> {
    return this.reader.isUnread;
  }

  /** Draws on this stage from now on. */
  showOn(stage: Stage): void {
    this.stage = stage;
    effect(() => {
      void [this.state.storey.value, this.state.isApart.value];
      if (this.state.view.value === "space" && this.state.map.value) void this.readMeshes();
    });
    effect(() => {
      void this.state.span.value;
      this.reader.readSoon();
    });
    effect(() => {
      // Seen from above, the storeys would cover each other.
      if (this.state.view.value === "plan" && this.state.storey.value === null && this.state.map.value)
        this.state.storey.value = firstStorey(this.state.map.value);
    });
    effect(() => this.followConnection(this.state.connection.value.state));
    effect(() => {
      if (contact.value > 0) untracked(() => this.readAgain());
    });
  }

  /** Reads the list of maps, and shows the one named, else the one shown, else the first. */
  async reloadMaps(show?: string): Promise<void> {
    try {
      const maps = await allPages<MapDocument, "maps">(this.api, "/maps", "maps");
      const isThere = (name: string | null | undefined): boolean => maps.some((each) => each.name === name);
      this.state.problem.value = null;
      this.state.maps.value = maps;
      void this.readCaller();
      const current = this.state.mapName.value;
      const wanted = show ?? current ?? this.missing;
      const next = wanted === null ? (maps[0]?.name ?? null) : isThere(wanted) ? wanted : null;
      clearTimeout(this.retryTimer);
      if (next === null && wanted !== null) return this.miss(wanted);
      if (next !== current || (next !== null && (this.live?.isRefused ?? true))) this.showMap(next);
    } catch (error) {
      this.fail(error);
    }
  }

  /** Where it cannot be read, the service says itself what it does not allow. */
  private async readCaller(): Promise<void> {
    this.state.caller.value = await this.api.get<CallerDocument>("/caller").catch(() => null);
  }

  /** A link may name a map that is not there: another one would be taken for it. */
  private miss(name: string): void {
    this.showMap(null);
    this.missing = name;
    this.state.problem.value = {
      type: "about:blank",
      title: t("No such map"),
      status: 404,
      detail: t("There is no map {0} here.", name),
      remedy: t(
        "It may have been deleted or renamed: choose one of the maps above, or see that the link is right.",
      ),
      instance: "",
      errors: [],
    };
  }

  /** Shows another map, or none. */
  showMap(name: string | null): void {
    this.missing = null;
    this.reading.abort();
    this.reader.stop();
    this.reading = new AbortController();
    this.live?.stop();
    this.live = null;
    this.pause();
    this.moments.stop();
    this.now.clear();
    this.then.clear();
    this.history.clear();
    this.newest = -Infinity;
    this.stage?.setBackdrop(null);
    batch(() => {
      this.state.mapName.value = name;
      this.state.map.value = null;
      this.state.storey.value = null;
      this.state.selection.value = null;
      this.state.at.value = null;
      this.state.newest.value = null;
      this.state.events.value = [];
      this.state.eventsSince.value = null;
      this.state.isKnown.value = false;
      this.state.unread.value = null;
      this.state.occupancy.value = new Map();
      this.state.problem.value = null;
      this.historyVersion.value = this.historyVersion.peek() + 1;
    });
    if (name !== null) void this.readAll(name, this.reading.signal);
  }

  /** Reads the map that is shown once more. */
  async reloadMap(): Promise<void> {
    const name = this.state.mapName.peek();
    if (name === null) return;
    const { signal } = this.reading;
    try {
      const map = await readMap(this.api, name, signal);
      if (signal.aborted) return;
      batch(() => {
        this.state.problem.value = null;
        this.state.map.value = map;
        if (!map.storeys.some((each) => each.name === this.state.storey.peek()))
          this.state.storey.value = firstStorey(map);
      });
    } catch (error) {
      if (!signal.aborted) this.state.problem.value = problemOf(error);
    }
  }

  /** Shows a moment, or what is now. */
  moveTo(at: number | null): void {
    if (at === null) {
      this.pause();
      this.moments.stop();
      this.now.settle();
      batch(() => {
        this.state.at.value = null;
        this.follows.value = true;
        this.publish();
        this.followNewest();
      });
      this.stage?.setWorld(this.now);
      return;
    }
    batch(() => {
      if (this.state.at.peek() === null) this.then.clear();
      this.state.at.value = at;
      this.follows.value = false;
      this.publish();
    });
    this.stage?.setWorld(this.then);
    this.moments.show(at, this.playing.peek() !== null);
  }

  play(speed: number): void {
    const newest = this.state.newest.peek();
    if (newest === null) return;
    clearInterval(this.playTimer);
    this.playing.value = speed;
    const span = this.state.span.peek();
    if (this.state.at.peek() === null)
      this.moveTo(Math.max(span.from, this.history.loaded?.from ?? span.from));
    let last = performance.now();
    this.playTimer = window.setInterval(() => {
      const now = performance.now();
      const next = (this.state.at.peek() ?? newest) + (now - last) * speed;
      last = now;
      if (next >= (this.state.newest.peek() ?? newest)) this.moveTo(null);
      else this.moveTo(next);
    }, STEP_MS);
  }

  pause(): void {
    clearInterval(this.playTimer);
    this.playing.value = null;
  }

  /** From the first stamp to a little after the newest; null where nothing has one. */
  async extent(): Promise<Span | null> {
    const name = this.state.mapName.peek();
    if (name === null) return null;
    const { first, last } = await this.api.get<Extent>(path`/maps/${name}/extent`);
    if (first === null || last === null) return null;
    const length = Math.max(1000, Date.parse(last) - Date.parse(first));
    return { from: Date.parse(first) - 0.03 * length, to: Date.parse(last) + 0.06 * length };
  }

  /** Does not wait for the next attempt to connect. */
  retryNow(): void {
    if (this.live) this.live.retryNow();
    else void this.reloadMaps();
  }

  private async readAll(name: string, signal: AbortSignal): Promise<void> {
    this.state.connection.value = { state: "loading" };
    try {
      const [map, extent] = await Promise.all([
        readMap(this.api, name, signal),
        this.api.get<Extent>(path`/maps/${name}/extent`, signal),
      ]);
      if (signal.aborted) return;
      this.stage?.setWorld(this.now);
      batch(() => {
        this.state.map.value = map;
        this.state.storey.value = firstStorey(map);
        this.state.newest.value = extent.last === null ? null : Date.parse(extent.last);
        this.state.span.value = firstSpan(extent.first, extent.last);
        this.follows.value = true;
      });
      this.live = new Live(this.api, this.state, name, {
        snapshot: (snapshot) => this.takeNow(snapshot, () => this.now.take(snapshot, performance.now())),
        delta: (delta) => this.takeNow(delta, () => this.now.change(delta, performance.now())),
        events: (events) => this.takeEvents(events),
        edited: () => this.editedSoon(),
      });
      this.reader.readSoon();
      void this.readBackdrop(name, signal);
    } catch (error) {
      if (!signal.aborted) this.fail(error);
    }
  }

  /** Shows why there is no map; where the service did not answer, it is asked again. */
  private fail(error: unknown): void {
    const problem = problemOf(error);
    this.state.problem.value = problem;
    clearTimeout(this.retryTimer);
    if (UNANSWERED.has(problem.status))
      this.retryTimer = window.setTimeout(() => void this.reloadMaps(), RETRY_MS);
  }

  private takeNow(told: Snapshot | Delta, change: () => void): void {
    change();
    this.history.continueWith(told);
    const stamps = told.tracks.map((each) => Date.parse(each.stamp));
    if (told.stamp !== null) stamps.push(Date.parse(told.stamp));
    this.takeNewest(Math.max(...stamps));
    if (this.state.isLive.peek()) this.publish();
    this.told();
  }

  private takeThen(snapshot: Snapshot): void {
    this.then.take(snapshot, performance.now());
    if (this.playing.peek() === null) this.then.settle();
    this.publish();
    this.told();
    if (this.state.connection.peek().state === "disconnected") this.live?.retryNow();
  }

  /** Says what is known of the moment that is shown. */
  private publish(): void {
    const world = this.state.isLive.peek() ? this.now : this.then;
    batch(() => {
      this.state.isKnown.value = world.isKnown;
      this.state.occupancy.value = world.occupancy;
    });
    this.stage?.draw();
  }

  private followConnection(state: Connection["state"]): void {
    if (state === "disconnected") {
      this.wasLost = true;
      this.history.cut(this.newest);
      this.told();
    } else if (state === "live" && this.wasLost) {
      this.wasLost = false;
      askAgain();
    }
  }

  private readAgain(): void {
    this.moments.readAgain();
    this.reader.readSoon();
    const name = this.state.map.peek()?.name;
    if (this.state.problem.peek() === null || name === undefined) return;
    void this.reloadMap();
    void this.readBackdrop(name, this.reading.signal);
  }

  private async readBackdrop(name: string, signal: AbortSignal): Promise<void> {
    if (!this.stage) return;
    try {
      this.stage.setBackdrop(await backdropOf(this.api, name, this.stage.colourOfGrid, signal));
    } catch (error) {
      if (!signal.aborted) this.state.problem.value = problemOf(error);
    }
  }

  private takeEvents(events: readonly EventDocument[]): void {
    if (events.length === 0) return;
    this.history.addEvents(events);
    this.takeNewest(Math.max(...events.map((each) => Date.parse(each.stamp))));
    const known = new Set(this.state.events.peek().map((each) => each.event_id));
    const fresh = events.filter((each) => !known.has(each.event_id));
    const all = [...fresh, ...this.state.events.peek()].sort((a, b) => b.seq - a.seq);
    this.state.events.value = all.slice(0, MOST_EVENTS);
    this.told();
  }

  private told(): void {
    this.historyVersion.value = this.historyVersion.peek() + 1;
    if (this.beatTimer !== 0) return;
    this.beatTimer = window.setTimeout(() => {
      this.beatTimer = 0;
      batch(() => {
        this.publishNewest();
        const { from, to } = this.state.span.peek();
        this.history.forget(2 * from - to);
        this.beat.value = this.beat.peek() + 1;
      });
    }, BEAT_MS);
  }

  private takeNewest(stamp: number): void {
    if (!Number.isFinite(stamp) || stamp <= this.newest) return;
    this.newest = stamp;
    this.history.extend(stamp);
  }

  private publishNewest(): void {
    if (this.newest <= (this.state.newest.peek() ?? -Infinity)) return;
    this.state.newest.value = this.newest;
    this.followNewest();
  }

  private followNewest(): void {
    const newest = this.state.newest.peek();
    if (newest === null || !this.follows.peek() || !this.state.isLive.peek()) return;
    const span = following(this.state.span.peek(), newest);
    if (span !== this.state.span.peek()) this.state.span.value = span;
  }

  private editedSoon(): void {
    clearTimeout(this.editedTimer);
    this.editedTimer = window.setTimeout(() => void this.reloadMap(), EDITED_AFTER_MS);
  }

  /** Says what failed beside a map that is shown all the same; that there is no connection is shown anyway. */
  private complain(error: unknown): void {
    const { status, detail, remedy } = problemOf(error);
    if (!(error instanceof ApiError) || (status !== 0 && status !== 401))
      this.announce(`${detail} ${remedy}`, "error");
  }

  private async readMeshes(): Promise<void> {
    const { signal } = this.reading;
    const map = this.state.map.peek();
    if (map === null || !this.stage) return;
    try {
      const hasThings = map.things.some((each) => each.kind === "thing");
      const glb = hasThings
        ? await this.api.bytes(path`/maps/${map.name}/export` + "?format=glb", signal)
        : null;
      if (!signal.aborted) await this.stage.setMeshes(glb);
    } catch (error) {
      if (!signal.aborted) this.state.problem.value = problemOf(error);
    }
  }
}

function firstStorey(map: {
  storeys: readonly { name: string }[];
  things: readonly { kind: string; storey: string | null }[];
}): string | null {
  if (map.storeys.length < 2) return null;
  const hasRooms = map.storeys.find(({ name }) =>
    map.things.some((each) => each.kind === "room" && each.storey === name),
  );
  return hasRooms?.name ?? null;
}

function firstSpan(first: string | null, last: string | null): Span {
  if (first === null || last === null) return { from: Date.now() - FIRST_SPAN_MS, to: Date.now() };
  const to = Date.parse(last);
  const length = Math.max(20_000, to - Date.parse(first));
  const shown = length <= WHOLE_UP_TO_MS ? length : FIRST_SPAN_MS;
  return { from: to - shown * 1.03, to: to + shown * 0.12 };
}
