/** An instance as a form shows it: texts, and the changes that differ from what was read. */

import type { InstanceChanges, InstanceDocument } from "../documents";
import { t } from "../language/catalogue";

export interface Fields {
  name: string;
  alias: string;
  concept: string;
  storey: string;
  elevation_m: string;
  height_m: string;
  joins: string;
  leaf: string;
}

export type Edits = Partial<Fields>;

export const LABELS: Readonly<Record<keyof Fields, string>> = {
  name: t("Name"),
  alias: t("Alias"),
  concept: t("Concept"),
  storey: t("Storey"),
  elevation_m: t("Floor at [m]"),
  height_m: t("Height [m]"),
  joins: t("Joins the rooms"),
  leaf: t("Leaf"),
};

export function fieldsOf({
  name,
  alias,
  concept,
  storey,
  band,
  joins,
  attributes,
}: InstanceDocument): Fields {
  const height_m = band === null ? "" : text(band.z_max_m - band.z_min_m);
  return {
    name,
    alias: alias ?? "",
    concept,
    storey: storey ?? "",
    elevation_m: band === null ? "" : text(band.z_min_m),
    height_m,
    joins: joins.map((room) => room.name).join(", "),
    leaf: hingeOf(attributes["leaf"]),
  };
}

/** What to send so that an instance becomes what was typed; empty: nothing differs. */
export function changesOf(read: InstanceDocument, edits: Edits): InstanceChanges {
  const before = fieldsOf(read);
  const after = { ...before, ...edits };
  const differs = (key: keyof Fields): boolean => after[key].trim() !== before[key];
  const changes: InstanceChanges = {};
  if (differs("name")) changes.name = after.name.trim();
  if (differs("alias")) changes.alias = after.alias.trim() || null;
  if (differs("concept")) changes.concept = after.concept;
  if (differs("storey")) changes.storey = after.storey || null;
  if (differs("joins"))
    changes.joins = after.joins
      .split(",")
      .map((name) => name.trim())
      .filter(Boolean);
  if (differs("leaf")) changes.attributes = withLeaf(read.attributes, after.leaf);
  if (differs("elevation_m") || differs("height_m")) Object.assign(changes, heights(after));
  return changes;
}

/** Whether somebody else changed what is being edited, so that saving would overwrite what was not seen. */
export function overtaken(edits: Edits, before: InstanceDocument, now: InstanceDocument): boolean {
  const [old, newest] = [fieldsOf(before), fieldsOf(now)];
  return (Object.keys(edits) as (keyof Fields)[]).some(
    (key) => old[key] !== newest[key] && newest[key] !== edits[key],
  );
}

/** What is wrong with what was typed, by field. */
export function faultsIn(edits: Edits): Partial<Record<keyof Fields, string>> {
  const faults: Partial<Record<keyof Fields, string>> = {};
  if (edits.name !== undefined && edits.name.trim() === "") faults.name = t("A name is needed.");
  if (edits.height_m?.trim() && !(Number(edits.height_m) > 0))
    faults.height_m = t("Write metres above zero.");
  if (edits.elevation_m?.trim() && !Number.isFinite(Number(edits.elevation_m)))
    faults.elevation_m = t("Write metres.");
  return faults;
}

/** Without a height it is at every height, and the floor says nothing. */
function heights({ elevation_m, height_m }: Fields): InstanceChanges {
  if (height_m.trim() === "") return { height_m: null };
  return { elevation_m: Number(elevation_m || 0), height_m: Number(height_m) };
}

function withLeaf(attributes: Record<string, unknown>, hinge: string): Record<string, unknown> {
  const { leaf, ...others } = attributes;
  if (hinge === "") return others;
  return { ...others, leaf: isMapping(leaf) ? { ...leaf, hinge } : hinge };
}

function hingeOf(leaf: unknown): string {
  const hinge = isMapping(leaf) ? leaf["hinge"] : leaf;
  return typeof hinge === "string" ? hinge : "";
}

function isMapping(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

function text(value: number): string {
  return String(Math.round(value * 1e4) / 1e4);
}
