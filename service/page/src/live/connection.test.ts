import { expect, test } from "vitest";

import type { Connection } from "../state";
import { follow, waitBefore, type Happening } from "./connection";

const LOST: Happening = { kind: "lost", now: 1000, retryAt: 1400 };

function after(...happenings: Happening[]): Connection {
  return happenings.reduce<Connection>((connection, each) => follow(connection, each), { state: "loading" });
}

test("the first snapshot is live, not resumed", () => {
  expect(after({ kind: "asked" })).toEqual({ state: "loading" });
  expect(after({ kind: "asked" }, { kind: "snapshot" })).toEqual({ state: "live", resumed: false });
});

test("disconnected since the first loss, however often it is tried", () => {
  const again: Happening = { kind: "lost", now: 5000, retryAt: 5800 };
  expect(after({ kind: "snapshot" }, LOST, again)).toEqual({
    state: "disconnected",
    since: 1000,
    retryAt: 5800,
  });
  expect(after({ kind: "snapshot" }, LOST, { kind: "asked" })).toEqual({
    state: "disconnected",
    since: 1000,
    retryAt: 1400,
  });
});

test("resumed after a loss, until that was noticed", () => {
  expect(after({ kind: "snapshot" }, LOST, { kind: "snapshot" })).toEqual({ state: "live", resumed: true });
  expect(after({ kind: "snapshot" }, LOST, { kind: "snapshot" }, { kind: "noticed" })).toEqual({
    state: "live",
    resumed: false,
  });
  expect(after({ kind: "snapshot" }, LOST, { kind: "noticed" }).state).toBe("disconnected");
});

test("waits get longer, spread by a quarter, and never reach two seconds", () => {
  expect(waitBefore(0, 0.5)).toBe(400);
  expect(waitBefore(1, 0.5)).toBe(800);
  expect(waitBefore(100, 0.5)).toBe(1500);
  expect(waitBefore(100, 0)).toBe(1125);
  expect(waitBefore(100, 1)).toBeLessThan(2000);
  expect(waitBefore(0, 0)).toBe(300);
});
