/** The storeys of a building pulled apart, so that none covers another in space. Pure. */

import type { MapModel, Storey, Thing } from "./model";

/** How far the next floor is above one, as a part of the shorter side of the map. */
const PART_OF_SIDE = 0.8;

/** The map with each storey so far above the one below that both can be seen; what has no storey goes with its height. */
export function pulledApart(map: MapModel): MapModel {
  const { bounds } = map;
  const side_m = bounds ? Math.min(bounds.xMax_m - bounds.xMin_m, bounds.yMax_m - bounds.yMin_m) : 0;
  const storeys: Storey[] = [];
  const lifts_m: number[] = [];
  map.storeys.forEach(({ name, elevation_m }, i) => {
    const below = storeys[i - 1];
    const raised_m = below
      ? below.elevation_m + Math.max(PART_OF_SIDE * side_m, elevation_m - map.storeys[i - 1]!.elevation_m)
      : elevation_m;
    storeys.push({ name, elevation_m: raised_m });
    lifts_m.push(raised_m - elevation_m);
  });
  const liftOf = (thing: Thing): number => {
    const named = map.storeys.findIndex((each) => each.name === thing.storey);
    const i = named < 0 ? map.storeys.findLastIndex((each) => each.elevation_m <= thing.zMin_m) : named;
    return lifts_m[Math.max(0, i)] ?? 0;
  };
  const things = map.things.map((each) => raised(each, liftOf(each)));
  return { ...map, things, storeys, byId: new Map(things.map((each) => [each.id, each])) };
}

function raised(thing: Thing, lift_m: number): Thing {
  const { zMin_m, zMax_m } = thing;
  return { ...thing, zMin_m: zMin_m + lift_m, zMax_m: zMax_m === null ? null : zMax_m + lift_m };
}
