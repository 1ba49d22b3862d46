/** Tracks: a body of its extent with its heading, the ellipse of uncertainty, the trail. Nothing is allocated per frame. */

import {
  BufferGeometry,
  CapsuleGeometry,
  CircleGeometry,
  Color,
  DynamicDrawUsage,
  Float32BufferAttribute,
  Group,
  InstancedMesh,
  Matrix4,
  MeshBasicMaterial,
  MeshLambertMaterial,
  RingGeometry,
  type Material,
} from "three";

import type { Mover } from "../live/movement";
import { trackColour, type Colours } from "./colours";
import { ellipse95, type Ellipse } from "./ellipse";
import { Trails } from "./trails";

/** Radius of one whose extent is not known. */
const USUAL_RADIUS_M = 0.25;
const SMALLEST_PX = 6;
const BODY_HEIGHT_M = 1.7;
const FIRST_CAPACITY = 64;
const HALO = 1.25;
const HALO_MARKED = 1.6;

const UNCERTAIN_ABOVE_M = 0.03;
const HALO_ABOVE_M = 0.05;
const NOSE_ABOVE_M = 0.055;
const DISC_ABOVE_M = 0.06;

/** What a picture of people needs to know besides the people. */
export interface Look {
  metresPerPixel: number;
  mix: number;
  selected: number | null;
  hovered: number | null;
  /** Height of the floor below one, or null where it is on a storey that is not shown. */
  floorOf(mover: Mover): number | null;
}

export class People {
  readonly group = new Group();
  private readonly colours: Colours;
  private readonly trails: Trails;
  private capacity = 0;
  private layers: InstancedMesh[] = [];
  private readonly matrix = new Matrix4();
  private readonly ellipse: Ellipse = { a_m: 0, b_m: 0, angle_rad: 0 };

  constructor(colours: Colours) {
    this.colours = colours;
    this.trails = new Trails();
    this.group.add(this.trails.mesh);
    this.reserve(FIRST_CAPACITY);
  }

  /** Draws all where they are. */
  draw(movers: ReadonlyMap<number, Mover>, look: Look): void {
    if (movers.size > this.capacity) this.reserve(2 * movers.size);
    const [uncertain, halo, nose, disc, body] = this.layers as [
      InstancedMesh,
      InstancedMesh,
      InstancedMesh,
      InstancedMesh,
      InstancedMesh,
    ];
    const smallest = SMALLEST_PX * look.metresPerPixel;
    let count = 0;
    this.trails.begin(movers.size);
    for (const [id, mover] of movers) {
      const floor = look.floorOf(mover);
      if (floor === null) continue;
      const { state, heading_rad: heading } = mover;
      const along = Math.max((state.length_m ?? 2 * USUAL_RADIUS_M) / 2, smallest);
      const across = Math.max((state.width_m ?? state.length_m ?? 2 * USUAL_RADIUS_M) / 2, smallest);
      const marked = id === look.selected || id === look.hovered;
      const colour = trackColour(id);
      this.set(disc, count, mover, floor + DISC_ABOVE_M, heading, along, across, colour);
      const ring = marked ? HALO_MARKED : HALO;
      this.set(
        halo,
        count,
        mover,
        floor + HALO_ABOVE_M,
        heading,
        along * ring,
        across * ring,
        marked ? this.colours["map-select"] : this.colours["map-ring"],
      );
      const ahead = mover.hasHeading ? Math.max(along, across) : 0;
      this.set(
        nose,
        count,
        mover,
        floor + NOSE_ABOVE_M,
        heading,
        ahead,
        mover.hasHeading ? 0.75 * across : 0,
        colour,
      );
      const known = ellipse95(state.cov_xx_m2, state.cov_xy_m2, state.cov_yy_m2, this.ellipse);
      const { a_m, b_m, angle_rad } = this.ellipse;
      this.set(
        uncertain,
        count,
        mover,
        floor + UNCERTAIN_ABOVE_M,
        angle_rad,
        known ? a_m : 0,
        known ? b_m : 0,
        colour,
      );
      this.set(body, count, mover, floor, heading, along, across, colour, look.mix * BODY_HEIGHT_M);
      this.trails.add(mover, floor, colour, look.metresPerPixel, id === look.selected);
      count++;
    }
    for (const layer of this.layers) {
      layer.count = count;
      layer.instanceMatrix.needsUpdate = true;
      if (layer.instanceColor) layer.instanceColor.needsUpdate = true;
    }
    body.visible = look.mix > 0;
    this.trails.end();
  }

  private set(
    layer: InstancedMesh,
    i: number,
    mover: Mover,
    z: number,
    angle: number,
    along: number,
    across: number,
    colour: Color,
    height = 1,
  ): void {
    const cos = Math.cos(angle);
    const sin = Math.sin(angle);
    this.matrix.set(
      cos * along,
      -sin * across,
      0,
      mover.x_m,
      sin * along,
      cos * across,
      0,
      mover.y_m,
      0,
      0,
      height,
      z,
      0,
      0,
      0,
      1,
    );
    layer.setMatrixAt(i, this.matrix);
    layer.setColorAt(i, colour);
  }

  private reserve(capacity: number): void {
    for (const layer of this.layers) {
      this.group.remove(layer);
      layer.geometry.dispose();
      (layer.material as Material).dispose();
      layer.dispose();
    }
    this.capacity = capacity;
    const body = new CapsuleGeometry(1, 1, 4, 10)
      .rotateX(Math.PI / 2)
      .scale(0.8, 0.8, 1 / 3)
      .translate(0, 0, 0.5);
    this.layers = [
      this.layer(
        new CircleGeometry(1, 40),
        new MeshBasicMaterial({ transparent: true, opacity: 0.22, depthWrite: false }),
      ),
      this.layer(new RingGeometry(0.6, 1, 36), new MeshBasicMaterial()),
      this.layer(nose(), new MeshBasicMaterial()),
      this.layer(new CircleGeometry(1, 28), new MeshBasicMaterial()),
      this.layer(body, new MeshLambertMaterial()),
    ];
    this.group.add(...this.layers);
  }

  private layer(geometry: BufferGeometry, material: Material): InstancedMesh {
    const layer = new InstancedMesh(geometry, material, this.capacity);
    layer.instanceMatrix.setUsage(DynamicDrawUsage);
    // Moves with each frame, so that its bounds would be computed anew as often.
    layer.frustumCulled = false;
    layer.setColorAt(0, this.colours["map-ground"]);
    layer.count = 0;
    return layer;
  }
}

/** A triangle ahead of a body of radius 1 that faces along x. */
function nose(): BufferGeometry {
  const geometry = new BufferGeometry();
  geometry.setAttribute(
    "position",
    new Float32BufferAttribute([0.55, -0.83, 0, 1.85, 0, 0, 0.55, 0.83, 0], 3),
  );
  return geometry;
}
