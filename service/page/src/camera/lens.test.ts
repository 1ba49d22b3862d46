import { expect, it } from "vitest";

import type { Point } from "../map/model";
import { lensOver, type Lens, type Pair } from "./lens";

const SIZE: Point = [1280, 720];
const FOCAL_PX = 900;
const EYE = [7, -3, 2.6] as const;
const AREA: readonly Point[] = [
  [9.5, -4],
  [9.7, -1.7],
  [13, -1],
  [12.5, -5.1],
];

/** Where a camera at EYE sees the floor, that looks along x and down by an angle. */
function seen([x, y]: Point, down: number): Point {
  const [dx, dy, dz] = [x - EYE[0], y - EYE[1], -EYE[2]];
  const depth = dx * Math.cos(down) - dz * Math.sin(down);
  const below = -dx * Math.sin(down) - dz * Math.cos(down);
  return [640 - (FOCAL_PX * dy) / depth, 360 + (FOCAL_PX * below) / depth];
}

const pairsOf = (places: readonly Point[], down = 0.5): Pair[] =>
  places.map((place) => ({ place, pixel: seen(place, down) }));

function lens(pairs: readonly Pair[], focal_px: number | null = null): Lens {
  const found = lensOver(pairs, SIZE, focal_px);
  if (typeof found === "string") throw new Error(found);
  return found;
}

it.each([0.2, 0.5, 0.9, 1.2])("finds the camera that saw the points, down by %f", (down) => {
  for (const places of [AREA, [...AREA, [11, -2] as const, [10.2, -3.3] as const]]) {
    const found = lens(pairsOf(places, down));
    expect(found.focal_px).toBeCloseTo(FOCAL_PX, 3);
    expect(found.place[0]).toBeCloseTo(EYE[0], 5);
    expect(found.place[1]).toBeCloseTo(EYE[1], 5);
    expect(found.height_m).toBeCloseTo(EYE[2], 5);
    expect(Math.max(...found.off_px)).toBeLessThan(1e-4);
    const [u, v] = found.see([12, -2])!;
    const [wantedU, wantedV] = seen([12, -2], down);
    expect(Math.hypot(u - wantedU, v - wantedV)).toBeLessThan(1e-3);
    expect(found.see([0, -3])).toBeNull();
  }
});

it("tells which point is off", () => {
  const pairs = pairsOf([...AREA, [11, -2], [10.2, -3.3], [11.5, -4.2]]);
  const [u, v] = pairs[5]!.pixel;
  const { off_px } = lens(pairs.map((pair, i) => (i === 5 ? { ...pair, pixel: [u + 8, v - 6] } : pair)));
  expect(off_px.indexOf(Math.max(...off_px))).toBe(5);
});

it("refuses points on a line, in the picture or on the plan, and two that are one", () => {
  const line: Point[] = [
    [10, -3],
    [11, -3],
    [12, -3],
    [11, -1.5],
  ];
  expect(lensOver(pairsOf(line), SIZE, null)).toBe("line");
  expect(lensOver(pairsOf([...line, [13, -3]]), SIZE, null)).toBe("line");
  expect(lensOver(pairsOf([AREA[0]!, ...AREA.slice(0, 3)]), SIZE, null)).toBe("line");
  const pairs = pairsOf(AREA);
  expect(
    lensOver(
      pairs.map((pair, i) => ({ ...pair, pixel: [100 + 90 * i, 400] })),
      SIZE,
      null,
    ),
  ).toBe("line");
});

it("takes two points that are close to each other where others span an area", () => {
  const found = lens(pairsOf([...AREA, [9.55, -3.98]]));
  expect(found.height_m).toBeCloseTo(EYE[2], 4);
});

it("refuses a mirror image, and points in another order", () => {
  const pairs = pairsOf(AREA);
  const mirrored = pairs.map(({ pixel, place: [x, y] }): Pair => ({ pixel, place: [x, -y] }));
  expect(lensOver(mirrored, SIZE, null)).toBe("mirror");
  const turned = pairs.map(({ pixel: [u, v], place }): Pair => ({ pixel: [1280 - u, v], place }));
  expect(lensOver(turned, SIZE, null)).toBe("mirror");
  for (const order of [
    [0, 2, 1, 3],
    [1, 0, 2, 3],
  ])
    expect(
      lensOver(
        pairs.map(({ place }, i) => ({ place, pixel: pairs[order[i]!]!.pixel })),
        SIZE,
        null,
      ),
    ).toBe("crossed");
});

it("asks for the angle of view where the points do not tell the focal length", () => {
  const pairs = pairsOf(
    [
      [6, -4],
      [8, -4],
      [8, -2],
      [6, -2],
    ],
    Math.PI / 2,
  );
  expect(lensOver(pairs, SIZE, null)).toBe("focal");
  const found = lens(pairs, FOCAL_PX);
  expect(found.height_m).toBeCloseTo(EYE[2], 4);
});

it("is far off where no camera sees the points so", () => {
  const pairs = pairsOf([...AREA, [11, -2], [10.2, -3.3]]);
  const torn = pairs.map((pair, i): Pair => (i === 4 ? { ...pair, pixel: [60, 640] } : pair));
  const found = lensOver(torn, SIZE, FOCAL_PX);
  expect(found === "crossed" || Math.max(...(found as Lens).off_px) > 20).toBe(true);
});
