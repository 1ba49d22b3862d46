/** Where somebody was at a moment of a day, by the stays in rooms and by when he was seen. */

import type { RoomStayDocument } from "../documents";
import type { Span } from "../state";

export interface Stay extends Span {
  room: number;
  name: string;
  /** It goes on; then `to` is as far as anything is known. */
  isOpen: boolean;
}

/** A point of a way, in metres of the map frame, and its moment. */
export type WayPoint = readonly [x_m: number, y_m: number, at: number];

export interface Day {
  /** In the order in which they began. */
  stays: readonly Stay[];
  /** Each as long as he was seen without a break. */
  parts: readonly (readonly WayPoint[])[];
}

export type Whereabouts =
  | { kind: "rooms"; stays: readonly Stay[] }
  | { kind: "outside" }
  /** He was not seen then; before that he was seen last at `since` (null: not on this day yet). */
  | { kind: "unseen"; since: number | null };

/** As the service gives them, the last first. */
export function staysOf(documents: readonly RoomStayDocument[], newest: number): Stay[] {
  return documents
    .map(({ instance_id, name, from, to }) => ({
      room: instance_id,
      name,
      from: Date.parse(from),
      to: to === null ? Math.max(newest, Date.parse(from)) : Date.parse(to),
      isOpen: to === null,
    }))
    .reverse();
}

export function spanOf(part: readonly WayPoint[]): Span {
  return { from: part[0]![2], to: part.at(-1)![2] };
}

export function whereAt({ stays, parts }: Day, at: number): Whereabouts {
  const then = stays.filter((each) => each.from <= at && (each.isOpen || at < each.to));
  if (then.length > 0) return { kind: "rooms", stays: then };
  const seen = parts.map(spanOf);
  if (seen.some(({ from, to }) => from <= at && at <= to)) return { kind: "outside" };
  const before = [...seen, ...stays].filter(({ to }) => to <= at).map(({ to }) => to);
  return { kind: "unseen", since: before.length > 0 ? Math.max(...before) : null };
}

export function lengthOf(parts: Day["parts"]): number {
  let length_m = 0;
  for (const part of parts)
    part.forEach(([x, y], i) => {
      const [nextX, nextY] = part[i + 1] ?? [x, y];
      length_m += Math.hypot(nextX - x, nextY - y);
    });
  return length_m;
}
