/** Many flat shapes at once: a quad for each, whose pixels a shader fills, so that a shape costs four vertices. */

import {
  BufferAttribute,
  DynamicDrawUsage,
  InstancedBufferGeometry,
  InstancedInterleavedBuffer,
  InterleavedBufferAttribute,
  Mesh,
  ShaderMaterial,
  type Color,
} from "three";

/** Place (x, y, z), angle; half axes along and across; ring around it as a factor, length of its nose; two colours. */
const FLOATS = 14;
const FIRST_CAPACITY = 64;

const VERTEX = `
attribute vec4 place;
attribute vec4 size;
attribute vec3 tint;
attribute vec3 ringTint;
varying vec2 at;
varying vec4 sized;
varying vec3 inside;
varying vec3 around;
void main() {
  float side = 1.05 * max(size.x, size.y) * size.z;
  float ahead = max(side, 1.95 * size.w);
  at = vec2(mix(-side, ahead, 0.5 + 0.5 * position.x), side * position.y);
  sized = size;
  inside = tint;
  around = ringTint;
  float c = cos(place.w);
  float s = sin(place.w);
  vec2 turned = vec2(c * at.x - s * at.y, s * at.x + c * at.y);
  gl_Position = projectionMatrix * viewMatrix * vec4(place.xy + turned, place.z, 1.0);
}`;

/** A disc with a ring around it and a nose ahead; without ring and nose an ellipse. Edges are a pixel wide. */
const FRAGMENT = `
uniform float opacity;
varying vec2 at;
varying vec4 sized;
varying vec3 inside;
varying vec3 around;
void main() {
  float pixel = max(length(dFdx(at)), length(dFdy(at)));
  float least = min(sized.x, sized.y);
  float from = (length(at / sized.xy) - 1.0) * least;
  float disc = clamp(0.5 - from / pixel, 0.0, 1.0);
  float ring = clamp(0.5 - (from - (sized.z - 1.0) * least) / pixel, 0.0, 1.0);
  float nose = 0.0;
  if (sized.w > 0.0) {
    vec2 q = at / vec2(sized.w, 0.75 * sized.y);
    float aside = (0.83 * (1.85 - q.x) / 1.3 - abs(q.y)) * 0.75 * sized.y;
    nose = q.x > 0.0 ? clamp(0.5 + aside / pixel, 0.0, 1.0) : 0.0;
  }
  float own = max(disc, nose);
  float alpha = max(own, ring);
  if (alpha <= 0.0) discard;
  gl_FragColor = vec4(mix(around, inside, own), alpha * opacity);
  #include <colorspace_fragment>
}`;

export interface Mark {
  x_m: number;
  y_m: number;
  z_m: number;
  angle_rad: number;
  along_m: number;
  across_m: number;
  /** How many times as large the ring around it is; 1: none. */
  ring: number;
  /** How far ahead its nose is; 0: none. */
  nose_m: number;
}

export class Marks {
  readonly mesh: Mesh<InstancedBufferGeometry, ShaderMaterial>;
  private floats = new Float32Array(0);
  private buffer = new InstancedInterleavedBuffer(this.floats, FLOATS);
  private capacity = 0;
  private count = 0;

  constructor(opacity: number, order: number) {
    const material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: { opacity: { value: opacity } },
      transparent: true,
      depthWrite: false,
    });
    this.mesh = new Mesh(new InstancedBufferGeometry(), material);
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = order;
    this.reserve(FIRST_CAPACITY);
  }

  /** Begins a picture with at most so many. */
  begin(most: number): void {
    if (most > this.capacity) this.reserve(2 * most);
    this.count = 0;
  }

  add(mark: Readonly<Mark>, tint: Color, ringTint: Color): void {
    const to = this.floats;
    let at = FLOATS * this.count++;
    to[at++] = mark.x_m;
    to[at++] = mark.y_m;
    to[at++] = mark.z_m;
    to[at++] = mark.angle_rad;
    to[at++] = mark.along_m;
    to[at++] = mark.across_m;
    to[at++] = mark.ring;
    to[at++] = mark.nose_m;
    to[at++] = tint.r;
    to[at++] = tint.g;
    to[at++] = tint.b;
    to[at++] = ringTint.r;
    to[at++] = ringTint.g;
    to[at] = ringTint.b;
  }

  end(): void {
    this.mesh.geometry.instanceCount = this.count;
    this.mesh.visible = this.count > 0;
    this.buffer.clearUpdateRanges();
    this.buffer.addUpdateRange(0, FLOATS * this.count);
    this.buffer.needsUpdate = true;
  }

  private reserve(capacity: number): void {
    this.capacity = capacity;
    this.floats = new Float32Array(FLOATS * capacity);
    this.buffer = new InstancedInterleavedBuffer(this.floats, FLOATS);
    this.buffer.setUsage(DynamicDrawUsage);
    const geometry = new InstancedBufferGeometry();
    const corners = new Float32Array([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0]);
    geometry.setAttribute("position", new BufferAttribute(corners, 3));
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    const parts: readonly [string, number, number][] = [
      ["place", 4, 0],
      ["size", 4, 4],
      ["tint", 3, 8],
      ["ringTint", 3, 11],
    ];
    for (const [name, length, from] of parts)
      geometry.setAttribute(name, new InterleavedBufferAttribute(this.buffer, length, from));
    this.mesh.geometry.dispose();
    this.mesh.geometry = geometry;
  }
}
