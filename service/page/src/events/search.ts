/** The events of the map that are wanted: as they come, and further back as far as one looks. */

import { batch, computed, effect, signal, untracked, type ReadonlySignal } from "@preact/signals";

import type { EventDocument, EventPage, Problem } from "../documents";
import { path, type Api } from "../api";
import type { State } from "../state";
import { momentFrom, dayOf } from "../timeline/day";
import { contact, problemOf } from "../unanswered";
import { isEverything, merged, type EventFilter } from "./filter";

const PAGE = 200;
const MOST_OF_ALL = 100_000;
/** So many pages without an event are read before somebody has to say that it shall go on. */
const MOST_IN_VAIN = 20;
const LEAST_BETWEEN_MS = 1000;

export class EventSearch {
  readonly found: ReadonlySignal<readonly EventDocument[]>;
  readonly isReading = signal(true);
  readonly problem = signal<Problem | null>(null);
  /** To where it was looked, in milliseconds since 1970; null: to the beginning. */
  readonly reached = signal<number | null>(null);

  /** Whether nothing was found for long, and there may be something further back. */
  readonly isInVain = signal(false);

  private readonly read = signal<readonly EventDocument[]>([]);
  private next: string | null = null;
  private reading = new AbortController();
  private freshTimer = 0;

  constructor(
    private readonly api: Api,
    private readonly state: State,
  ) {
    this.found = computed(() => {
      const read = this.read.value;
      if (!isEverything(state.eventFilter.value)) return read;
      const oldest = this.reached.value;
      const told = state.events.value;
      return merged(read, oldest === null ? told : told.filter((each) => Date.parse(each.stamp) > oldest));
    });
  }

  /** Follows the map and what is wanted as long as the list is shown. */
  start(): void {
    effect(() => {
      const { mapName, eventFilter, tab } = this.state;
      void [mapName.value, eventFilter.value, contact.value];
      if (tab.value === "events") untracked(() => this.begin());
    });
    effect(() => {
      void this.state.events.value;
      if (!isEverything(this.state.eventFilter.peek())) this.refreshSoon();
    });
  }

  get hasMore(): boolean {
    return this.reached.value !== null;
  }

  /** Reads further back until there is an event; where that takes long, it is asked again first. */
  async more(isAsked = false): Promise<void> {
    if (this.isReading.peek() || !this.hasMore || (this.isInVain.peek() && !isAsked)) return;
    await this.go();
  }

  /** All that is wanted, page by page, at most 100,000; `told` hears how many there are by now. */
  async all(told: (count: number) => void, signal: AbortSignal): Promise<EventDocument[]> {
    const found: EventDocument[] = [];
    let next: string | null = null;
    do {
      const page: EventPage = await this.page(next, 1000, signal);
      found.push(...page.events);
      next = page.next;
      told(found.length);
    } while (next !== null && found.length < MOST_OF_ALL);
    return found;
  }

  private begin(): void {
    this.reading.abort();
    this.reading = new AbortController();
    this.next = null;
    batch(() => {
      this.read.value = [];
      this.reached.value = null;
      this.problem.value = null;
      this.isInVain.value = false;
      this.isReading.value = false;
    });
    if (this.state.mapName.peek() !== null) void this.go();
  }

  private async go(): Promise<void> {
    const { signal } = this.reading;
    this.isReading.value = true;
    try {
      for (let vain = 1; vain <= MOST_IN_VAIN; vain++) {
        const page = await this.page(this.next, PAGE, signal);
        this.next = page.next;
        batch(() => {
          this.problem.value = null;
          this.read.value = merged(this.read.peek(), page.events);
          this.reached.value = page.reached === null ? null : Date.parse(page.reached);
        });
        this.isInVain.value = page.events.length === 0 && page.next !== null;
        if (!this.isInVain.value) break;
      }
    } catch (error) {
      if (signal.aborted) return;
      this.problem.value = problemOf(error);
    }
    if (!signal.aborted) this.isReading.value = false;
  }

  /** What is new is read as all else is, where only some of it is wanted. */
  private refreshSoon(): void {
    if (this.freshTimer !== 0 || this.state.mapName.peek() === null) return;
    this.freshTimer = window.setTimeout(() => {
      this.freshTimer = 0;
      const { signal } = this.reading;
      this.page(null, PAGE, signal).then(
        (page) => {
          if (!signal.aborted) this.read.value = merged(this.read.peek(), page.events);
        },
        () => {},
      );
    }, LEAST_BETWEEN_MS);
  }

  private page(before: string | null, limit: number, signal: AbortSignal): Promise<EventPage> {
    const query = queryOf(this.state.eventFilter.peek());
    query.set("limit", `${limit}`);
    if (before !== null) query.set("before", before);
    return this.api.get(path`/maps/${this.state.mapName.peek()!}/events` + `?${query}`, signal);
  }
}

export function queryOf(filter: EventFilter): URLSearchParams {
  const query = new URLSearchParams();
  for (const name of ["type", "track", "instance", "text"] as const)
    if (filter[name] !== "") query.set(name, filter[name]);
  const noon = momentFrom(filter.day, "12:00");
  if (noon !== null) {
    const { from, to } = dayOf(noon);
    query.set("from", new Date(from).toISOString());
    query.set("to", new Date(to - 1).toISOString());
  }
  return query;
}
