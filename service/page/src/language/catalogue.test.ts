import { expect, test } from "vitest";

import { TEXTS as ARABIC } from "./ar";
import { chosenOf, fixed, LANGUAGES, say, t, type Texts } from "./catalogue";
import { TEXTS as GERMAN } from "./de";
import { usedIn } from "./used";

const CATALOGUES: Readonly<Record<Exclude<keyof typeof LANGUAGES, "en">, Texts>> = { de: GERMAN, ar: ARABIC };

/** What people read in no language: names of keys, of the format, of concepts and of files, and code. */
const KEYS = /^(Escape|Enter|Delete|Backspace|Home|End)$/;
const OTHER: Readonly<Record<string, RegExp>> = {
  "alerts/tell_me.tsx": /^https:\/\/$/,
  "api.ts": /^(Authorization|Bearer )$/,
  "camera/rig_text.ts": /^ {4}kind: camera$/,
  "chrome/dialogs.tsx": /^(\/docs|\/openapi\.json|semap token add NAME --scope read|semap_…)$/,
  "chrome/head.tsx": /^(semap|3D)$/,
  "chrome/keys.ts": /^button, a/,
  "chrome/notifying.ts": /^Notification$/,
  "chrome/theme.ts": /^\(prefers-/,
  "edit/keys.ts": /^(button, a|input:not)/,
  // Concepts of the map, and what stands in its history, which is one for all who read it.
  "edit/naming.tsx": /^(Room|Door)$/,
  "edit/writes.ts": /^make the $/,
  "edit/outline.ts": /^Polygon$/,
  "importing/drop.ts": /^Files$/,
  "map/grid.ts": /PGM/,
  "map/read.ts": /^(Window|Opening|Door|Room|Polygon|Point)$/,
  "queries/mount.tsx": /^Room$/,
  "rules/completion.ts": /^state of objects$/,
  "rules/editor.tsx": /^\.editor textarea$/,
  "scene/marks.ts": /gl_/,
  "scene/stage.ts": /^\(prefers-/,
  "timeline/tools.tsx": /^UTC$/,
  "welcome/sample.ts": /^(the sample|sample people|sample doors)$/,
};

const used = usedIn("src", (file, text) => KEYS.test(text) || (OTHER[file]?.test(text) ?? false));
const gapsOf = (text: string): string => [...new Set(text.match(/\{\d\}/g))].sort().join("");

test("no text stands outside of the catalogue", () => {
  expect(used.outside).toEqual([]);
});

test.each(Object.entries(CATALOGUES))("%s has all texts, no other, and the gaps of each", (_, texts) => {
  expect(Object.keys(texts).sort()).toEqual([...used.texts].sort());
  for (const [text, said] of Object.entries(texts)) {
    expect(said.trim(), text).not.toBe("");
    expect(gapsOf(said), text).toBe(gapsOf(text));
  }
});

test("Arabic is written in its letters", () => {
  const latin = Object.entries(ARABIC).filter(([, said]) => !/\p{Script=Arabic}/u.test(said));
  expect(
    latin.map(([text]) => text).filter((text) => /\p{L}{3,}/u.test(text.replace(/\{\d\}/g, ""))),
  ).toEqual(["Page ↑", "Page ↓", "Esc", "Ctrl Z", "Ctrl Shift Z"].filter((text) => text in ARABIC));
});

test("the reader's language is the one chosen, else the browser's, else English", () => {
  expect(chosenOf(null, ["fr-FR", "de-AT", "en"])).toBe("de");
  expect(chosenOf("ar", ["de"])).toBe("ar");
  expect(chosenOf("toString", ["fr"])).toBe("en");
});

test("gaps are filled in with what stands in them, in any order", () => {
  expect(t("{1} of {0}", 3, "$&")).toBe("$& of 3");
  expect(say("a {0} b", "x")).toEqual(["a ", "x", " b"]);
  expect(fixed(1234.5, 2)).toBe("1234.50");
});
