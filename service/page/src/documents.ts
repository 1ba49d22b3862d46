/** What the service answers, as far as the page reads it. Stamps are RFC 3339 in UTC. */

export interface MapDocument {
  uid: string;
  name: string;
  cell_m: number;
  instances: number;
  tracks: number;
  created_at: string;
}

export interface InstanceSummary {
  id: number;
  uid: string;
  map: string;
  name: string;
  alias: string | null;
  concept: string;
  storey: string | null;
}

export interface ConceptDocument {
  name: string;
  parents: string[];
}

export interface EventDocument {
  seq: number;
  event_id: string;
  map: string;
  type: string;
  stamp: string;
  cause: "moved" | "appeared" | "disappeared" | "map" | null;
  rule: string;
  rule_version: number;
  track: { id: number; name: string } | null;
  instance: { id: number; name: string } | null;
  since: string;
  key: Record<string, unknown>;
  measures: Record<string, unknown>;
  confidence: number | null;
  by_batch: boolean;
  verdict: "confirmed" | "retracted" | "amended" | null;
  amended_by: string | null;
  evidence: { uid: string; variable: string; source: string; stamp: string }[];
}

/** Where a track is; lengths in the map frame. */
export interface TrackState {
  track_id: number;
  name: string;
  stamp: string;
  x_m: number;
  y_m: number;
  z_m: number | null;
  heading_rad: number | null;
  speed_mps: number | null;
  length_m: number | null;
  width_m: number | null;
  cov_xx_m2: number | null;
  cov_xy_m2: number | null;
  cov_yy_m2: number | null;
  rooms: number[];
  ended: boolean;
  /** [x, y, t] with t in seconds since 1970; in a moment of the past only. */
  trail?: [number, number, number][];
}

export type DoorPosition = "open" | "closed" | "opening" | "closing" | "unknown";

export interface DoorState {
  instance_id: number;
  name: string;
  state: DoorPosition;
  since: string | null;
}

/** All that moves, at one moment. */
export interface Snapshot {
  stamp: string | null;
  tracks: TrackState[];
  doors: DoorState[];
  /** How many are in each room, by the instance's id. */
  rooms: Record<string, number>;
  event_cursor?: number;
  change_set?: number;
}

export interface Delta {
  stamp: string | null;
  tracks: TrackState[];
  gone: number[];
  doors: DoorState[];
  rooms: Record<string, number>;
  change_set?: number;
}

/** What happened in an interval; `to` null: it goes on. */
export interface TimelineDocument {
  from: string;
  to: string;
  rooms: {
    instance_id: number;
    name: string;
    stays: { track_id: number; name: string; from: string; to: string | null }[];
  }[];
  doors: {
    instance_id: number;
    name: string;
    states: { state: DoorPosition; from: string; to: string | null }[];
  }[];
  events: EventDocument[];
  more: boolean;
}
