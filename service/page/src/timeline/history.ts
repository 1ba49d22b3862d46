/**
 * What happened, as the timeline draws it: read for a span, and continued by what is told live. Moments are milliseconds
 * since 1970; an interval without an end goes on.
 */

import type { Delta, EventDocument, Snapshot, TimelineDocument } from "../documents";
import type { Span } from "../state";

export interface Stay {
  trackId: number;
  name: string;
  from: number;
  to: number | null;
}

export interface Position {
  state: string;
  from: number;
  to: number | null;
}

export interface Happened {
  event: EventDocument;
  at: number;
}

export class History {
  readonly stays = new Map<number, Stay[]>();
  readonly positions = new Map<number, Position[]>();
  /** In the order of their stamps. */
  events: Happened[] = [];
  /** The span that was read; null: nothing yet. */
  loaded: Span | null = null;
  /** Whether the span has more than was read. */
  hasMore = false;
  /** What was told since then leaves a gap: nothing is continued until it was read again. */
  private isCut = false;
  private readonly known = new Set<string>();
  /** The stays that go on, by track and room. */
  private readonly open = new Map<number, Map<number, Stay>>();

  /** Takes what was read, in place of all that was there. */
  take(document: TimelineDocument): void {
    this.clear();
    for (const { instance_id, stays } of document.rooms) {
      const taken = stays.map((each) => ({ trackId: each.track_id, name: each.name, ...ends(each) }));
      this.stays.set(instance_id, taken);
      for (const stay of taken) {
        if (stay.to === null)
          this.listOf(this.open, stay.trackId, () => new Map<number, Stay>()).set(instance_id, stay);
      }
    }
    for (const { instance_id, states } of document.doors) {
      this.positions.set(
        instance_id,
        states.map((each) => ({ state: each.state, ...ends(each) })),
      );
    }
    this.loaded = { from: Date.parse(document.from), to: Date.parse(document.to) };
    this.hasMore = document.more;
    this.addEvents(document.events);
  }

  clear(): void {
    this.stays.clear();
    this.positions.clear();
    this.open.clear();
    this.events = [];
    this.known.clear();
    this.loaded = null;
    this.hasMore = false;
    this.isCut = false;
  }

  /** Nothing is told for a while: it is known up to the newest that was told, and no further. */
  cut(newest: number): void {
    this.isCut = true;
    if (this.loaded !== null && newest < this.loaded.to)
      this.loaded = { from: this.loaded.from, to: Math.max(this.loaded.from, newest) };
  }

  /** Takes events, those that are known already once. */
  addEvents(events: readonly EventDocument[]): void {
    let isSorted = true;
    for (const event of events) {
      if (this.known.has(event.event_id)) continue;
      this.known.add(event.event_id);
      const at = Date.parse(event.stamp);
      isSorted &&= at >= (this.events[this.events.length - 1]?.at ?? -Infinity);
      this.events.push({ event, at });
    }
    if (!isSorted) this.events.sort((a, b) => a.at - b.at);
  }

  /** Continues with what is told live: who is in which room, and how doors stand. */
  continueWith(told: Snapshot | Delta): void {
    if (this.isCut) return;
    for (const track of told.tracks) {
      const at = Date.parse(track.stamp);
      this.extend(at);
      this.move(track.track_id, track.name, track.ended ? [] : track.rooms, at);
    }
    if ("gone" in told && told.stamp !== null) {
      for (const id of told.gone) this.move(id, "", [], Date.parse(told.stamp));
    }
    for (const door of told.doors) {
      const at = door.since === null ? null : Date.parse(door.since);
      if (at === null) continue;
      const positions = this.listOf(this.positions, door.instance_id, () => []);
      const last = positions[positions.length - 1];
      if (last && (last.state === door.state || last.from >= at)) continue;
      if (last && last.to === null) last.to = at;
      positions.push({ state: door.state, from: at, to: null });
      this.extend(at);
    }
  }

  private move(trackId: number, name: string, rooms: readonly number[], at: number): void {
    const open = this.listOf(this.open, trackId, () => new Map<number, Stay>());
    for (const [room, stay] of open) {
      // What is older than the stay, such as of a recording that is played once more, does not end it.
      if (rooms.includes(room) || at < stay.from) continue;
      stay.to = at;
      open.delete(room);
    }
    for (const room of rooms) {
      if (open.has(room)) continue;
      const stay = { trackId, name, from: at, to: null };
      this.listOf(this.stays, room, () => []).push(stay);
      open.set(room, stay);
    }
    if (open.size === 0) this.open.delete(trackId);
  }

  /** Forgets what was over before a moment, where there is too much of it. */
  forget(before: number): void {
    if (this.loaded === null || before <= this.loaded.from || this.size() < MOST_KEPT) return;
    this.loaded = { from: before, to: Math.max(before, this.loaded.to) };
    const gone = this.events.splice(0, firstAt(this.events, before));
    for (const { event } of gone) this.known.delete(event.event_id);
    const lasts = (each: { to: number | null }): boolean => each.to === null || each.to >= before;
    for (const [id, stays] of this.stays) this.stays.set(id, stays.filter(lasts));
    for (const [id, positions] of this.positions) this.positions.set(id, positions.filter(lasts));
  }

  /** How much it holds; a map without rules has no events, and stays all the same. */
  private size(): number {
    let size = this.events.length;
    for (const lists of [this.stays, this.positions]) for (const list of lists.values()) size += list.length;
    return size;
  }

  /** It is known up to a moment. */
  extend(at: number): void {
    if (this.isCut) return;
    if (this.loaded === null) this.loaded = { from: at, to: at };
    else if (at > this.loaded.to) this.loaded = { from: this.loaded.from, to: at };
  }

  private listOf<T>(lists: Map<number, T>, id: number, make: () => T): T {
    let list = lists.get(id);
    if (list === undefined) lists.set(id, (list = make()));
    return list;
  }
}

function ends({ from, to }: { from: string; to: string | null }): { from: number; to: number | null } {
  return { from: Date.parse(from), to: to === null ? null : Date.parse(to) };
}

/** How much a page that stays open for days keeps of what it is told; what is older is read again when it is looked at. */
const MOST_KEPT = 20_000;

/** Lays intervals that overlap beside each other: the lane of each, in the order given, and how many lanes there are. */
export function lanesOf(intervals: readonly { from: number; to: number | null }[]): {
  lanes: number[];
  count: number;
} {
  const order = intervals.map((_, i) => i).sort((a, b) => intervals[a]!.from - intervals[b]!.from);
  const ends: number[] = [];
  const lanes = new Array<number>(intervals.length).fill(0);
  for (const i of order) {
    const { from, to } = intervals[i]!;
    let lane = ends.findIndex((end) => end <= from);
    if (lane < 0) lane = ends.length;
    ends[lane] = to ?? Infinity;
    lanes[i] = lane;
  }
  return { lanes, count: ends.length };
}

/** The first index of a sorted list at or after a moment. */
export function firstAt(list: readonly { at: number }[], moment: number): number {
  let low = 0;
  let high = list.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (list[middle]!.at < moment) low = middle + 1;
    else high = middle;
  }
  return low;
}
