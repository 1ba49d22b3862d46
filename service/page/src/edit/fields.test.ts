import { describe, expect, it } from "vitest";

import type { InstanceDocument } from "../documents";
import { changesOf, faultsIn, fieldsOf, overtaken } from "./fields";

const DOOR = {
  id: 7,
  name: "lab_door",
  alias: null,
  concept: "Door",
  storey: "ground",
  pose: null,
  footprint: null,
  band: { z_min_m: 3, z_max_m: 5.1 },
  joins: [
    { id: 1, name: "hall" },
    { id: 2, name: "lab" },
  ],
  attributes: { width_m: 1, leaf: { hinge: "left", max_deg: 95 } },
  has_body: false,
} as unknown as InstanceDocument;

describe("changesOf", () => {
  it("sends nothing where nothing differs", () => {
    expect(changesOf(DOOR, {})).toEqual({});
    expect(changesOf(DOOR, { name: " lab_door ", joins: "hall, lab" })).toEqual({});
  });

  it("sends what differs, and only that", () =>
    expect(changesOf(DOOR, { name: "door", alias: "Lab", storey: "", joins: "lab" })).toEqual({
      name: "door",
      alias: "Lab",
      storey: null,
      joins: ["lab"],
    }));

  it("keeps the other attributes of a door whose leaf changes", () => {
    expect(changesOf(DOOR, { leaf: "right" }).attributes).toEqual({
      width_m: 1,
      leaf: { hinge: "right", max_deg: 95 },
    });
    expect(changesOf(DOOR, { leaf: "" }).attributes).toEqual({ width_m: 1 });
    expect(changesOf({ ...DOOR, attributes: {} }, { leaf: "left" }).attributes).toEqual({ leaf: "left" });
  });

  it("sends both heights or none", () => {
    expect(fieldsOf(DOOR).height_m).toBe("2.1");
    expect(changesOf(DOOR, { height_m: "2.5" })).toEqual({ elevation_m: 3, height_m: 2.5 });
    expect(changesOf(DOOR, { height_m: "" })).toEqual({ height_m: null });
  });
});

describe("faultsIn", () => {
  it("names what cannot be", () => {
    expect(faultsIn({ name: " ", height_m: "-1", elevation_m: "up" })).toEqual({
      name: "A name is needed.",
      height_m: "Write metres above zero.",
      elevation_m: "Write metres.",
    });
    expect(faultsIn({ name: "a", height_m: "", elevation_m: "-3" })).toEqual({});
  });
});

describe("overtaken", () => {
  it("is about what is being edited, and by others", () => {
    const other = { ...DOOR, name: "theirs" };
    expect(overtaken({ alias: "a" }, DOOR, other)).toBe(false);
    expect(overtaken({ name: "mine" }, DOOR, other)).toBe(true);
    expect(overtaken({ name: "theirs" }, DOOR, other)).toBe(false);
    expect(overtaken({ name: "mine" }, DOOR, DOOR)).toBe(false);
  });
});
