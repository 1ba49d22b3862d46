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

export class Trails {
  readonly mesh: Mesh<BufferGeometry, MeshBasicMaterial>;
  private capacity = 0;
  private positions = new Float32Array(0);
  private tints = new Float32Array(0);
  private vertices = 0;
  private triangles = 0;
  private index = new Uint32Array(0);

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
    if (tracks > this.capacity) this.reserve(2 * tracks);
    this.vertices = 0;
    this.triangles = 0;
  }

  add(mover: Mover, floor_m: number, colour: Color, metresPerPixel: number, strong: boolean): void {
    const count = mover.trailLength;
    if (count < 2) return;
    const half = (WIDTH_PX * (strong ? 2 : 1) * metresPerPixel) / 2;
    let [x, y] = [mover.x_m, mover.y_m];
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
      const first = this.vertices;
      this.vertex(x + nx, y + ny, floor_m, colour, alpha);
      this.vertex(x - nx, y - ny, floor_m, colour, alpha);
      this.vertex(toX + nx, toY + ny, floor_m, colour, alpha);
      this.vertex(toX - nx, toY - ny, floor_m, colour, alpha);
      this.triangle(first, first + 1, first + 2);
      this.triangle(first + 2, first + 1, first + 3);
      x = toX;
      y = toY;
    }
  }

  end(): void {
    const { geometry } = this.mesh;
    geometry.setDrawRange(0, 3 * this.triangles);
    for (const name of ["position", "color"])
      (geometry.getAttribute(name) as BufferAttribute).needsUpdate = true;
    geometry.getIndex()!.needsUpdate = true;
    this.mesh.visible = this.triangles > 0;
  }

  private vertex(x: number, y: number, floor_m: number, colour: Color, alpha: number): void {
    const at = this.vertices++;
    this.positions[3 * at] = x;
    this.positions[3 * at + 1] = y;
    this.positions[3 * at + 2] = floor_m + ABOVE_M;
    this.tints[4 * at] = colour.r;
    this.tints[4 * at + 1] = colour.g;
    this.tints[4 * at + 2] = colour.b;
    this.tints[4 * at + 3] = alpha;
  }

  private triangle(a: number, b: number, c: number): void {
    const at = 3 * this.triangles++;
    this.index[at] = a;
    this.index[at + 1] = b;
    this.index[at + 2] = c;
  }

  private reserve(tracks: number): void {
    this.capacity = tracks;
    this.positions = new Float32Array(3 * 4 * POINTS * tracks);
    this.tints = new Float32Array(4 * 4 * POINTS * tracks);
    this.index = new Uint32Array(6 * POINTS * tracks);
    this.mesh.geometry.dispose();
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(this.positions, 3).setUsage(DynamicDrawUsage));
    geometry.setAttribute("color", new BufferAttribute(this.tints, 4).setUsage(DynamicDrawUsage));
    geometry.setIndex(new BufferAttribute(this.index, 1).setUsage(DynamicDrawUsage));
    this.mesh.geometry = geometry;
  }
}
