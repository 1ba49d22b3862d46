/** All that moves, as it is drawn: from snapshots and deltas, whether of now or of a moment of the past. */

import type { Delta, DoorState, Snapshot, TrackState } from "../documents";
import { moveAll, newMover, settle, tell, type Mover } from "./movement";

export class World {
  readonly movers = new Map<number, Mover>();
  readonly doors = new Map<number, DoorState>();
  /** How many are in each room; a new map with each change. */
  occupancy: ReadonlyMap<number, number> = new Map();
  /** Rises with each change of doors. */
  doorsVersion = 0;
  /** Whether anything was told: before that, empty rooms and doors of no state would be made up. */
  isKnown = false;

  /** Takes all of a moment. Who was there before moves on to where they are; who is missing is gone. */
  take(snapshot: Snapshot, now_ms: number): void {
    const present = new Set<number>();
    for (const state of snapshot.tracks) {
      if (state.ended) continue;
      present.add(state.track_id);
      this.tellOne(state, now_ms);
    }
    for (const id of this.movers.keys()) if (!present.has(id)) this.movers.delete(id);
    this.doors.clear();
    for (const door of snapshot.doors) this.doors.set(door.instance_id, door);
    this.doorsVersion++;
    this.occupancy = countsOf(snapshot.rooms);
    this.isKnown = true;
  }

  /** Takes what changed. */
  change(delta: Delta, now_ms: number): void {
    for (const state of delta.tracks) {
      if (state.ended) this.movers.delete(state.track_id);
      else this.tellOne(state, now_ms);
    }
    for (const id of delta.gone) this.movers.delete(id);
    for (const door of delta.doors) this.doors.set(door.instance_id, door);
    if (delta.doors.length > 0) this.doorsVersion++;
    const changed = Object.entries(delta.rooms);
    if (changed.length > 0) {
      const occupancy = new Map(this.occupancy);
      for (const [id, count] of changed) occupancy.set(Number(id), count);
      this.occupancy = occupancy;
    }
  }

  /** Whether something will move on without news. */
  move(now_ms: number): boolean {
    return moveAll(this.movers.values(), now_ms);
  }

  /** Puts everybody where they were told to be: for a moment of the past, and where motion is not wanted. */
  settle(): void {
    for (const mover of this.movers.values()) settle(mover);
  }

  /** All of it as it was told last. */
  snapshot(): Snapshot {
    const tracks = [...this.movers.values()].map((each) => each.state);
    return { stamp: null, tracks, doors: [...this.doors.values()], rooms: {} };
  }

  /** Nothing is known any more. */
  clear(): void {
    this.isKnown = false;
    this.movers.clear();
    this.doors.clear();
    this.doorsVersion++;
    this.occupancy = new Map();
  }

  private tellOne(state: TrackState, now_ms: number): void {
    const mover = this.movers.get(state.track_id);
    if (mover) tell(mover, state, now_ms);
    else this.movers.set(state.track_id, newMover(state, now_ms));
  }
}

function countsOf(rooms: Record<string, number>): ReadonlyMap<number, number> {
  return new Map(Object.entries(rooms).map(([id, count]) => [Number(id), count]));
}
