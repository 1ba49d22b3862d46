/** A map as the page draws it: everything in metres of the map frame. */

export type Point = readonly [number, number];
/** An outer ring and its holes, each without its first point repeated. */
export type Outline = readonly (readonly Point[])[];

export type Kind = "room" | "door" | "thing";

/** An instance. */
export interface Thing {
  readonly id: number;
  readonly uid: string;
  readonly name: string;
  readonly alias: string | null;
  readonly concept: string;
  /** What it is drawn as: by its concept, or by one above that. */
  readonly kind: Kind;
  /** Drawn otherwise than its kind: a window is glass, a passage has no leaf and so no state. */
  readonly sign?: "window" | "passage";
  readonly storey: string | null;
  readonly outlines: readonly Outline[];
  /** The doorway of a door, from the side where a left leaf has its hinge. */
  readonly line: readonly [Point, Point] | null;
  /** Its middle. */
  readonly place: Point;
  readonly zMin_m: number;
  /** null: it has no heights. */
  readonly zMax_m: number | null;
  readonly joins: readonly string[];
  readonly attributes: Readonly<Record<string, unknown>>;
}

export interface Storey {
  readonly name: string;
  readonly elevation_m: number;
}

export interface Bounds {
  readonly xMin_m: number;
  readonly yMin_m: number;
  readonly xMax_m: number;
  readonly yMax_m: number;
}

export interface MapModel {
  readonly name: string;
  readonly things: readonly Thing[];
  readonly byId: ReadonlyMap<number, Thing>;
  /** From the lowest up. */
  readonly storeys: readonly Storey[];
  /** null where nothing stands anywhere. */
  readonly bounds: Bounds | null;
}
