/** What somebody wants to be told when it happens again: a type of events, of somebody and somewhere or not. Pure. */

import type { EventDocument } from "../documents";

export interface Alert {
  map: string;
  type: string;
  /** The name of whom it is about; null: whoever it is. */
  who: string | null;
  /** The name of what it happens at; null: wherever it is. */
  where: string | null;
}

export function concerns(
  alert: Alert,
  map: string,
  event: Pick<EventDocument, "type" | "track" | "instance">,
): boolean {
  return (
    alert.map === map &&
    alert.type === event.type &&
    (alert.who === null || alert.who === event.track?.name) &&
    (alert.where === null || alert.where === event.instance?.name)
  );
}

export function isSame(a: Alert, b: Alert): boolean {
  return a.map === b.map && a.type === b.type && a.who === b.who && a.where === b.where;
}

/** The same as a webhook takes it; `filter` is CQL2 text. */
export function webhookOf({ map, type, who, where }: Alert, url: string): Record<string, unknown> {
  const conditions = [
    who === null ? "" : `track = ${quoted(who)}`,
    where === null ? "" : `instance = ${quoted(where)}`,
  ].filter((each) => each !== "");
  return { url, maps: [map], type, filter: conditions.length > 0 ? conditions.join(" AND ") : null };
}

function quoted(text: string): string {
  return `'${text.replaceAll("'", "''")}'`;
}
