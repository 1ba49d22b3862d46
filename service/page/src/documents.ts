/** What the service says, by its own description of itself (`npm run documents`). Stamps are RFC 3339 in UTC. */

import type * as documents from "../generated/documents";

export type * from "../generated/documents";

/** Where a track is; the trail ([x, y, t]) in a moment of the past only. */
export type TrackState = documents.ShownTrackDocument & { trail?: [number, number, number][] };

/** All that moves, now or at a moment of the past. */
export type Snapshot = Pick<documents.Snapshot, "stamp" | "doors" | "rooms"> &
  Partial<Pick<documents.Snapshot, "event_cursor" | "change_set">> & { tracks: TrackState[] };

export type Delta = Omit<documents.Delta, "type">;

export type DoorState = documents.ShownDoorDocument;

export type Concept = Pick<documents.ConceptDocument, "name" | "parents">;

export type Pose = Required<documents.PoseDocument>;

export type InstanceDocument = Omit<documents.InstanceDocument, "pose"> & { pose: Pose | null };

/** Of a map import, the only jobs that the page begins. */
export type ImportJob = Omit<documents.JobDocument, "result"> & { result: documents.ImportDocument | null };

export type AreaDocument = documents.PolygonDocument | documents.MultiPolygonDocument;
