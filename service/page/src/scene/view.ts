/**
 * From where the map is looked at. One view serves the plan and the space: `mix` goes from 0 (from above, without
 * perspective) to 1. On the way the camera comes nearer while its angle widens, so that what is in the middle keeps its
 * size and the picture changes smoothly.
 */

import { Matrix4, OrthographicCamera, PerspectiveCamera, Plane, Ray, Vector3, type Camera } from "three";

import type { Place } from "../app";
import type { Bounds } from "../map/model";

const NARROW_RAD = 0.02;
const WIDE_RAD = 0.7;
const STEEPEST_TILT_RAD = 1.45;
const FIRST_TILT_RAD = 0.85;
const FIRST_AZIMUTH_RAD = 0.35;
const SMALLEST_M = 0.5;
const LARGEST_M = 20_000;
const MARGIN = 1.1;
/** What is higher is nearer, and so larger. */
const MARGIN_OF_STOREYS = 1.45;
/** What lies over the lower edge of the picture. */
const LEGEND_PX = 52;

/** From where the map is looked at: the middle and the height of what is seen [m], and two angles [rad]. */
export type Eye = readonly [
  x_m: number,
  y_m: number,
  height_m: number,
  azimuth_rad: number,
  tilt_rad: number,
];

export class View {
  /** What is in the middle, on the floor. */
  x_m = 0;
  y_m = 0;
  floor_m = 0;
  /** How far above that floor the highest one is, where more than one is to be seen. */
  rise_m = 0;
  /** How much of the map is seen from the lower to the upper edge, in the middle. */
  height_m = 10;
  azimuth_rad = FIRST_AZIMUTH_RAD;
  tilt_rad = FIRST_TILT_RAD;
  mix = 0;
  /** As far as anything is from the middle. */
  reach_m = 100;
  width_px = 1;
  height_px = 1;

  private readonly flat = new OrthographicCamera();
  private readonly deep = new PerspectiveCamera();
  private readonly up = new Vector3();
  private readonly middle = new Vector3();
  private readonly scratch = new Vector3();
  private readonly ray = new Ray();
  private readonly plane = new Plane(new Vector3(0, 0, 1));
  private readonly toScreen = new Matrix4();

  /** The camera for this view. */
  camera(): Camera {
    const tilt = this.tilt_rad * this.mix;
    const azimuth = this.azimuth_rad * this.mix;
    const angle = NARROW_RAD + (WIDE_RAD - NARROW_RAD) * this.mix ** 2;
    // In perspective what is near is larger, so that more room is needed around.
    const distance = ((1 + 0.12 * this.mix) * this.height_m) / 2 / Math.tan(angle / 2);
    const camera = this.mix === 0 ? this.flat : this.deep;
    const aspect = this.width_px / this.height_px;
    this.middle.set(this.x_m, this.y_m, this.floor_m + (this.mix * this.rise_m) / 2);
    camera.position.set(
      this.x_m - distance * Math.sin(tilt) * Math.sin(azimuth),
      this.y_m - distance * Math.sin(tilt) * Math.cos(azimuth),
      this.middle.z + distance * Math.cos(tilt),
    );
    this.up.set(Math.sin(azimuth) * Math.cos(tilt), Math.cos(azimuth) * Math.cos(tilt), Math.sin(tilt));
    camera.up.copy(this.up);
    camera.lookAt(this.middle);
    camera.near = Math.max(distance * 0.02, distance - this.reach_m);
    camera.far = distance + this.reach_m;
    if (camera === this.flat) {
      this.flat.top = this.height_m / 2;
      this.flat.bottom = -this.height_m / 2;
      this.flat.right = (this.height_m / 2) * aspect;
      this.flat.left = -this.flat.right;
      this.flat.updateProjectionMatrix();
    } else {
      this.deep.fov = (angle * 180) / Math.PI;
      this.deep.aspect = aspect;
      this.deep.updateProjectionMatrix();
    }
    camera.updateMatrixWorld();
    this.toScreen.multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse);
    return camera;
  }

  metresPerPixel(): number {
    return this.height_m / this.height_px;
  }

  /** The line of sight through a pixel; valid until the next call. */
  sight(x_px: number, y_px: number): Ray {
    const camera = this.camera();
    const x = (2 * x_px) / this.width_px - 1;
    const y = 1 - (2 * y_px) / this.height_px;
    this.ray.origin.set(x, y, -1).unproject(camera);
    this.ray.direction.set(x, y, 1).unproject(camera).sub(this.ray.origin).normalize();
    return this.ray;
  }

  /** What is on a floor at a pixel; above the horizon, the farthest. */
  placeAt(x_px: number, y_px: number, floor_m = this.floor_m): Place {
    const ray = this.sight(x_px, y_px);
    this.plane.constant = -floor_m;
    const hit = ray.intersectPlane(this.plane, this.scratch);
    if (hit === null) ray.at(this.reach_m, this.scratch);
    return { x_m: this.scratch.x, y_m: this.scratch.y };
  }

  /** Where a point is on the screen, in pixels, into `into`; whether it is before the camera. Call `camera` first. */
  project(x_m: number, y_m: number, z_m: number, into: { x: number; y: number }): boolean {
    this.scratch.set(x_m, y_m, z_m).applyMatrix4(this.toScreen);
    into.x = ((this.scratch.x + 1) / 2) * this.width_px;
    into.y = ((1 - this.scratch.y) / 2) * this.height_px;
    return this.scratch.z < 1;
  }

  /** Makes what is at a pixel larger (factor above 1) or smaller, and keeps it there. */
  zoom(factor: number, x_px = this.width_px / 2, y_px = this.height_px / 2): void {
    const before = this.placeAt(x_px, y_px);
    this.height_m = clamp(this.height_m / factor, SMALLEST_M, LARGEST_M);
    const after = this.placeAt(x_px, y_px);
    this.moveBy(before.x_m - after.x_m, before.y_m - after.y_m);
  }

  /** Moves the picture with a pixel that is dragged. */
  drag(fromX_px: number, fromY_px: number, toX_px: number, toY_px: number): void {
    const from = this.placeAt(fromX_px, fromY_px);
    const to = this.placeAt(toX_px, toY_px);
    this.moveBy(from.x_m - to.x_m, from.y_m - to.y_m);
  }

  /** Turns around the middle; in the plan nothing turns. */
  orbit(dx_px: number, dy_px: number): void {
    this.azimuth_rad += (dx_px / this.height_px) * Math.PI;
    this.tilt_rad = clamp(this.tilt_rad - (dy_px / this.height_px) * Math.PI, 0.05, STEEPEST_TILT_RAD);
  }

  get isTurned(): boolean {
    return this.azimuth_rad !== FIRST_AZIMUTH_RAD || this.tilt_rad !== FIRST_TILT_RAD;
  }

  get eye(): Eye {
    return [this.x_m, this.y_m, this.height_m, this.azimuth_rad, this.tilt_rad];
  }

  set eye([x_m, y_m, height_m, azimuth_rad, tilt_rad]: Eye) {
    this.x_m = x_m;
    this.y_m = y_m;
    this.height_m = clamp(height_m, SMALLEST_M, LARGEST_M);
    this.azimuth_rad = azimuth_rad;
    this.tilt_rad = clamp(tilt_rad, 0.05, STEEPEST_TILT_RAD);
  }

  /** Shows all of an area. */
  show(bounds: Bounds): void {
    this.x_m = (bounds.xMin_m + bounds.xMax_m) / 2;
    this.y_m = (bounds.yMin_m + bounds.yMax_m) / 2;
    const width = Math.max(bounds.xMax_m - bounds.xMin_m, 1);
    const height = Math.max(bounds.yMax_m - bounds.yMin_m, 1);
    const free_px = Math.max(this.height_px - LEGEND_PX, this.height_px / 2);
    const stacked = height * Math.cos(this.tilt_rad) + this.rise_m * Math.sin(this.tilt_rad);
    const margin = this.rise_m > 0 ? MARGIN_OF_STOREYS : MARGIN;
    const perPixel = margin * Math.max(height / free_px, stacked / free_px, width / this.width_px);
    this.height_m = clamp(perPixel * this.height_px, SMALLEST_M, LARGEST_M);
    this.y_m -= ((this.height_px - free_px) / 2) * perPixel;
    this.reach_m = Math.max(100, 2 * Math.hypot(width, height, this.rise_m));
  }

  private moveBy(x_m: number, y_m: number): void {
    const far = 3 * this.height_m + this.reach_m;
    this.x_m += clamp(x_m, -far, far);
    this.y_m += clamp(y_m, -far, far);
  }
}

function clamp(value: number, least: number, most: number): number {
  return Math.min(most, Math.max(least, value));
}
