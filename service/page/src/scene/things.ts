/** All that is neither room nor door: outlines in the plan, meshes in space. */

import {
  AmbientLight,
  BufferAttribute,
  BufferGeometry,
  Color,
  DirectionalLight,
  DoubleSide,
  Group,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  type Object3D,
} from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

import type { Thing } from "../map/model";
import type { Colours } from "./colours";
import { addFloor, addRing, lines } from "./floors";

const ABOVE_M = 0.01;
const MARK_M = 0.12;
const LINE_PX = 1.4;

/** Outlines of things, filled; one without an outline is a small cross. */
export function thingsInPlan(things: readonly Thing[], colours: Colours): Group {
  const positions: number[] = [];
  const indices: number[] = [];
  const segments: number[] = [];
  const tints: number[] = [];
  for (const thing of things) {
    const { r, g, b } = colours[thing.sign === "window" ? "map-window" : "map-thing"];
    const z = thing.zMin_m + ABOVE_M;
    for (const outline of thing.outlines) {
      addFloor(outline, z, positions, indices);
      while (tints.length < positions.length) tints.push(r, g, b);
      for (const ring of outline) addRing(ring, z + 0.002, segments);
    }
    if (thing.outlines.length === 0) {
      const [x, y] = thing.place;
      segments.push(x - MARK_M, y, z, x + MARK_M, y, z, x, y - MARK_M, z, x, y + MARK_M, z);
    }
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(positions), 3));
  geometry.setAttribute("color", new BufferAttribute(new Float32Array(tints), 3));
  geometry.setIndex(indices);
  const group = new Group();
  group.add(new Mesh(geometry, new MeshBasicMaterial({ vertexColors: true, side: DoubleSide })));
  group.add(lines(segments, LINE_PX, colours["map-thing-line"].getHex()));
  return group;
}

/** The triangles of a glTF file as the map exports it, of those things that are wanted, as one mesh. */
export async function meshesOf(
  glb: ArrayBuffer,
  wanted: ReadonlyMap<string, { thing: Thing; lift_m: number }>,
  colours: Colours,
): Promise<Mesh | null> {
  const { scene } = await new GLTFLoader().parseAsync(glb, "");
  // The file is y up, as glTF demands; its root turns the map into that.
  const [root] = scene.children;
  if (!root) return null;
  root.rotation.set(0, 0, 0);
  scene.updateMatrixWorld(true);
  const parts: Part[] = [];
  for (const node of root.children) {
    const found = wanted.get(uidOf(node));
    if (!found) continue;
    const tint = tintOf(found.thing, colours);
    node.traverse((each) => each instanceof Mesh && parts.push({ mesh: each, tint, lift_m: found.lift_m }));
  }
  return parts.length > 0 ? merged(parts) : null;
}

/** Light for meshes and bodies. */
export function lights(): Object3D[] {
  const sun = new DirectionalLight(0xffffff, 2.2);
  sun.position.set(-0.5, -1, 1.6);
  return [new AmbientLight(0xffffff, 1.3), sun];
}

function uidOf(node: Object3D): string {
  return String((node.userData as { uid?: unknown }).uid ?? "");
}

/** Things of one concept look alike, and not all things do. */
function tintOf(thing: Thing, colours: Colours): Color {
  let hash = 0;
  for (const letter of thing.concept) hash = (hash * 31 + letter.charCodeAt(0)) % 997;
  return colours["map-thing"]
    .clone()
    .offsetHSL(((hash % 7) - 3) * 0.018, 0, 0)
    .multiplyScalar(1 + ((hash % 5) - 2) * 0.1);
}

interface Part {
  mesh: Mesh;
  tint: Color;
  lift_m: number;
}

function merged(parts: readonly Part[]): Mesh {
  let vertices = 0;
  let corners = 0;
  for (const { mesh } of parts) {
    vertices += mesh.geometry.getAttribute("position").count;
    corners += mesh.geometry.getIndex()?.count ?? mesh.geometry.getAttribute("position").count;
  }
  const positions = new Float32Array(3 * vertices);
  const tints = new Float32Array(3 * vertices);
  const index = new Uint32Array(corners);
  let vertex = 0;
  let corner = 0;
  for (const { mesh, tint, lift_m } of parts) {
    const source = mesh.geometry.getAttribute("position").clone().applyMatrix4(mesh.matrixWorld);
    const own = mesh.geometry.getIndex();
    for (let i = 0; i < (own?.count ?? source.count); i++) index[corner++] = vertex + (own ? own.getX(i) : i);
    for (let i = 0; i < source.count; i++, vertex++) {
      positions.set([source.getX(i), source.getY(i), source.getZ(i) + lift_m], 3 * vertex);
      tints.set([tint.r, tint.g, tint.b], 3 * vertex);
    }
    mesh.geometry.dispose();
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  geometry.setAttribute("color", new BufferAttribute(tints, 3));
  geometry.setIndex(new BufferAttribute(index, 1));
  // Without normals three.js shades each face by itself, as furniture and walls want it.
  return new Mesh(
    geometry,
    new MeshLambertMaterial({ vertexColors: true, flatShading: true, side: DoubleSide }),
  );
}
