import { expect, it } from "vitest";

import { choicesOf } from "./concepts";

it("shows each concept once, below its first parent", () =>
  expect(
    choicesOf([
      { name: "Thing", parents: [] },
      { name: "Space", parents: ["Thing"] },
      { name: "Room", parents: ["Space"] },
      { name: "Kitchen", parents: ["Room", "Space"] },
      { name: "Door", parents: ["Thing"] },
    ]),
  ).toEqual([
    { name: "Thing", depth: 0 },
    { name: "Door", depth: 1 },
    { name: "Space", depth: 1 },
    { name: "Kitchen", depth: 2 },
    { name: "Room", depth: 2 },
  ]));
