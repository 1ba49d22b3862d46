import { expect, it } from "vitest";

import type { MapModel, Point } from "../map/model";
import { Placing } from "./placing";

const MODEL: MapModel = {
  name: "house",
  things: [],
  byId: new Map(),
  storeys: [
    { name: "ground", elevation_m: 0 },
    { name: "first", elevation_m: 3.2 },
  ],
  bounds: null,
};
/** Of a camera 2 m above the storey at (1.5, -2), that looks along y. */
const PIXELS: Point[] = [
  [250, 500],
  [550, 500],
  [475, 400],
  [325, 400],
];
const PLACES: Point[] = [
  [0, 2],
  [3, 2],
  [3, 6],
  [0, 6],
];

function placing(): Placing {
  const made = new Placing(MODEL);
  made.show({ name: "a.png", url: "", size: [800, 600], small: null as never });
  made.angle_deg.value = 90;
  return made;
}

it("pairs points by their numbers, whichever side is said first", () => {
  const made = placing();
  made.put("place", PLACES[0]!);
  made.put("place", PLACES[1]!);
  for (const pixel of PIXELS.slice(0, 3)) made.put("pixel", pixel);
  for (const place of PLACES.slice(2)) made.put("place", place);
  expect(made.count.value).toBe(3);
  made.put("pixel", PIXELS[3]!);
  expect(made.marks.value).toEqual(PIXELS.map((pixel, i) => ({ pixel, place: PLACES[i] })));
});

it("tells the rig of the storey and of the images in which persons are found", () => {
  const made = placing();
  PIXELS.forEach((pixel) => made.put("pixel", pixel));
  PLACES.forEach((place) => made.put("place", place));
  made.storey.value = "first";
  made.name.value = "hall";
  made.width_px.value = 400;
  expect(made.rig()).toBe(`floor_z_m: 3.2
sensors:
  "hall":
    kind: camera
    topic: "hall"
    homography:
      width_px: 400
      height_px: 300
      pixels: [[125, 250], [275, 250], [237.5, 200], [162.5, 200]]
      floor_m: [[0, 2], [3, 2], [3, 6], [0, 6]]
      focal_px: 200
`);
  made.name.value = " ";
  expect(made.rig()).toBeNull();
});

it("counts how far a point is off in the images in which persons are found, as the reader does", () => {
  const made = placing();
  PIXELS.forEach(([u, v], i) => made.put("pixel", [u, i === 2 ? v + 20 : v]));
  PLACES.forEach((place) => made.put("place", place));
  expect(made.rig()).not.toBeNull();
  made.width_px.value = 8000;
  expect(made.rig()).toBeNull();
});

it("tells no rig where a point is far off", () => {
  const made = placing();
  PIXELS.forEach((pixel, i) => made.put("pixel", i === 2 ? [600, 500] : pixel));
  PLACES.forEach((place) => made.put("place", place));
  expect(made.rig()).toBeNull();
});
