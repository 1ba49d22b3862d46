/** The taxonomy as a list to choose from. */

import type { Concept } from "../documents";

export interface ConceptChoice {
  name: string;
  /** How far below the root it is first met. */
  depth: number;
}

/** Each concept once, below the first of its parents by name, depth first. */
export function choicesOf(concepts: readonly Concept[]): ConceptChoice[] {
  const children = new Map<string, string[]>();
  for (const { name, parents } of concepts)
    for (const parent of parents) children.set(parent, [...(children.get(parent) ?? []), name]);
  const found = new Map<string, ConceptChoice>();
  const visit = (name: string, depth: number): void => {
    if (found.has(name)) return;
    found.set(name, { name, depth });
    for (const child of (children.get(name) ?? []).sort()) visit(child, depth + 1);
  };
  for (const { name, parents } of concepts) if (parents.length === 0) visit(name, 0);
  return [...found.values()];
}
