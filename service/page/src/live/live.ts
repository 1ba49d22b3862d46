/** What is now on a map: its movement, its events, and word of each edit of it. */

import type { Delta, EventDocument, Problem, Snapshot } from "../documents";
import { path, type Api } from "../api";
import type { State } from "../state";
import { follow, type Happening } from "./connection";
import { LastingSocket } from "./lasting_socket";
import { t } from "../language/catalogue";

export interface LiveUser {
  snapshot(snapshot: Snapshot): void;
  delta(delta: Delta): void;
  /** Events in their order, oldest first. */
  events(events: EventDocument[]): void;
  /** Somebody edited the map. */
  edited(): void;
}

/** How long "resumed" is shown. */
const NOTICED_MS = 5000;
/** How many events are told from before the page was opened. */
const EVENTS_BEFORE = 200;

export class Live {
  private readonly api: Api;
  private readonly mapName: string;
  private readonly state: State;
  private readonly user: LiveUser;
  private readonly movement: LastingSocket;
  private events: LastingSocket | null = null;
  private cursor = 0;
  private changeSet: number | null = null;
  private isStopped = false;
  /** The number of the newest event as the page was opened; null once those before it were read. */
  private unreadUpTo: number | null = null;
  /** The service will not answer, however often it is asked. */
  isRefused = false;

  constructor(api: Api, state: State, mapName: string, user: LiveUser) {
    this.api = api;
    this.mapName = mapName;
    this.state = state;
    this.user = user;
    this.happens({ kind: "asked" });
    this.movement = new LastingSocket(api, {
      path: () => path`/maps/${mapName}/live`,
      take: (message) => this.take(message),
      lost: (retryAt) => this.happens({ kind: "lost", now: Date.now(), retryAt }),
      refused: (status, detail) => this.refuse(status, detail),
    });
  }

  stop(): void {
    this.isStopped = true;
    this.movement.stop();
    this.events?.stop();
  }

  retryNow(): void {
    this.movement.retryNow();
    this.events?.retryNow();
  }

  private take(message: { type: string }): void {
    if (message.type === "snapshot") {
      const snapshot = message as unknown as Snapshot;
      this.user.snapshot(snapshot);
      this.noteEdit(snapshot.change_set);
      this.happens({ kind: "snapshot" });
      if (this.events === null) {
        this.cursor = this.unreadUpTo = snapshot.event_cursor ?? 0;
        this.state.eventsSince.value = this.cursor;
        this.followEvents();
      }
      if (this.unreadUpTo !== null) void this.eventsBefore(this.unreadUpTo);
    } else if (message.type === "delta") {
      const delta = message as unknown as Delta;
      this.user.delta(delta);
      this.noteEdit(delta.change_set);
    }
  }

  private noteEdit(changeSet: number | undefined): void {
    if (changeSet === undefined) return;
    if (this.changeSet !== null && changeSet !== this.changeSet) this.user.edited();
    this.changeSet = changeSet;
  }

  private followEvents(): void {
    this.events = new LastingSocket(this.api, {
      path: () => `/events/feed?map=${encodeURIComponent(this.mapName)}&after=${this.cursor}`,
      take: (message) => {
        const cursor = message["cursor"];
        if (typeof cursor === "number") this.cursor = cursor;
        if (message.type === "events") this.user.events(message["events"] as EventDocument[]);
      },
      lost: () => {},
      refused: (status, detail) => this.refuse(status, detail),
    });
  }

  /** What happened shortly before, so that the list does not begin empty. Numbers have gaps, so some may be few. */
  private async eventsBefore(before: number): Promise<void> {
    const after = Math.max(0, before - EVENTS_BEFORE);
    const address = `/events?map=${encodeURIComponent(this.mapName)}&after=${after}&limit=${EVENTS_BEFORE}`;
    try {
      const { events } = await this.api.get<{ events: EventDocument[] }>(address);
      this.unreadUpTo = null;
      if (!this.isStopped) this.user.events(events.filter((each) => each.seq <= before));
    } catch {
      // They are asked for again with the next snapshot, which comes when the service is back.
    }
  }

  private refuse(status: number, detail: string): void {
    this.isRefused = true;
    const problem: Problem = {
      type: "about:blank",
      title: t("Refused"),
      status,
      detail,
      instance: "",
      remedy: status === 403 ? t("Sign in with a token that has the scope read and may see this map.") : "",
      errors: [],
    };
    if (status === 401) this.state.unauthorised.value = problem;
    else this.state.problem.value = problem;
  }

  private happens(happening: Happening): void {
    const before = this.state.connection.value;
    this.state.connection.value = follow(before, happening);
    const after = this.state.connection.value;
    if (after.state === "live" && after.resumed)
      setTimeout(() => this.happens({ kind: "noticed" }), NOTICED_MS);
  }
}
