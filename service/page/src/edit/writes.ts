/** Edits of the map through the API, each signed and with what it does as its message. */

import type { ChangeSummary, InstanceChanges, InstanceDocument, NewInstance, Pose } from "../documents";
import { inHeader, path, type Answer, type Api } from "../api";
import type { Point } from "../map/model";
import { author } from "./author";
import type { Doorway } from "./doorway";
import { metres } from "./outline";

export type Carried = "refuse" | "delete" | "keep";

function signed(message: string): { message: string; headers: Record<string, string> } {
  return { message, headers: { "Semap-Author": inHeader(author()) } };
}

export function readInstance(api: Api, id: number, signal?: AbortSignal): Promise<Answer<InstanceDocument>> {
  return api.send<InstanceDocument>("GET", path`/instances/${id}`, signal ? { signal } : {});
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
