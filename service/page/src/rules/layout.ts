/** Lays the boxes of a rule's drawing out, one below the other; lengths in pixels. */

import type { RulePart } from "../documents";
import { t } from "../language/catalogue";

export interface Box {
  kind: "step" | "never" | "event" | "group";
  x: number;
  y: number;
  width: number;
  height: number;
  /** In the circle of a step; of an event its name. */
  label: string;
  lines: readonly string[];
}

/** From the box before, or from above a group's first one. */
export interface Arrow {
  x: number;
  from: number;
  to: number;
  lines: readonly string[];
  /** Nothing may lie between. */
  isDirect: boolean;
}

export interface Drawing {
  width: number;
  height: number;
  boxes: readonly Box[];
  arrows: readonly Arrow[];
}

export const LINE = 16;
export const PAD = 8;
export const CIRCLE = 11;
const GAP = 26;
const LETTER = 6.4;

/** How groups are called, and what stands between their parts. */
const BETWEEN: Partial<Record<RulePart["kind"], readonly [title: string, between: string]>> = {
  choice: [t("either"), t("or")],
  all: [t("all of these"), t("and")],
};

export function layOut(whole: RulePart, width: number): Drawing {
  const boxes: Box[] = [];
  const arrows: Arrow[] = [];
  /** Returns the lower edge. */
  const put = (part: RulePart, x: number, y: number, wide: number): number => {
    if (part.parts.length === 0) {
      const box = leaf(part, x, y, wide);
      boxes.push(box);
      return y + box.height;
    }
    const isPlain = part.kind === "sequence" && part.text === "";
    if (isPlain) return chain(part, x, y, wide);
    const title = [BETWEEN[part.kind]?.[0], part.text].filter(Boolean).join(" ");
    const lines = wrapped(title, wide - 2 * PAD);
    const group: Box = { kind: "group", x, y, width: wide, height: 0, label: "", lines };
    boxes.push(group);
    const end = chain(part, x + PAD, y + PAD + lines.length * LINE + 2, wide - 2 * PAD);
    group.height = end + PAD - y;
    return y + group.height;
  };
  const chain = (part: RulePart, x: number, y: number, wide: number): number => {
    let at = y;
    part.parts.forEach((each, i) => {
      if (i > 0) {
        const between = BETWEEN[part.kind]?.[1];
        // What holds of the whole stands before what comes of it: a frame around all would only cost room.
        const isEnd =
          part.kind === "sequence" && each.kind === "event" && part.parts[i - 1]!.kind !== "event";
        const said = between ?? (isEnd ? note : each.joint);
        const lines = wrapped(said, wide - 2 * PAD - 2 * CIRCLE);
        const gap = Math.max(GAP, lines.length * LINE + 10);
        const isDirect = each.joint === "directly" || each.kind === "event";
        arrows.push({
          x: x + PAD + CIRCLE,
          from: at,
          to: between === undefined ? at + gap : at,
          lines,
          isDirect,
        });
        at += gap;
      }
      at = put(each, x, at, wide);
    });
    return at;
  };
  const note = whole.kind === "sequence" ? whole.text : "";
  const top = { ...whole, text: note === "" ? whole.text : "" };
  const height = put(top, 1, 1, width - 2);
  return { width, height: height + 1, boxes, arrows };
}

function leaf(part: RulePart, x: number, y: number, width: number): Box {
  const kind = part.kind === "never" || part.kind === "event" ? part.kind : "step";
  const text = kind === "never" ? t("never: {0}", part.text) : kind === "event" ? "" : part.text;
  const said = kind === "event" ? [part.label, part.text].filter(Boolean).join(", ") : text;
  const lines = wrapped(said, width - 3 * PAD - 2 * CIRCLE);
  return {
    kind,
    x,
    y,
    width,
    height: Math.max(lines.length * LINE, 2 * CIRCLE) + 2 * PAD - 4,
    label: part.label,
    lines,
  };
}

/** Words on lines; a word that is longer than a line is cut. */
function wrapped(text: string, width: number): string[] {
  const most = Math.max(Math.floor(width / LETTER), 4);
  const lines: string[] = [];
  for (const word of text.split(" ").flatMap((each) => each.match(new RegExp(`.{1,${most}}`, "gu")) ?? [])) {
    const last = lines.length - 1;
    if (last >= 0 && lines[last]!.length + 1 + word.length <= most) lines[last] += ` ${word}`;
    else lines.push(word);
  }
  return lines;
}
