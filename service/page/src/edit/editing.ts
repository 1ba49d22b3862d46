/**
 * What is being drawn or moved, and what becomes of it when the pointer or the keys say something.
 *
 * It draws nothing and sends nothing: the sketch shows `draft`, the panel sends it.
 */

import { batch, computed, signal, type ReadonlySignal } from "@preact/signals";

import type { Outline, Point, Thing } from "../map/model";
import { doorwayAt, roomsBeside, type Doorway } from "./doorway";
import { faultOf } from "./outline";
import { distance, nearestOn } from "./plane";
import { gridFor, snap, type Snapped } from "./snapping";
import { t } from "../language/catalogue";

export type Draft =
  | { kind: "room"; corners: readonly Point[]; isClosed: boolean }
  | { kind: "door"; doorway: Doorway | null; isPlaced: boolean }
  | { kind: "shape"; thing: Thing; rings: Outline; moved: Point; isReshaped: boolean }
  | { kind: "place"; thing: Thing; doorway: Doorway | null; moved: Point };

/** What the pointer has hold of, of a shape: a corner, or all of it. */
type Grip = { corner: [ring: number, index: number] } | { from: Point; rings: Outline; moved: Point };

/** What else is on the storey, which corners keep to and doors stand in. */
export interface Surroundings {
  outlines: readonly Outline[];
  rooms: readonly Thing[];
}

const REACH_PX = 12;
const DOOR_M = 0.9;

export class Editing {
  readonly draft = signal<Draft | null>(null);
  /** Where the next corner would go. */
  readonly aim = signal<Snapped | null>(null);
  readonly doorWidth_m = signal(DOOR_M);
  /** Why what is drawn cannot be taken as it is; null: it can. */
  readonly fault: ReadonlySignal<string | null> = computed(() => faultIn(this.draft.value));

  private surroundings: () => Surroundings;
  private metresPerPixel: () => number;
  private grip: Grip | null = null;

  constructor(surroundings: () => Surroundings, metresPerPixel: () => number) {
    this.surroundings = surroundings;
    this.metresPerPixel = metresPerPixel;
  }

  begin(draft: Draft): void {
    batch(() => {
      this.draft.value = draft;
      this.aim.value = null;
    });
    this.grip = null;
  }

  drawRoom(): void {
    this.begin({ kind: "room", corners: [], isClosed: false });
  }

  drawDoor(): void {
    this.begin({ kind: "door", doorway: null, isPlaced: false });
  }

  /** Moves or reshapes what stands on the map; a shape of several parts can be moved only. */
  change(thing: Thing): void {
    const [outline, ...others] = thing.outlines;
    if (outline !== undefined && others.length === 0) {
      this.begin({ kind: "shape", thing, rings: outline, moved: [0, 0], isReshaped: false });
    } else {
      this.begin({ kind: "place", thing, doorway: null, moved: [0, 0] });
    }
  }

  stop(): void {
    batch(() => {
      this.draft.value = null;
      this.aim.value = null;
    });
    this.grip = null;
  }

  /** The pointer, or the crosshair of the keyboard, is at a place. */
  point(place: Point, square: boolean): void {
    const draft = this.draft.value;
    if (draft?.kind === "room" && !draft.isClosed)
      this.aim.value = this.snapped(place, draft.corners, square);
    else if (draft?.kind === "door" && !draft.isPlaced)
      this.draft.value = { ...draft, doorway: this.doorwayAt(place) };
    else if (this.grip !== null) this.drag(place, square);
  }

  /** Places a corner or a door, or takes hold of what is there; whether there was something to do. */
  press(place: Point, square: boolean): boolean {
    const draft = this.draft.value;
    switch (draft?.kind) {
      case "room":
        return this.placeCorner(draft, place, square);
      case "door":
        this.draft.value = {
          kind: "door",
          doorway: this.doorwayAt(place),
          isPlaced: this.doorwayAt(place) !== null,
        };
        return true;
      case "shape":
        this.grip = this.gripOf(draft, place);
        return this.grip !== null;
      case "place":
        this.grip = { from: place, rings: [], moved: draft.moved };
        return true;
      default:
        return false;
    }
  }

  release(): void {
    this.grip = null;
  }

  /** Closes the room that is drawn, if it can be one. */
  close(): void {
    const draft = this.draft.value;
    if (draft?.kind !== "room" || faultOf(draft.corners) !== null) return;
    batch(() => {
      this.draft.value = { ...draft, isClosed: true };
      this.aim.value = null;
    });
  }

  /** Takes the last corner back, or lets a placed door go on. */
  back(): void {
    const draft = this.draft.value;
    if (draft?.kind === "room" && draft.isClosed) this.draft.value = { ...draft, isClosed: false };
    else if (draft?.kind === "room") this.draft.value = { ...draft, corners: draft.corners.slice(0, -1) };
    else if (draft?.kind === "door") this.draft.value = { ...draft, isPlaced: false };
  }

  /** Puts corners where the table says. */
  setRing(ring: number, corners: readonly Point[]): void {
    const draft = this.draft.value;
    if (draft?.kind === "room") this.draft.value = { ...draft, corners };
    if (draft?.kind === "shape") {
      const rings = draft.rings.map((each, i) => (i === ring ? corners : each));
      this.draft.value = { ...draft, rings, isReshaped: true };
    }
  }

  /** Adds a corner in the middle of a side, and takes hold of it. */
  split(ring: number, side: number): void {
    const draft = this.draft.value;
    const corners = draft?.kind === "shape" ? draft.rings[ring] : undefined;
    const [a, b] = [corners?.[side], corners?.[(side + 1) % corners.length]];
    if (corners === undefined || a === undefined || b === undefined) return;
    const middle: Point = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
    this.setRing(ring, [...corners.slice(0, side + 1), middle, ...corners.slice(side + 1)]);
    this.grip = { corner: [ring, side + 1] };
  }

  removeCorner(ring: number, index: number): void {
    const draft = this.draft.value;
    const corners =
      draft?.kind === "room" ? draft.corners : draft?.kind === "shape" ? draft.rings[ring] : undefined;
    if (corners === undefined || (draft?.kind === "shape" && corners.length <= 3)) return;
    this.setRing(
      ring,
      corners.filter((_, i) => i !== index),
    );
  }

  /** Moves all of a shape, or the crosshair of a drawing, by the keyboard. */
  nudge([dx_m, dy_m]: Point): void {
    const draft = this.draft.value;
    if (draft?.kind === "shape")
      this.draft.value = { ...draft, ...shifted(draft.rings, draft.moved, [dx_m, dy_m]) };
    if (draft?.kind === "place")
      this.draft.value = this.placedBy(draft, [draft.moved[0] + dx_m, draft.moved[1] + dy_m]);
  }

  /** A door where the panel says, by numbers. */
  setDoorway(doorway: Doorway): void {
    const joins = roomsBeside(doorway.middle, doorway.yaw_rad, this.surroundings().rooms);
    this.draft.value = { kind: "door", doorway: { ...doorway, joins }, isPlaced: true };
  }

  reach_m(): number {
    return REACH_PX * this.metresPerPixel();
  }

  private snapped(place: Point, corners: readonly Point[], square: boolean): Snapped {
    const { outlines } = this.surroundings();
    return snap(place, {
      corners,
      outlines,
      reach_m: this.reach_m(),
      grid_m: gridFor(this.metresPerPixel()),
      square,
    });
  }

  private doorwayAt(place: Point): Doorway | null {
    return doorwayAt(
      place,
      this.surroundings().rooms,
      this.doorWidth_m.value,
      gridFor(this.metresPerPixel()),
    );
  }

  private placeCorner(draft: Draft & { kind: "room" }, place: Point, square: boolean): boolean {
    if (draft.isClosed) return false;
    const { point, to } = this.snapped(place, draft.corners, square);
    const last = draft.corners.at(-1);
    if (to === "start") this.close();
    else if (last === undefined || distance(last, point) > 0) {
      this.draft.value = { ...draft, corners: [...draft.corners, point] };
    }
    return true;
  }

  private gripOf({ rings, moved }: Draft & { kind: "shape" }, place: Point): Grip | null {
    for (const [ring, corners] of rings.entries()) {
      const index = corners.findIndex((corner) => distance(corner, place) <= this.reach_m());
      if (index >= 0) return { corner: [ring, index] };
    }
    for (const [ring, corners] of rings.entries()) {
      for (const [side, corner] of corners.entries()) {
        const middle = nearestOn([corner, corners[(side + 1) % corners.length] as Point], place);
        const isMiddle =
          Math.abs(middle.along - 0.5) < 0.2 && distance(middle.point, place) <= this.reach_m();
        if (isMiddle) {
          this.split(ring, side);
          return this.grip;
        }
      }
    }
    return { from: place, rings, moved };
  }

  private drag(place: Point, square: boolean): void {
    const draft = this.draft.value;
    const grip = this.grip;
    if (grip === null) return;
    if ("from" in grip) {
      const by: Point = [place[0] - grip.from[0], place[1] - grip.from[1]];
      if (draft?.kind === "shape")
        this.draft.value = { ...draft, ...shifted(grip.rings, grip.moved, this.onGrid(by)) };
      else if (draft?.kind === "place")
        this.draft.value = this.placedBy(draft, [grip.moved[0] + by[0], grip.moved[1] + by[1]]);
    } else if (draft?.kind === "shape") {
      const [ring, index] = grip.corner;
      const corners = draft.rings[ring] ?? [];
      const beside = [corners.at((index + 1) % corners.length), corners.at(index - 1)] as Point[];
      const { point } = this.snapped(place, beside, square);
      this.setRing(
        ring,
        corners.map((corner, i) => (i === index ? point : corner)),
      );
    }
  }

  /** A door goes along walls; anything else goes freely. */
  private placedBy(draft: Draft & { kind: "place" }, moved: Point): Draft {
    const { thing } = draft;
    if (thing.kind !== "door" || thing.line === null) return { ...draft, moved: this.onGrid(moved) };
    const [a, b] = thing.line;
    const width_m = distance(a, b);
    const wanted: Point = [thing.place[0] + moved[0], thing.place[1] + moved[1]];
    const doorway = doorwayAt(wanted, this.surroundings().rooms, width_m, gridFor(this.metresPerPixel()));
    return { ...draft, doorway, moved };
  }

  private onGrid([x, y]: Point): Point {
    const grid_m = gridFor(this.metresPerPixel());
    return [Math.round(x / grid_m) * grid_m, Math.round(y / grid_m) * grid_m];
  }
}

function shifted(rings: Outline, moved: Point, [dx, dy]: Point): { rings: Outline; moved: Point } {
  return {
    rings: rings.map((ring) => ring.map(([x, y]) => [x + dx, y + dy] as const)),
    moved: [moved[0] + dx, moved[1] + dy],
  };
}

function faultIn(draft: Draft | null): string | null {
  switch (draft?.kind) {
    case "room":
      return faultOf(draft.corners);
    case "shape":
      return draft.rings.map(faultOf).find((fault) => fault !== null) ?? null;
    case "door":
      return draft.isPlaced ? null : t("Place it in a wall.");
    default:
      return null;
  }
}
