/** For tests: which texts the sources say, and which of their strings look like a text that is in no catalogue. */

import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";

import { parseAst } from "vite";

interface Node {
  type: string;
  [part: string]: unknown;
}

/** What JSX attributes say to people. */
const SAID: ReadonlySet<string> = new Set([
  "title",
  "aria-label",
  "placeholder",
  "alt",
  "label",
  "what",
  "hint",
]);
/** What they say to programs. */
const UNSAID: ReadonlySet<string> = new Set([
  "class",
  "style",
  "d",
  "viewBox",
  "transform",
  "points",
  "autocomplete",
]);
/** Two words, or one that begins a sentence. */
const WORDS = /\p{L}{2,}[,.:;]? \p{L}{2,}|^\p{Lu}\p{Ll}+ ?$/u;

export interface Used {
  texts: ReadonlySet<string>;
  /** `file: text` of each that stands outside. */
  outside: readonly string[];
}

/** Reads all sources in a folder. `isOther` says of a string that it is none for people. */
export function usedIn(folder: string, isOther: (file: string, text: string) => boolean): Used {
  const texts = new Set<string>();
  const outside: string[] = [];
  for (const file of readdirSync(folder, { recursive: true }) as string[]) {
    if (!/\.tsx?$/.test(file) || /\.test\.ts$|\.d\.ts$|^language\//.test(file)) continue;
    const source = readFileSync(join(folder, file), "utf8");
    const note = (text: string): void => {
      if (!isOther(file, text)) outside.push(`${file}: ${text}`);
    };
    walk(parseAst(source, { lang: file.endsWith("x") ? "tsx" : "ts" }) as unknown as Node, texts, note);
  }
  return { texts, outside };
}

function walk(node: Node, texts: Set<string>, note: (text: string) => void): void {
  const into = (part: unknown): void => {
    if (Array.isArray(part)) part.forEach(into);
    else if (isNode(part)) walk(part, texts, note);
  };
  if (node.type === "ImportDeclaration" || node.type.startsWith("TSLiteral")) return;
  if (node.type === "CallExpression" && isSaying(node["callee"])) {
    const [text, ...values] = node["arguments"] as Node[];
    if (typeof text?.["value"] === "string") texts.add(text["value"]);
    else note("a text that is put together");
    values.forEach(into);
    return;
  }
  if (node.type === "JSXText" && /\p{L}{2,}/u.test(node["value"] as string))
    note((node["value"] as string).trim());
  if (node.type === "JSXAttribute") {
    const { name } = node["name"] as { name: string };
    const said = (node["value"] as Node | null)?.["value"];
    if (typeof said === "string" && SAID.has(name) && /\p{L}{2,}/u.test(said)) note(said);
    if (typeof said === "string" || UNSAID.has(name)) return;
  }
  const text = node.type === "TemplateElement" ? (node["value"] as { cooked: string }).cooked : node["value"];
  if (
    (node.type === "Literal" || node.type === "TemplateElement") &&
    typeof text === "string" &&
    WORDS.test(text)
  )
    note(text);
  for (const [name, part] of Object.entries(node)) if (name !== "type") into(part);
}

function isNode(part: unknown): part is Node {
  return typeof part === "object" && part !== null && typeof (part as Node).type === "string";
}

function isSaying(callee: unknown): boolean {
  return isNode(callee) && (callee["name"] === "t" || callee["name"] === "say");
}
