import { expect, test } from "vitest";

import { pulledApart } from "./apart";
import { modelOf } from "./read";

const box = (name: string, storey: string | null, elevation_m: number) => ({
  id: name,
  geometry: {
    type: "Polygon" as const,
    coordinates: [
      [
        [0, 0],
        [20, 0],
        [20, 10],
        [0, 10],
        [0, 0],
      ] as [number, number][],
    ],
  },
  properties: { name, concept: "Room", storey, elevation_m, height_m: 2.5 },
});

const HOUSE = modelOf(
  "house",
  {
    features: [
      box("cellar", "under", -3),
      box("hall", "ground", 0),
      box("loft", "top", 30),
      box("stairs", null, 1),
    ],
    storeys: { under: -3, ground: 0, top: 30 },
  },
  ["cellar", "hall", "loft", "stairs"].map((name, id) => ({
    id,
    uid: name,
    map: "house",
    name,
    alias: null,
    concept: "Room",
    storey: { cellar: "under", hall: "ground", loft: "top" }[name] ?? null,
  })),
  [{ name: "Room", parents: [] }] as never,
);

test("each storey is well above the one below, and what stands on it goes with it", () => {
  const apart = pulledApart(HOUSE);
  expect(apart.storeys.map((each) => each.elevation_m)).toEqual([-3, 5, 35]);
  expect(apart.things.map((each) => [each.name, each.zMin_m, each.zMax_m])).toEqual([
    ["cellar", -3, -0.5],
    ["hall", 5, 7.5],
    ["loft", 35, 37.5],
    ["stairs", 6, 8.5],
  ]);
  expect(apart.byId.get(1)).toBe(apart.things[1]);
});
