/** Which events are wanted, and lists of events put together. Pure. */

import type { EventDocument } from "../documents";

/** Empty: whichever. `day` as in fields for dates; `track` and `instance` by name. */
export interface EventFilter {
  text: string;
  type: string;
  track: string;
  instance: string;
  day: string;
}

export const EVERYTHING: EventFilter = { text: "", type: "", track: "", instance: "", day: "" };

export function isEverything(filter: EventFilter): boolean {
  return Object.values(filter).every((each) => each === "");
}

type Ordered = Pick<EventDocument, "event_id" | "stamp" | "seq">;

/** The newest first, each once. Stamps are in UTC with all digits, so that their order is that of their texts. */
export function merged<T extends Ordered>(...lists: readonly (readonly T[])[]): readonly T[] {
  const byId = new Map(lists.flat().map((each) => [each.event_id, each]));
  return [...byId.values()].sort((a, b) =>
    a.stamp === b.stamp ? b.seq - a.seq : a.stamp < b.stamp ? 1 : -1,
  );
}
