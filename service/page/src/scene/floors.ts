/** Rooms: floors tinted by how many are in them, their outlines, and in space their walls. */

import {
  BufferAttribute,
  BufferGeometry,
  DoubleSide,
  Group,
  Mesh,
  MeshBasicMaterial,
  ShapeUtils,
  Vector2,
} from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";

import type { Outline, Thing } from "../map/model";
import { occupancyStep, type Colours } from "./colours";

const LINE_ABOVE_M = 0.015;
const WALL_PX = 2.4;
const WALL_OPACITY = 0.2;
/** Walls are cut off, so that they hide little of what is behind them. */
const CUT_M = 1.1;
/** In place of a step of occupancy. */
const UNREAD = -2;

export class Floors {
  readonly group = new Group();
  private readonly colours: Colours;
  private readonly tints: BufferAttribute;
  private readonly ranges: { id: number; start: number; end: number; step: number }[] = [];
  private readonly walls: Mesh<BufferGeometry, MeshBasicMaterial>;

  constructor(rooms: readonly Thing[], colours: Colours) {
    this.colours = colours;
    const positions: number[] = [];
    const indices: number[] = [];
    for (const room of rooms) {
      const start = positions.length / 3;
      for (const outline of room.outlines) addFloor(outline, room.zMin_m, positions, indices);
      this.ranges.push({ id: room.id, start, end: positions.length / 3, step: -1 });
    }
    const floor = new BufferGeometry();
    floor.setAttribute("position", new BufferAttribute(new Float32Array(positions), 3));
    this.tints = new BufferAttribute(new Float32Array(positions.length), 3);
    floor.setAttribute("color", this.tints);
    floor.setIndex(indices);
    this.group.add(new Mesh(floor, new MeshBasicMaterial({ vertexColors: true, side: DoubleSide })));
    this.group.add(outlinesOf(rooms, colours));
    this.walls = wallsOf(rooms, colours);
    this.group.add(this.walls);
    this.tint(null);
  }

  /** Gives each room the colour of how many are in it; null: that is not known. */
  tint(occupancy: ReadonlyMap<number, number> | null): void {
    for (const range of this.ranges) {
      const step = occupancy === null ? UNREAD : occupancyStep(occupancy.get(range.id) ?? 0);
      if (step === range.step) continue;
      range.step = step;
      const { r, g, b } = this.colours.occupancy[step] ?? this.colours["map-unread"];
      for (let i = range.start; i < range.end; i++) this.tints.setXYZ(i, r, g, b);
      this.tints.needsUpdate = true;
    }
  }

  /** How far the space is shown, 0 to 1: its walls come with it. */
  mix(mix: number): void {
    this.walls.visible = mix > 0;
    this.walls.material.opacity = WALL_OPACITY * mix;
  }
}

export function addFloor(outline: Outline, z_m: number, positions: number[], indices: number[]): void {
  const [outer, ...holes] = outline.map((ring) => ring.map(([x, y]) => new Vector2(x, y)));
  if (!outer) return;
  const first = positions.length / 3;
  for (const face of ShapeUtils.triangulateShape(outer, holes)) indices.push(...face.map((i) => first + i));
  for (const ring of [outer, ...holes]) for (const { x, y } of ring) positions.push(x, y, z_m);
}

/** Lines around outlines, of a width in pixels. */
export function lines(segments: readonly number[], width_px: number, colour: number): LineSegments2 {
  const geometry = new LineSegmentsGeometry();
  geometry.setPositions(segments.length > 0 ? [...segments] : [0, 0, 0, 0, 0, 0]);
  const drawn = new LineSegments2(geometry, new LineMaterial({ color: colour, linewidth: width_px }));
  drawn.visible = segments.length > 0;
  return drawn;
}

export function addRing(ring: Outline[number], z_m: number, segments: number[]): void {
  ring.forEach(([x, y], i) => {
    const [nextX, nextY] = ring[(i + 1) % ring.length]!;
    segments.push(x, y, z_m, nextX, nextY, z_m);
  });
}

function outlinesOf(rooms: readonly Thing[], colours: Colours): LineSegments2 {
  const segments: number[] = [];
  for (const room of rooms) {
    for (const outline of room.outlines) {
      for (const ring of outline) addRing(ring, room.zMin_m + LINE_ABOVE_M, segments);
    }
  }
  return lines(segments, WALL_PX, colours["map-wall"].getHex());
}

function wallsOf(rooms: readonly Thing[], colours: Colours): Mesh<BufferGeometry, MeshBasicMaterial> {
  const positions: number[] = [];
  for (const room of rooms) {
    const top = Math.min(room.zMax_m ?? Infinity, room.zMin_m + CUT_M);
    for (const ring of room.outlines.flat()) {
      ring.forEach(([x, y], i) => {
        const [nextX, nextY] = ring[(i + 1) % ring.length]!;
        const bottom = room.zMin_m;
        positions.push(x, y, bottom, nextX, nextY, bottom, nextX, nextY, top);
        positions.push(x, y, bottom, nextX, nextY, top, x, y, top);
      });
    }
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(positions), 3));
  const material = new MeshBasicMaterial({
    color: colours["map-wall"],
    transparent: true,
    opacity: 0,
    depthWrite: false,
    side: DoubleSide,
  });
  return new Mesh(geometry, material);
}
