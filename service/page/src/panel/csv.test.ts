import { expect, test } from "vitest";

import { csvOf } from "./csv";

test("cells are quoted where they must be, and none is a formula", () => {
  expect(
    csvOf(
      ["a", "b"],
      [
        ['x "y", z', -1],
        ["=1+1", null],
      ],
    ),
  ).toBe('a,b\r\n"x ""y"", z",-1\r\n\'=1+1,\r\n');
});
