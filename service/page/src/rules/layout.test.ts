import { describe, expect, it } from "vitest";

import type { RulePart } from "../documents";
import { layOut } from "./layout";

const part = (kind: RulePart["kind"], more: Partial<RulePart> = {}): RulePart => ({
  kind,
  label: "",
  text: "",
  joint: "",
  parts: [],
  ...more,
});
const step = (text: string, joint = ""): RulePart => part("step", { label: "A", text, joint });
const WIDE = 300;

describe("a drawing", () => {
  const drawn = layOut(
    part("sequence", {
      text: "all in less than 6 s",
      parts: [
        step("door becomes open"),
        part("choice", {
          joint: "later",
          parts: [
            step("a ".repeat(200)),
            part("repeat", { text: "once or more", parts: [step("x".repeat(90))] }),
          ],
        }),
        part("event", { label: "entered" }),
      ],
    }),
    WIDE,
  );
  const groups = drawn.boxes.filter((box) => box.kind === "group");
  const leaves = drawn.boxes.filter((box) => box.kind !== "group");

  it("stays within its width, and its words within their boxes", () => {
    for (const { x, y, width, height, lines } of drawn.boxes) {
      expect(x).toBeGreaterThanOrEqual(0);
      expect(x + width).toBeLessThanOrEqual(WIDE);
      expect(y + height).toBeLessThanOrEqual(drawn.height);
      for (const line of lines) expect(line.length * 6).toBeLessThan(width);
    }
  });

  it("has no box upon another, but in its group", () => {
    leaves.slice(1).forEach((box, i) => expect(box.y).toBeGreaterThan(leaves[i]!.y + leaves[i]!.height));
    const [choice, repeat] = groups;
    expect(repeat!.y + repeat!.height).toBeLessThan(choice!.y + choice!.height);
    expect(groups.map(({ lines }) => lines.join(" "))).toEqual(["either", "once or more"]);
  });

  it("says between two boxes how one follows the other", () =>
    expect(drawn.arrows.map(({ lines, isDirect }) => [lines.join(" "), isDirect])).toEqual([
      ["later", false],
      ["or", false],
      ["all in less than 6 s", true],
    ]));
});
