/** Tracks: a body of its extent with its heading, the ellipse of uncertainty, the trail; crowds as one mark each. */

import { CapsuleGeometry, DynamicDrawUsage, Group, InstancedMesh, Matrix4, MeshLambertMaterial } from "three";

import type { Mover } from "../live/movement";
import { trackColour, type Colours } from "./colours";
import { radiusOf, type Crowd, type Parted } from "./crowds";
import { ellipse95, type Ellipse } from "./ellipse";
import { Marks, type Mark } from "./marks";
import { Trails } from "./trails";

/** Radius of one whose extent is not known. */
const USUAL_RADIUS_M = 0.25;
const SMALLEST_PX = 6;
const BODY_HEIGHT_M = 1.7;
const FIRST_CAPACITY = 64;
const HALO = 1.25;
const HALO_MARKED = 1.6;
const UNCERTAIN_OPACITY = 0.22;

const UNCERTAIN_ABOVE_M = 0.03;
const BODY_ABOVE_M = 0.06;
const CROWD_ABOVE_M = 0.07;

/** What a picture of people needs to know besides the people. */
export interface Look {
  metresPerPixel: number;
  mix: number;
  selected: number | null;
  hovered: number | null;
  /** Height of the floor below one, or null where it is on a storey that is not shown. */
  floorOf(mover: Mover): number | null;
}

/** Half the length of one as he is drawn [m]. */
export function halfLength({ state }: Mover, metresPerPixel: number): number {
  return Math.max((state.length_m ?? 2 * USUAL_RADIUS_M) / 2, SMALLEST_PX * metresPerPixel);
}

export class People {
  readonly group = new Group();
  private readonly colours: Colours;
  private readonly trails = new Trails();
  private readonly uncertain = new Marks(UNCERTAIN_OPACITY, 1);
  private readonly marks = new Marks(1, 3);
  private bodies: InstancedMesh;
  private readonly matrix = new Matrix4();
  private readonly ellipse: Ellipse = { a_m: 0, b_m: 0, angle_rad: 0 };
  private readonly mark: Mark = {
    x_m: 0,
    y_m: 0,
    z_m: 0,
    angle_rad: 0,
    along_m: 0,
    across_m: 0,
    ring: 1,
    nose_m: 0,
  };

  constructor(colours: Colours) {
    this.colours = colours;
    this.bodies = bodiesFor(FIRST_CAPACITY);
    this.trails.mesh.renderOrder = 2;
    this.group.add(this.uncertain.mesh, this.trails.mesh, this.marks.mesh, this.bodies);
  }

  /** Draws all where they are. */
  draw({ alone, crowds }: Parted, look: Look): void {
    this.uncertain.begin(alone.length);
    this.marks.begin(alone.length + crowds.length);
    this.trails.begin(alone.length);
    this.reserve(alone.length);
    const isSolid = look.mix > 0;
    let bodies = 0;
    for (const mover of alone) {
      const floor_m = look.floorOf(mover);
      if (floor_m === null) continue;
      this.person(mover, floor_m, look);
      if (isSolid) this.body(bodies++, mover, floor_m, look.mix * BODY_HEIGHT_M);
    }
    for (const crowd of crowds) this.crowd(crowd, look.metresPerPixel);
    this.bodies.count = bodies;
    this.bodies.visible = bodies > 0;
    this.bodies.instanceMatrix.needsUpdate = isSolid;
    if (this.bodies.instanceColor) this.bodies.instanceColor.needsUpdate = isSolid;
    this.uncertain.end();
    this.marks.end();
    this.trails.end();
  }

  private person(mover: Mover, floor_m: number, { metresPerPixel, selected, hovered }: Look): void {
    const { mark } = this;
    const { state } = mover;
    const id = state.track_id;
    const smallest = SMALLEST_PX * metresPerPixel;
    const colour = trackColour(id);
    mark.x_m = mover.x_m;
    mark.y_m = mover.y_m;
    if (ellipse95(state.cov_xx_m2, state.cov_xy_m2, state.cov_yy_m2, this.ellipse)) {
      mark.z_m = floor_m + UNCERTAIN_ABOVE_M;
      mark.angle_rad = this.ellipse.angle_rad;
      mark.along_m = this.ellipse.a_m;
      mark.across_m = this.ellipse.b_m;
      mark.ring = 1;
      mark.nose_m = 0;
      this.uncertain.add(mark, colour, colour);
    }
    const isMarked = id === selected || id === hovered;
    mark.z_m = floor_m + BODY_ABOVE_M;
    mark.angle_rad = mover.heading_rad;
    mark.along_m = halfLength(mover, metresPerPixel);
    mark.across_m = Math.max((state.width_m ?? state.length_m ?? 2 * USUAL_RADIUS_M) / 2, smallest);
    mark.ring = isMarked ? HALO_MARKED : HALO;
    mark.nose_m = mover.hasHeading ? Math.max(mark.along_m, mark.across_m) : 0;
    this.marks.add(mark, colour, this.colours[isMarked ? "map-select" : "map-ring"]);
    this.trails.add(mover, floor_m, colour, metresPerPixel, id === selected);
  }

  /** The one whose mark was drawn last, as he stands in space. */
  private body(i: number, mover: Mover, floor_m: number, height_m: number): void {
    const { along_m, across_m, angle_rad } = this.mark;
    const [cos, sin] = [Math.cos(angle_rad), Math.sin(angle_rad)];
    const [x, y] = [mover.x_m, mover.y_m];
    // prettier-ignore
    this.matrix.set(
      cos * along_m, -sin * across_m, 0, x,
      sin * along_m, cos * across_m, 0, y,
      0, 0, height_m, floor_m,
      0, 0, 0, 1,
    );
    this.bodies.setMatrixAt(i, this.matrix);
    this.bodies.setColorAt(i, trackColour(mover.state.track_id));
  }

  private crowd({ x_m, y_m, floor_m, count }: Crowd, metresPerPixel: number): void {
    const { mark } = this;
    mark.x_m = x_m;
    mark.y_m = y_m;
    mark.z_m = floor_m + CROWD_ABOVE_M;
    mark.angle_rad = mark.nose_m = 0;
    mark.along_m = mark.across_m = radiusOf(count) * metresPerPixel;
    mark.ring = HALO;
    this.marks.add(mark, this.colours["map-label"], this.colours["map-ring"]);
  }

  private reserve(people: number): void {
    if (people <= this.bodies.instanceMatrix.count) return;
    this.group.remove(this.bodies);
    this.bodies.geometry.dispose();
    this.bodies.dispose();
    this.bodies = bodiesFor(2 * people);
    this.group.add(this.bodies);
  }
}

function bodiesFor(capacity: number): InstancedMesh {
  const body = new CapsuleGeometry(1, 1, 3, 8)
    .rotateX(Math.PI / 2)
    .scale(0.8, 0.8, 1 / 3)
    .translate(0, 0, 0.5);
  const bodies = new InstancedMesh(body, new MeshLambertMaterial(), capacity);
  bodies.instanceMatrix.setUsage(DynamicDrawUsage);
  // Moves with each frame, so that its bounds would be computed anew as often.
  bodies.frustumCulled = false;
  bodies.setColorAt(0, trackColour(0));
  bodies.count = 0;
  return bodies;
}
