/** Reads a map: outlines from its GeoJSON, ids from the list of instances, kinds from the taxonomy. */

import type { Concept, InstanceSummary } from "../documents";
import { allPages, path, type Api } from "../api";
import type { Kind, MapModel, Outline, Point, Storey, Thing } from "./model";
import { boundsOf, longestAxis, visualMiddle } from "./shape";

type Position = [number, number, ...number[]];

type Geometry =
  | { type: "Point"; coordinates: Position }
  | { type: "LineString"; coordinates: Position[] }
  | { type: "Polygon"; coordinates: Position[][] }
  | { type: "MultiPolygon"; coordinates: Position[][][] };

interface Feature {
  id: string;
  geometry: Geometry;
  properties: Record<string, unknown>;
}

export interface MapGeoJson {
  features: Feature[];
  storeys?: Record<string, number>;
}

/** What the export says of an instance for itself; the rest are its attributes. */
const OWN = new Set([
  "name",
  "concept",
  "uid",
  "alias",
  "storey",
  "joins",
  "elevation_m",
  "height_m",
  "attributes",
]);

/** Doors whose pose is asked for, each by itself. */
const MOST_TURNED = 200;

export async function readMap(api: Api, name: string, signal: AbortSignal): Promise<MapModel> {
  const [document, instances, taxonomy] = await Promise.all([
    api.get<MapGeoJson>(path`/maps/${name}/export` + "?format=geojson", signal),
    allPages<InstanceSummary, "instances">(
      api,
      `/instances?map=${encodeURIComponent(name)}`,
      "instances",
      signal,
    ),
    api.get<{ concepts: Concept[] }>("/concepts", signal),
  ]);
  const model = modelOf(name, document, instances, taxonomy.concepts);
  const doors = model.things.filter(
    (each) => each.kind === "door" && each.outlines.length > 0 && each.attributes["leaf"],
  );
  const turned = await Promise.all(doors.slice(0, MOST_TURNED).map((each) => turnedDoor(api, each, signal)));
  return withThings(model, new Map(turned.map((each) => [each.id, each])));
}

/**
 * A door with the doorway along the x axis of its own frame, which says on which side its leaf is hinged. Its outline
 * alone has two such directions.
 */
async function turnedDoor(api: Api, door: Thing, signal: AbortSignal): Promise<Thing> {
  const { pose } = await api.get<{ pose: { qx: number; qy: number; qz: number; qw: number } | null }>(
    path`/instances/${door.id}`,
    signal,
  );
  if (pose === null || door.line === null) return door;
  const [[fromX, fromY], [toX, toY]] = door.line;
  const [axisX, axisY] = [1 - 2 * (pose.qy ** 2 + pose.qz ** 2), 2 * (pose.qx * pose.qy + pose.qw * pose.qz)];
  const isAlong = (toX - fromX) * axisX + (toY - fromY) * axisY >= 0;
  return isAlong ? door : { ...door, line: [door.line[1], door.line[0]] };
}

function withThings(model: MapModel, others: ReadonlyMap<number, Thing>): MapModel {
  const things = model.things.map((each) => others.get(each.id) ?? each);
  return { ...model, things, byId: new Map(things.map((each) => [each.id, each])) };
}

/** Puts a map together; an instance that one of the answers lacks, because it was just made, is left out. */
export function modelOf(
  name: string,
  document: MapGeoJson,
  instances: readonly InstanceSummary[],
  concepts: readonly Concept[],
): MapModel {
  const byUid = new Map(instances.map((each) => [each.uid, each]));
  const kinds = new Kinds(concepts);
  const things: Thing[] = [];
  for (const feature of document.features) {
    const instance = byUid.get(feature.id);
    if (instance)
      things.push({
        ...thingOf(feature, instance, kinds.of(instance.concept)),
        ...kinds.signOf(instance.concept),
      });
  }
  const storeys: Storey[] = Object.entries(document.storeys ?? {}).map(([name, elevation_m]) => ({
    name,
    elevation_m,
  }));
  storeys.sort((a, b) => a.elevation_m - b.elevation_m);
  return {
    name,
    things,
    byId: new Map(things.map((each) => [each.id, each])),
    storeys,
    bounds: boundsOf(things),
  };
}

/** What the concepts are drawn as. */
class Kinds {
  private readonly parents: ReadonlyMap<string, readonly string[]>;

  constructor(concepts: readonly Concept[]) {
    this.parents = new Map(concepts.map((each) => [each.name, each.parents]));
  }

  signOf(concept: string): Pick<Thing, "sign"> {
    const above = this.above(concept);
    if (above.has("Window")) return { sign: "window" };
    return above.has("Opening") && !above.has("Door") ? { sign: "passage" } : {};
  }

  of(concept: string): Kind {
    const above = this.above(concept);
    if (above.has("Room")) return "room";
    if (above.has("Window")) return "thing";
    return above.has("Door") || above.has("Opening") ? "door" : "thing";
  }

  private above(concept: string): Set<string> {
    const above = new Set([concept]);
    for (const each of above) for (const parent of this.parents.get(each) ?? []) above.add(parent);
    return above;
  }
}

function thingOf(feature: Feature, instance: InstanceSummary, kind: Kind): Thing {
  const { properties, geometry } = feature;
  const outlines = outlinesOf(geometry);
  const line = geometry.type === "LineString" ? lineOf(geometry.coordinates) : null;
  const zMin_m = numberOf(properties["elevation_m"]) ?? 0;
  const height_m = numberOf(properties["height_m"]);
  const attributes = Object.fromEntries(Object.entries(properties).filter(([key]) => !OWN.has(key)));
  return {
    id: instance.id,
    uid: instance.uid,
    name: instance.name,
    alias: instance.alias,
    concept: instance.concept,
    kind,
    storey: instance.storey,
    outlines,
    line: line ?? (kind === "door" && outlines.length > 0 ? longestAxis(outlines) : null),
    place: placeOf(geometry, outlines),
    zMin_m,
    zMax_m: height_m === null ? null : zMin_m + height_m,
    joins: Array.isArray(properties["joins"]) ? (properties["joins"] as string[]) : [],
    attributes: { ...attributes, ...(properties["attributes"] as Record<string, unknown> | undefined) },
  };
}

function numberOf(value: unknown): number | null {
  return typeof value === "number" ? value : null;
}

function outlinesOf(geometry: Geometry): Outline[] {
  const open = (ring: Position[]): Point[] => ring.slice(0, -1).map(([x, y]) => [x, y]);
  if (geometry.type === "Polygon") return geometry.coordinates.length ? [geometry.coordinates.map(open)] : [];
  if (geometry.type === "MultiPolygon") return geometry.coordinates.map((polygon) => polygon.map(open));
  return [];
}

function lineOf(positions: Position[]): [Point, Point] | null {
  const first = positions[0];
  const last = positions[positions.length - 1];
  return first && last
    ? [
        [first[0], first[1]],
        [last[0], last[1]],
      ]
    : null;
}

function placeOf(geometry: Geometry, outlines: readonly Outline[]): Point {
  const ring = outlines[0]?.[0];
  if (ring) return visualMiddle(ring);
  if (geometry.type === "Point") return [geometry.coordinates[0], geometry.coordinates[1]];
  const line = geometry.type === "LineString" ? lineOf(geometry.coordinates) : null;
  return line ? [(line[0][0] + line[1][0]) / 2, (line[0][1] + line[1][1]) / 2] : [0, 0];
}
