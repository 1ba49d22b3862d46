/** Doors: the leaf at its angle, with the arc that it swept; colour and shape both tell the state. */

import { Group, type InterleavedBufferAttribute } from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";

import type { DoorState } from "../documents";
import type { Point, Thing } from "../map/model";
import type { Colours } from "./colours";
import { lines } from "./floors";

const ABOVE_M = 0.025;
const GAP_ABOVE_M = 0.02;
const GAP_PX = 5;
const LEAF_PX = 3.2;
const ARC_STEPS = 10;
const SEGMENTS = 1 + ARC_STEPS;
const SWING_MS = 350;
/** How far a leaf stands open in each state, as a part of its largest angle. */
const OPEN: Readonly<Record<string, number>> = {
  open: 1,
  opening: 0.6,
  closing: 0.35,
  closed: 0,
  unknown: 0,
};
const USUAL_ANGLE_RAD = Math.PI / 2;

/** How a leaf is hung: where, of what length, and how it turns. */
export interface Leaf {
  readonly hinge: Point;
  readonly width_m: number;
  /** Direction from the hinge along the closed leaf. */
  readonly closed_rad: number;
  /** 1: it opens counter-clockwise, -1: clockwise. */
  readonly sense: 1 | -1;
  readonly largest_rad: number;
}

interface Drawn {
  readonly door: Thing;
  readonly leaf: Leaf;
  state: string;
  from: number;
  to: number;
  changedAt_ms: number;
}

/**
 * The leaf of a door as its attribute `leaf` says (docs/map-format.md): hinged at the beginning of the doorway (left) or
 * at its end, opening to the left of it. A door that says nothing is drawn as one hinged left.
 */
export function leafOf(door: Thing): Leaf | null {
  if (door.line === null) return null;
  const said = door.attributes["leaf"];
  const leaf: Record<string, unknown> =
    typeof said === "string" ? { hinge: said } : (((said as object | null) ?? {}) as Record<string, unknown>);
  const isRight = leaf["hinge"] === "right";
  const [start, end] = door.line;
  const [hinge, tip] = isRight ? [end, start] : [start, end];
  const width_m = Math.hypot(tip[0] - hinge[0], tip[1] - hinge[1]);
  if (width_m === 0) return null;
  const degrees = leaf["max_deg"];
  return {
    hinge,
    width_m,
    closed_rad: Math.atan2(tip[1] - hinge[1], tip[0] - hinge[0]),
    sense: isRight ? -1 : 1,
    largest_rad: typeof degrees === "number" ? (degrees * Math.PI) / 180 : USUAL_ANGLE_RAD,
  };
}

export class Doors {
  readonly group = new Group();
  private readonly colours: Colours;
  private readonly drawn: Drawn[] = [];
  private readonly geometry = new LineSegmentsGeometry();
  private readonly positions: Float32Array;
  private readonly tints: Float32Array;
  private readonly leaves: LineSegments2;

  constructor(doors: readonly Thing[], colours: Colours) {
    this.colours = colours;
    const gaps: number[] = [];
    for (const door of doors) {
      const leaf = leafOf(door);
      if (leaf === null || door.line === null) continue;
      const [[x, y], [toX, toY]] = door.line;
      gaps.push(x, y, door.zMin_m + GAP_ABOVE_M, toX, toY, door.zMin_m + GAP_ABOVE_M);
      if (door.sign !== "passage")
        this.drawn.push({ door, leaf, state: "unknown", from: 0, to: 0, changedAt_ms: -Infinity });
    }
    this.group.add(lines(gaps, GAP_PX, colours.occupancy[0]!.getHex()));
    const count = Math.max(this.drawn.length, 1);
    this.positions = new Float32Array(6 * SEGMENTS * count);
    this.tints = new Float32Array(6 * SEGMENTS * count);
    this.geometry.setPositions(this.positions);
    this.geometry.setColors(this.tints);
    this.leaves = new LineSegments2(
      this.geometry,
      new LineMaterial({ vertexColors: true, linewidth: LEAF_PX }),
    );
    this.leaves.frustumCulled = false;
    this.group.add(this.leaves);
    this.draw(0);
  }

  /** Leaves are drawn only while it is known how they stand: even "unknown" would say something. */
  show(isKnown: boolean): void {
    this.leaves.visible = isKnown && this.drawn.length > 0;
  }

  /** Takes the states of doors; those that changed swing. */
  take(states: ReadonlyMap<number, DoorState>, now_ms: number, isStill: boolean): void {
    for (const each of this.drawn) {
      const state = states.get(each.door.id)?.state ?? "unknown";
      if (state === each.state) continue;
      each.from = isStill ? (OPEN[state] ?? 0) : this.openness(each, now_ms);
      each.to = OPEN[state] ?? 0;
      each.state = state;
      each.changedAt_ms = now_ms;
    }
  }

  /** Draws the leaves as they stand at a time; whether one still swings. */
  draw(now_ms: number): boolean {
    let swings = false;
    this.drawn.forEach((each, i) => {
      const part = this.openness(each, now_ms);
      if (now_ms - each.changedAt_ms < SWING_MS) swings = true;
      this.place(each, part, 6 * SEGMENTS * i);
    });
    // Starts and ends lie interleaved in one buffer, which is `positions` (and `tints`) itself.
    for (const name of ["instanceStart", "instanceColorStart"]) {
      (this.geometry.getAttribute(name) as InterleavedBufferAttribute).data.needsUpdate = true;
    }
    return swings;
  }

  private openness(each: Drawn, now_ms: number): number {
    const part = Math.min(1, (now_ms - each.changedAt_ms) / SWING_MS);
    return each.from + (each.to - each.from) * part;
  }

  private place({ door, leaf, state }: Drawn, part: number, at: number): void {
    const [x, y] = leaf.hinge;
    const z = door.zMin_m + ABOVE_M;
    const angle = leaf.sense * part * leaf.largest_rad;
    const end = (turned: number): [number, number] => [
      x + leaf.width_m * Math.cos(leaf.closed_rad + turned),
      y + leaf.width_m * Math.sin(leaf.closed_rad + turned),
    ];
    const colour =
      this.colours[
        state === "open"
          ? "door-open"
          : state === "closed"
            ? "door-closed"
            : state === "unknown"
              ? "door-unknown"
              : "door-moving"
      ];
    for (let i = 0; i < SEGMENTS; i++) {
      const [fromX, fromY] = i === 0 ? [x, y] : end((angle * (i - 1)) / ARC_STEPS);
      const [toX, toY] = i === 0 ? end(angle) : end((angle * i) / ARC_STEPS);
      this.positions.set([fromX, fromY, z, toX, toY, z], at + 6 * i);
      this.tints.set([colour.r, colour.g, colour.b, colour.r, colour.g, colour.b], at + 6 * i);
    }
    if (state === "unknown") this.dash(at);
  }

  /** A door of which nothing is known is dashed: every other part of its doorway is left out. */
  private dash(at: number): void {
    const [x, y, z, toX, toY] = this.positions.subarray(at, at + 5) as unknown as [
      number,
      number,
      number,
      number,
      number,
    ];
    for (let i = 0; i < SEGMENTS; i++) {
      const [from, to] = i % 2 === 0 ? [i / SEGMENTS, (i + 1) / SEGMENTS] : [i / SEGMENTS, i / SEGMENTS];
      this.positions.set(
        [x + from * (toX - x), y + from * (toY - y), z, x + to * (toX - x), y + to * (toY - y), z],
        at + 6 * i,
      );
    }
  }
}
