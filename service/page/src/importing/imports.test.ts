import { expect, it } from "vitest";

import type { ImportJob } from "../documents";
import { hasEnded, refusalOf, type Import } from "./imports";

it("takes what semap reads, by its name", () => {
  expect(["office.geojson", "A.IFC", "b.c.gml", "map.zip", "map.yaml"].map(refusalOf)).toEqual(
    Array(5).fill(null),
  );
  expect(refusalOf("picture.png")).toContain("picture.png");
  expect(refusalOf(".zip")).not.toBeNull();
});

it("has ended when its job has, or it never became one", () => {
  const sent: Import = { key: 1, file: "a.zip", job: null, problem: null, isCancelled: false };
  const job = { job_id: 1, progress: 0, result: null, problem: null } as ImportJob;
  expect(hasEnded(sent)).toBe(false);
  expect(hasEnded({ ...sent, isCancelled: true })).toBe(true);
  expect(hasEnded({ ...sent, job: { ...job, state: "running" } })).toBe(false);
  expect(hasEnded({ ...sent, job: { ...job, state: "done" } })).toBe(true);
});
