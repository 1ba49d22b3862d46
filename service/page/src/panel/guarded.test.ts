import { expect, test } from "vitest";

import { lackOf } from "./guarded";

test("what a token lacks", () => {
  expect(lackOf(null, true)).toBe(null);
  expect(lackOf({ name: "a", scopes: ["read"], maps: null }, false)).toContain("scope write");
  expect(lackOf({ name: "a", scopes: ["read", "write"], maps: ["x"] }, false)).toBe(null);
  expect(lackOf({ name: "a", scopes: ["read", "write"], maps: null }, false, "admin")).toContain(
    "scope admin",
  );
  expect(lackOf({ name: "a", scopes: ["read", "write"], maps: ["x"] }, true)).toContain("all maps");
});
