/** Reads how many hours people spent in each room over the day or the week of the moment shown, while that is asked for. */

import { effect } from "@preact/signals";

import type { Api } from "../api";
import { path } from "../api";
import type { App } from "../app";
import type { OccupancyDocument } from "../documents";
import type { Heat, Span } from "../state";
import { zone } from "../timeline/clock";
import { dayOf } from "../timeline/day";
import { problemOf } from "../unanswered";

/** Requests under way at a time. */
const AT_ONCE = 6;
const DAY_MS = 86_400_000;

export function startHeat({ api, state, announce }: App): void {
  let reading = new AbortController();
  let of = "";
  effect(() => {
    const { heat, map, at, newest } = state;
    const moment = at.value ?? newest.value;
    const rooms = map.value?.things.filter((each) => each.kind === "room").map((each) => each.id);
    const span = heat.value === "now" || moment === null ? null : spanOf(heat.value, moment);
    const wanted = span === null || !rooms ? "" : `${zone.value} ${span.from} ${span.to} ${rooms.join(" ")}`;
    if (wanted === of) return;
    of = wanted;
    reading.abort();
    state.hours.value = null;
    if (span === null || !rooms) return;
    reading = new AbortController();
    const { signal } = reading;
    readHours(api, rooms, span, signal).then(
      (hours) => {
        if (!signal.aborted) state.hours.value = hours;
      },
      (error: unknown) => {
        if (signal.aborted) return;
        of = "";
        state.heat.value = "now";
        announce(problemOf(error).detail, "error");
      },
    );
  });
}

/** The day of a moment, or the seven days that end with it. */
export function spanOf(heat: Exclude<Heat, "now">, moment: number): Span {
  const day = dayOf(moment);
  return heat === "day" ? day : { from: dayOf(day.from - 6 * DAY_MS + DAY_MS / 2).from, to: day.to };
}

async function readHours(
  api: Api,
  rooms: readonly number[],
  span: Span,
  signal: AbortSignal,
): Promise<ReadonlyMap<number, number>> {
  const asked = new URLSearchParams({
    from: new Date(span.from).toISOString(),
    to: new Date(span.to).toISOString(),
    each: "day",
    limit: "1",
  }).toString();
  const hours = new Map<number, number>();
  const left = [...rooms];
  const take = async (): Promise<void> => {
    for (let id = left.pop(); id !== undefined; id = left.pop()) {
      const use = await api.get<OccupancyDocument>(path`/rooms/${id}/occupancy` + `?${asked}`, signal);
      hours.set(id, use.total_s / 3600);
    }
  };
  await Promise.all(Array.from({ length: AT_ONCE }, take));
  return hours;
}
