import { expect, test } from "vitest";

import { rowsOf } from "./sample";

test("rows of CSV are by the names of its head", () => {
  expect(rowsOf("track,x_m\nann,1.5\r\nbob,2\n")).toEqual([
    { track: "ann", x_m: "1.5" },
    { track: "bob", x_m: "2" },
  ]);
});
