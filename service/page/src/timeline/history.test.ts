import { expect, test } from "vitest";

import type { EventDocument, TimelineDocument, TrackState } from "../documents";
import { firstAt, History, lanesOf } from "./history";

const T0 = Date.parse("2026-01-05T09:00:00Z");
const at = (seconds: number): string => new Date(T0 + 1000 * seconds).toISOString();

function track(rooms: number[], seconds: number, ended = false): TrackState {
  return {
    track_id: 1,
    name: "ann",
    stamp: at(seconds),
    x_m: 0,
    y_m: 0,
    z_m: null,
    heading_rad: null,
    speed_mps: null,
    length_m: null,
    width_m: null,
    cov_xx_m2: null,
    cov_xy_m2: null,
    cov_yy_m2: null,
    rooms,
    ended,
  };
}

function event(id: string, seconds: number): EventDocument {
  return { event_id: id, seq: seconds, stamp: at(seconds) } as EventDocument;
}

const READ: TimelineDocument = {
  from: at(0),
  to: at(60),
  rooms: [{ instance_id: 3, name: "Room", stays: [{ track_id: 1, name: "ann", from: at(5), to: null }] }],
  doors: [{ instance_id: 7, name: "D", states: [{ state: "open", from: at(1), to: null }] }],
  events: [event("a", 10), event("b", 20)],
  more: false,
};
const DELTA = { stamp: at(70), tracks: [], gone: [], doors: [], rooms: {} };

test("what is told live continues what was read: a stay goes on, ends, and another begins", () => {
  const history = new History();
  history.take(READ);
  history.continueWith({ ...DELTA, tracks: [track([3], 65)] });
  expect(history.stays.get(3)).toEqual([{ trackId: 1, name: "ann", from: T0 + 5000, to: null }]);
  history.continueWith({ ...DELTA, tracks: [track([4], 70)] });
  expect(history.stays.get(3)![0]!.to).toBe(T0 + 70_000);
  expect(history.stays.get(4)).toEqual([{ trackId: 1, name: "ann", from: T0 + 70_000, to: null }]);
  history.continueWith({ ...DELTA, tracks: [track([4], 80, true)] });
  expect(history.stays.get(4)![0]!.to).toBe(T0 + 80_000);
  expect(history.loaded!.to).toBe(T0 + 80_000);
});

test("older states change nothing, as when a recording is played once more", () => {
  const history = new History();
  history.take(READ);
  history.continueWith({ ...DELTA, tracks: [track([], 2)] });
  expect(history.stays.get(3)![0]!.to).toBeNull();
});

test("a door changes its state once, and not back in time", () => {
  const history = new History();
  history.take(READ);
  const closed = { instance_id: 7, name: "D", state: "closed" as const, since: at(62) };
  history.continueWith({ ...DELTA, doors: [closed] });
  history.continueWith({ ...DELTA, doors: [closed] });
  history.continueWith({ ...DELTA, doors: [{ ...closed, state: "opening", since: at(3) }] });
  expect(history.positions.get(7)).toEqual([
    { state: "open", from: T0 + 1000, to: T0 + 62_000 },
    { state: "closed", from: T0 + 62_000, to: null },
  ]);
});

test("events are kept once each, in the order of their stamps, however they arrive", () => {
  const history = new History();
  history.take(READ);
  history.addEvents([event("d", 40), event("b", 20), event("c", 30)]);
  expect(history.events.map(({ event: each }) => each.event_id)).toEqual(["a", "b", "c", "d"]);
  expect(firstAt(history.events, T0 + 20_000)).toBe(1);
  expect(firstAt(history.events, T0 + 20_001)).toBe(2);
  expect(firstAt(history.events, T0 + 99_000)).toBe(4);
});

test("a page that stays open forgets what is long over, and knows that it did", () => {
  const history = new History();
  history.take(READ);
  history.addEvents(Array.from({ length: 25_000 }, (_, i) => event(`e${i}`, i)));
  history.continueWith({ ...DELTA, tracks: [track([4], 100)] });
  history.forget(T0 + 20_000_000);
  expect(history.loaded!.from).toBe(T0 + 20_000_000);
  expect(history.events.length).toBe(5000);
  expect(history.stays.get(3)).toEqual([]);
  expect(history.stays.get(4)!.length).toBe(1);
  history.addEvents([event("e0", 0)]);
  expect(history.events[0]!.event.event_id).toBe("e0");
});

test("a map without events forgets stays that are long over", () => {
  const history = new History();
  history.take({ ...READ, events: [] });
  for (let i = 0; i < 25_000; i++)
    history.continueWith({ ...DELTA, tracks: [track([i % 2 ? 4 : 5], 100 + i)] });
  history.forget(T0 + 20_000_000);
  expect(history.stays.get(4)!.length + history.stays.get(5)!.length).toBeLessThan(5200);
});

test("no two intervals of a lane overlap, and there are as many lanes as overlap at once", () => {
  const intervals = [
    { from: 0, to: 10 },
    { from: 5, to: 15 },
    { from: 10, to: 12 },
    { from: 2, to: null },
    { from: 20, to: 30 },
  ];
  const { lanes, count } = lanesOf(intervals);
  expect(count).toBe(3);
  for (let i = 0; i < intervals.length; i++) {
    for (let j = 0; j < i; j++) {
      const [a, b] = [intervals[i]!, intervals[j]!];
      const overlap = a.from < (b.to ?? Infinity) && b.from < (a.to ?? Infinity);
      if (overlap) expect(lanes[i]).not.toBe(lanes[j]);
    }
  }
});
