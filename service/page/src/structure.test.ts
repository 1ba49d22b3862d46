/** How the page is built: no circle of imports, pictures and panels apart from each other, state below both. */

import { readdirSync, readFileSync } from "node:fs";
import { dirname, join, normalize } from "node:path";

import { parseAst } from "vite";
import { expect, test } from "vitest";

interface Import {
  type: string;
  source?: { value: string } | null;
  importKind?: string;
  exportKind?: string;
}

const ROOT = "src";
const files = (readdirSync(ROOT, { recursive: true }) as string[]).filter(
  (file) => /\.tsx?$/.test(file) && !/\.test\.ts$/.test(file),
);

/** What a file imports of the page's own, types included where asked for. */
function importsOf(file: string, withTypes: boolean): string[] {
  const { body } = parseAst(readFileSync(join(ROOT, file), "utf8"), {
    lang: file.endsWith("x") ? "tsx" : "ts",
  }) as unknown as { body: Import[] };
  return body
    .filter((each) => withTypes || (each.importKind !== "type" && each.exportKind !== "type"))
    .map((each) => each.source?.value ?? "")
    .filter((source) => source.startsWith("."))
    .map((source) => normalize(join(dirname(file), source)))
    .flatMap((path) => files.filter((each) => each === `${path}.ts` || each === `${path}.tsx`));
}

function circleIn(imports: ReadonlyMap<string, readonly string[]>): string[] | null {
  const done = new Set<string>();
  const way: string[] = [];
  const visit = (file: string): string[] | null => {
    if (way.includes(file)) return [...way.slice(way.indexOf(file)), file];
    if (done.has(file)) return null;
    way.push(file);
    for (const next of imports.get(file) ?? []) {
      const found = visit(next);
      if (found) return found;
    }
    way.pop();
    done.add(file);
    return null;
  };
  for (const file of imports.keys()) {
    const found = visit(file);
    if (found) return found;
  }
  return null;
}

test("a circle is found", () => {
  expect(
    circleIn(
      new Map([
        ["a", ["b"]],
        ["b", ["c", "d"]],
        ["c", []],
        ["d", ["b"]],
      ]),
    ),
  ).toEqual(["b", "d", "b"]);
});

test("no file imports one that imports it", () => {
  expect(circleIn(new Map(files.map((file) => [file, importsOf(file, false)])))).toBe(null);
});

const PANELS = /^(alerts|camera|details|edit|events|importing|queries|rules|welcome)\//;

test("pictures and state know no panel", () => {
  const wrong = files
    .filter((file) => /^(scene|live|map)\//.test(file) || file === "state.ts")
    .flatMap((file) => importsOf(file, true).map((each) => [file, each] as const))
    .filter(([file, each]) => PANELS.test(each) && !(file === "state.ts" && each === "events/filter.ts"));
  expect(wrong).toEqual([]);
});
