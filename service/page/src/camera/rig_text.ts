/** The camera's part of a rig, as the service reads it. */

import type { Point } from "../map/model";
import type { Pair } from "./lens";

export interface Told {
  name: string;
  topic: string;
  size: Point;
  pairs: readonly Pair[];
  /** null: as the points tell. */
  focal_px: number | null;
  floor_z_m: number;
}

/** Quoted as JSON, which YAML takes for text whatever is in it. */
export function rigText({ name, topic, size, pairs, focal_px, floor_z_m }: Told): string {
  const listed = (points: readonly Point[], digits: number): string =>
    `[${points.map((point) => `[${point.map((each) => Number(each.toFixed(digits))).join(", ")}]`).join(", ")}]`;
  return `${[
    `floor_z_m: ${Number(floor_z_m.toFixed(3))}`,
    "sensors:",
    `  ${JSON.stringify(name)}:`,
    "    kind: camera",
    `    topic: ${JSON.stringify(topic)}`,
    "    homography:",
    `      width_px: ${size[0]}`,
    `      height_px: ${size[1]}`,
    `      pixels: ${listed(
      pairs.map(({ pixel }) => pixel),
      1,
    )}`,
    `      floor_m: ${listed(
      pairs.map(({ place }) => place),
      3,
    )}`,
    ...(focal_px === null ? [] : [`      focal_px: ${Number(focal_px.toFixed(1))}`]),
  ].join("\n")}\n`;
}
