/** Occupancy grids below the map. */

import {
  CanvasTexture,
  DoubleSide,
  Group,
  LinearFilter,
  LinearMipmapLinearFilter,
  Mesh,
  MeshBasicMaterial,
  NoColorSpace,
  PlaneGeometry,
  type Color,
} from "three";

import type { GridDocument } from "../documents";
import { path, type Api } from "../api";
import { readPgm, reduced, shadeOf, type Graymap } from "../map/grid";

const BELOW_M = 0.03;
const OPACITY = 0.8;
/** Of a texture; a larger grid is drawn smaller. */
const LARGEST_PX = 4096;

/** All grids of a map, ready to be drawn. Raises ApiError. */
export async function backdropOf(
  api: Api,
  mapName: string,
  colour: Color,
  signal: AbortSignal,
): Promise<Group> {
  const { grids } = await api.get<{ grids: GridDocument[] }>(path`/maps/${mapName}/grids`, signal);
  const group = new Group();
  for (const grid of grids) {
    const bytes = await api.bytes(path`/maps/${mapName}/grids/${grid.name}` + "?format=pgm", signal);
    group.add(plane(grid, readPgm(new Uint8Array(bytes)), colour));
  }
  return group;
}

function plane(grid: GridDocument, image: Graymap, colour: Color): Mesh {
  const texture = new CanvasTexture(
    canvasOf(reduced({ ...image, pixels: shadeOf(grid, image) }, LARGEST_PX)),
  );
  texture.colorSpace = NoColorSpace;
  texture.minFilter = LinearMipmapLinearFilter;
  texture.magFilter = LinearFilter;
  const [width, height] = [image.width * grid.resolution_m, image.height * grid.resolution_m];
  const material = new MeshBasicMaterial({
    color: colour,
    alphaMap: texture,
    transparent: true,
    opacity: OPACITY,
    depthWrite: false,
    side: DoubleSide,
  });
  const mesh = new Mesh(new PlaneGeometry(width, height).translate(width / 2, height / 2, 0), material);
  mesh.position.set(grid.origin_x_m, grid.origin_y_m, -BELOW_M);
  mesh.rotation.z = grid.origin_yaw_rad;
  mesh.renderOrder = -1;
  return mesh;
}

/** Green is what three.js reads of an alpha map. */
function canvasOf({ width, height, pixels }: Graymap): HTMLCanvasElement {
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  const data = new ImageData(width, height);
  const opaque = new Uint32Array(data.data.buffer);
  pixels.forEach((shade, i) => (opaque[i] = 0xff000000 | (shade << 16) | (shade << 8) | shade));
  canvas.getContext("2d")!.putImageData(data, 0, 0);
  return canvas;
}
