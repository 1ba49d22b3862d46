/** The floor of a picture as it lies on the plan. */

import type { Bounds } from "../map/model";
import type { Lens } from "./lens";
import type { Picture } from "./placing";

const CELLS = 120_000;

/** Draws what the camera sees of the floor within the bounds; the rest of the canvas stays clear. */
export function paintFloor(
  canvas: HTMLCanvasElement,
  lens: Lens,
  { size, small }: Picture,
  bounds: Bounds,
): void {
  const [width_m, height_m] = [bounds.xMax_m - bounds.xMin_m, bounds.yMax_m - bounds.yMin_m];
  const cell_m = Math.sqrt((width_m * height_m) / CELLS);
  canvas.width = Math.max(1, Math.round(width_m / cell_m));
  canvas.height = Math.max(1, Math.round(height_m / cell_m));
  const context = canvas.getContext("2d")!;
  const painted = context.createImageData(canvas.width, canvas.height);
  const from = new Uint32Array(small.data.buffer);
  const to = new Uint32Array(painted.data.buffer);
  const share = small.width / size[0];
  for (let row = 0; row < canvas.height; row++) {
    const y_m = bounds.yMax_m - ((row + 0.5) / canvas.height) * height_m;
    for (let column = 0; column < canvas.width; column++) {
      const seen = lens.see([bounds.xMin_m + ((column + 0.5) / canvas.width) * width_m, y_m]);
      if (seen === null) continue;
      const [u, v] = [Math.floor(seen[0] * share), Math.floor(seen[1] * share)];
      if (u >= 0 && v >= 0 && u < small.width && v < small.height)
        to[row * canvas.width + column] = from[v * small.width + u]!;
    }
  }
  context.putImageData(painted, 0, 0);
}
