/** Reads the moment of the past that is shown, until it has been read: one request at a time, only the newest wanted. */

import type { Snapshot } from "./documents";
import { path, type Api } from "./api";
import type { State } from "./state";
import { problemOf, UNANSWERED } from "./unanswered";

const TRAIL_S = 10;
const RETRY_MS = 1000;
/** What is drawn of another moment for longer than this would be taken for the one that is shown; played, it moves on. */
const LATE_MS = 200;
const LATE_PLAYING_MS = 1000;

export interface MomentUser {
  /** This is how it was. */
  take(snapshot: Snapshot): void;
  /** It is not known how it was. */
  forget(): void;
}

export class MomentReader {
  private readonly api: Api;
  private readonly state: State;
  private readonly user: MomentUser;
  private reading: AbortController | null = null;
  private wanted: number | null = null;
  private retryTimer = 0;
  private lateTimer = 0;

  constructor(api: Api, state: State, user: MomentUser) {
    this.api = api;
    this.state = state;
    this.user = user;
  }

  show(at: number, isPlaying: boolean): void {
    this.wanted = at;
    if (this.state.isKnown.peek() && this.lateTimer === 0)
      this.lateTimer = window.setTimeout(() => this.fall(), isPlaying ? LATE_PLAYING_MS : LATE_MS);
    void this.read();
  }

  /** Asks anew for what is shown and not known, though an answer is still awaited: it may never come. */
  readAgain(): void {
    const at = this.state.at.peek();
    if (at === null || (this.state.isKnown.peek() && this.reading === null && this.wanted === null)) return;
    this.stop();
    this.wanted = at;
    void this.read();
  }

  stop(): void {
    this.reading?.abort();
    this.reading = this.wanted = null;
    this.settle();
  }

  private async read(): Promise<void> {
    const name = this.state.mapName.peek();
    if (this.reading || this.wanted === null || name === null) return;
    const { signal } = (this.reading = new AbortController());
    const at = this.wanted;
    this.wanted = null;
    clearTimeout(this.retryTimer);
    try {
      const address = path`/maps/${name}/moment` + `?at=${new Date(at).toISOString()}&trail_s=${TRAIL_S}`;
      const snapshot = await this.api.get<Snapshot>(address, signal);
      if (signal.aborted) return;
      this.settle();
      this.state.unread.value = null;
      this.user.take(snapshot);
    } catch (error) {
      if (!signal.aborted) this.fail(at, error);
    }
    if (signal.aborted) return;
    this.reading = null;
    if (this.retryTimer === 0) void this.read();
  }

  private fail(at: number, error: unknown): void {
    this.fall();
    const problem = problemOf(error);
    this.state.unread.value = problem;
    if (!UNANSWERED.has(problem.status)) return;
    this.wanted ??= at;
    this.retryTimer = window.setTimeout(() => {
      this.retryTimer = 0;
      void this.read();
    }, RETRY_MS);
  }

  private fall(): void {
    this.settle();
    this.user.forget();
  }

  private settle(): void {
    clearTimeout(this.lateTimer);
    clearTimeout(this.retryTimer);
    this.lateTimer = this.retryTimer = 0;
  }
}
