/** Where tracks were: ribbons that become narrower and fainter. One mesh for all. */

import {
  BufferAttribute,
  BufferGeometry,
  DoubleSide,
  DynamicDrawUsage,
  Mesh,
  MeshBasicMaterial,
  type Color,
} from "three";

import { trailIndex, type Mover } from "../live/movement";

const ABOVE_M = 0.035;
const WIDTH_PX = 2.6;
const OPACITY = 0.75;
/** Points of a trail: those of a mover, and where it is now. */
const POINTS = 65;
/** So many points of all trails together are drawn: where many people are, long trails would hide the map. */
const MOST_POINTS = 4000;
const FEWEST_POINTS = 6;

export class Trails {
  readonly mesh: Mesh<BufferGeometry, MeshBasicMaterial>;
  private capacity = 0;
  private positions = new Float32Array(0);
  private tints = new Float32Array(0);
  private vertices = 0;
  private corners = 0;
  private index = new Uint32Array(0);
  private pointsEach = POINTS;

  constructor() {
    const material = new MeshBasicMaterial({
      vertexColors: true,
      transparent: true,
      depthWrite: false,
      side: DoubleSide,
    });
    this.mesh = new Mesh(new BufferGeometry(), material);
    this.mesh.frustumCulled = false;
    this.begin(64);
  }

  begin(tracks: number): void {
    this.pointsEach = Math.min(
      POINTS,
      Math.max(FEWEST_POINTS, Math.floor(MOST_POINTS / Math.max(1, tracks))),
    );
    // One may have a whole trail: the one that was chosen.
    const points = tracks * this.pointsEach + POINTS;
    if (points > this.capacity) this.reserve(2 * points);
    this.vertices = 0;
    this.corners = 0;
  }

  add(mover: Mover, floor_m: number, colour: Color, metresPerPixel: number, strong: boolean): void {
    const count = Math.min(mover.trailLength, strong ? POINTS : this.pointsEach);
    if (count < 2) return;
    const half = (WIDTH_PX * (strong ? 2 : 1) * metresPerPixel) / 2;
    let [x, y] = [mover.x_m, mover.y_m];
    let isFirst = true;
    // The newest point is where it moves to, which it may not have reached.
    for (let i = 1; i < count; i++) {
      const at = trailIndex(mover, i);
      const [toX, toY] = [mover.trail[at]!, mover.trail[at + 1]!];
      const length = Math.hypot(toX - x, toY - y);
      if (length < 1e-4) continue;
      const age = i / count;
      const width = (half * (1 - 0.7 * age)) / length;
      const [nx, ny] = [-(toY - y) * width, (toX - x) * width];
      const alpha = OPACITY * (1 - age);
      if (isFirst) this.joint(x, y, nx, ny, floor_m, colour, alpha);
      this.joint(toX, toY, nx, ny, floor_m, colour, alpha);
      this.join();
      isFirst = false;
      x = toX;
      y = toY;
    }
  }

  end(): void {
    const { geometry } = this.mesh;
    geometry.setDrawRange(0, this.corners);
    upload(geometry.getAttribute("position") as BufferAttribute, 3 * this.vertices);
    upload(geometry.getAttribute("color") as BufferAttribute, 4 * this.vertices);
    upload(geometry.getIndex()!, this.corners);
    this.mesh.visible = this.corners > 0;
  }

  /** Both edges of the ribbon at a place. */
  private joint(
    x: number,
    y: number,
    nx: number,
    ny: number,
    floor_m: number,
    colour: Color,
    alpha: number,
  ): void {
    for (const side of [1, -1]) {
      const at = this.vertices++;
      this.positions[3 * at] = x + side * nx;
      this.positions[3 * at + 1] = y + side * ny;
      this.positions[3 * at + 2] = floor_m + ABOVE_M;
      this.tints[4 * at] = colour.r;
      this.tints[4 * at + 1] = colour.g;
      this.tints[4 * at + 2] = colour.b;
      this.tints[4 * at + 3] = alpha;
    }
  }

  /** Two triangles between the last two joints. */
  private join(): void {
    const first = this.vertices - 4;
    const { index } = this;
    index[this.corners++] = first;
    index[this.corners++] = first + 1;
    index[this.corners++] = first + 2;
    index[this.corners++] = first + 2;
    index[this.corners++] = first + 1;
    index[this.corners++] = first + 3;
  }

  private reserve(points: number): void {
    this.capacity = points;
    this.positions = new Float32Array(3 * 2 * points);
    this.tints = new Float32Array(4 * 2 * points);
    this.index = new Uint32Array(6 * points);
    this.mesh.geometry.dispose();
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(this.positions, 3).setUsage(DynamicDrawUsage));
    geometry.setAttribute("color", new BufferAttribute(this.tints, 4).setUsage(DynamicDrawUsage));
    geometry.setIndex(new BufferAttribute(this.index, 1).setUsage(DynamicDrawUsage));
    this.mesh.geometry = geometry;
  }
}

/** Only what is drawn goes to the graphics card. */
function upload(attribute: BufferAttribute, length: number): void {
  attribute.clearUpdateRanges();
  attribute.addUpdateRange(0, length);
  attribute.needsUpdate = true;
}
