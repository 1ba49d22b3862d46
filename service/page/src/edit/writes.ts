/** Edits of the map through the API, each signed and with what it does as its message. */

import { inHeader, path, type Answer, type Api } from "../api";
import type { Point } from "../map/model";
import { author } from "./author";
import type { Doorway } from "./doorway";
import type { ChangeSummary } from "./history";
import { metres, type AreaDocument, type PolygonDocument } from "./outline";

export interface Pose {
  x_m: number;
  y_m: number;
  z_m: number;
  qx: number;
  qy: number;
  qz: number;
  qw: number;
}

/** GET /instances/{id}, as far as it is edited. */
export interface InstanceDocument {
  id: number;
  name: string;
  alias: string | null;
  concept: string;
  storey: string | null;
  pose: Pose | null;
  footprint: AreaDocument | null;
  band: { z_min_m: number; z_max_m: number } | null;
  joins: { id: number; name: string }[];
  attributes: Record<string, unknown>;
  has_body: boolean;
}

/** PATCH /instances/{id}: what is left out stays. */
export interface InstanceChanges {
  name?: string;
  alias?: string | null;
  concept?: string;
  storey?: string | null;
  joins?: string[];
  attributes?: Record<string, unknown>;
  pose?: Pose;
  footprint?: PolygonDocument;
  elevation_m?: number;
  height_m?: number | null;
}

export interface NewInstance {
  name: string;
  concept: string;
  alias?: string;
  storey?: string;
  joins?: string[];
  attributes?: Record<string, unknown>;
  pose?: Pose;
  footprint?: PolygonDocument;
  elevation_m?: number;
  height_m?: number;
}

export type Carried = "refuse" | "delete" | "keep";

function signed(message: string): { message: string; headers: Record<string, string> } {
  return { message, headers: { "Semap-Author": inHeader(author()) } };
}

export function readInstance(api: Api, id: number): Promise<Answer<InstanceDocument>> {
  return api.send<InstanceDocument>("GET", path`/instances/${id}`);
}

export async function createInstance(api: Api, map: string, made: NewInstance): Promise<InstanceDocument> {
  const body = new FormData();
  body.set("document", JSON.stringify(made));
  const message = `make the ${made.concept} ${made.name}`;
  return (
    await api.send<InstanceDocument>("POST", path`/maps/${map}/instances`, { body, ...signed(message) })
  ).body;
}

/** Refused with 412 where the instance is not what was read with the ETag. */
export function changeInstance(
  api: Api,
  id: number,
  changes: InstanceChanges,
  etag: string | null,
  message: string,
): Promise<Answer<InstanceDocument>> {
  return api.send("PATCH", path`/instances/${id}`, { body: changes, ifMatch: etag, ...signed(message) });
}

export async function deleteInstance(
  api: Api,
  { id, name }: InstanceDocument,
  etag: string | null,
  carried: Carried,
) {
  const options = { ifMatch: etag, ...signed(`delete ${name}`) };
  await api.send("DELETE", path`/instances/${id}` + `?carried=${carried}`, options);
}

export async function listChanges(
  api: Api,
  map: string,
  limit: number,
  signal?: AbortSignal,
): Promise<ChangeSummary[]> {
  const found = await api.get<{ changes: ChangeSummary[] }>(
    path`/maps/${map}/changes` + `?limit=${limit}`,
    signal,
  );
  return found.changes;
}

export async function undoChange(api: Api, change: ChangeSummary, message: string): Promise<void> {
  await api.send("POST", path`/changes/${change.id}/undo`, signed(message));
}

/** Where a door stands: its middle on the floor, x along the doorway. */
export function poseOf({ middle, yaw_rad }: Doorway, z_m: number): Pose {
  return {
    x_m: metres(middle[0]),
    y_m: metres(middle[1]),
    z_m,
    qx: 0,
    qy: 0,
    qz: Math.sin(yaw_rad / 2),
    qw: Math.cos(yaw_rad / 2),
  };
}

export function movedBy(pose: Pose, [dx_m, dy_m]: Point): Pose {
  return { ...pose, x_m: pose.x_m + dx_m, y_m: pose.y_m + dy_m };
}
