/** Reads the history of the span that the timeline shows, when what is known of it does not do. */

import { signal } from "@preact/signals";

import type { Snapshot, TimelineDocument } from "../documents";
import { path, type Api } from "../api";
import type { Span, State } from "../state";
import { problemOf, UNANSWERED } from "../unanswered";
import type { History } from "./history";

const MOST_OF_TIMELINE = 5000;
/** While one pans or zooms nothing is read. */
const AFTER_MS = 180;

export interface HistoryUser {
  /** Who is where now, as it was told last. */
  present(): Snapshot;
  /** The history has changed. */
  told(): void;
  complain(error: unknown): void;
}

const RETRY_MS = 1000;

export class HistoryReader {
  private readonly api: Api;
  private readonly state: State;
  private readonly history: History;
  private readonly user: HistoryUser;
  /** What the timeline shows could not be read; as far as it is not known it is grey. */
  readonly isUnread = signal(false);
  private reading = new AbortController();
  private timer = 0;

  constructor(api: Api, state: State, history: History, user: HistoryUser) {
    this.api = api;
    this.state = state;
    this.history = history;
    this.user = user;
  }

  /** Reads nothing of another map any more. */
  stop(): void {
    clearTimeout(this.timer);
    this.reading.abort();
    this.isUnread.value = false;
  }

  readSoon(): void {
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.read(), AFTER_MS);
  }

  private async read(): Promise<void> {
    const name = this.state.map.peek()?.name;
    const span = this.state.span.peek();
    if (name === undefined || this.covers(span)) return;
    this.reading.abort();
    const { signal } = (this.reading = new AbortController());
    const margin = (span.to - span.from) / 2;
    const [from, to] = [span.from - margin, span.to + margin];
    const limits = `?from=${new Date(from).toISOString()}&to=${new Date(to).toISOString()}&limit=${MOST_OF_TIMELINE}`;
    try {
      const document = await this.api.get<TimelineDocument>(path`/maps/${name}/timeline` + limits, signal);
      if (signal.aborted) return;
      this.isUnread.value = false;
      this.history.take(document);
      const newest = this.state.newest.peek();
      if (newest !== null && newest >= from && newest <= to) this.history.continueWith(this.user.present());
      this.user.told();
    } catch (error) {
      if (signal.aborted) return;
      this.isUnread.value = true;
      this.user.complain(error);
      if (UNANSWERED.has(problemOf(error).status))
        this.timer = window.setTimeout(() => void this.read(), RETRY_MS);
    }
  }

  private covers(span: Span): boolean {
    const { loaded, hasMore } = this.history;
    if (loaded === null) return false;
    const newest = this.state.newest.peek() ?? span.to;
    if (loaded.from > span.from || loaded.to < Math.min(span.to, newest)) return false;
    return !hasMore || loaded.to - loaded.from < 3 * (span.to - span.from);
  }
}
