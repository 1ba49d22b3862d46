/** Pieces that the details share. */

import type { ComponentChildren } from "preact";

import type { Problem } from "../documents";
import type { App } from "../app";
import { trackColourName } from "../scene/colours";
import { durationText, momentText } from "../timeline/scale";

const LEAST_AGO_MS = 50;

export function Facts({ facts }: { facts: readonly (readonly [string, ComponentChildren])[] }) {
  const known = facts.filter(
    ([, value]) => value !== null && value !== undefined && value !== "" && value !== false,
  );
  return (
    <table class="plain">
      <tbody>
        {known.map(([label, value]) => (
          <tr key={label}>
            <th scope="row">{label}</th>
            <td>{value}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

/** A moment that can be gone to, with how long ago that was by the moment shown. */
export function Moment({ app, stamp }: { app: App; stamp: string }) {
  const at = Date.parse(stamp);
  const shown = app.state.at.value ?? app.state.newest.value;
  const ago = shown === null ? null : shown - at;
  return (
    <button class="link number" title="Show this moment" onClick={() => app.moveTo(at)}>
      {momentText(at)}
      {ago !== null && ago >= LEAST_AGO_MS && <span class="soft ago"> {durationText(ago)} ago</span>}
    </button>
  );
}

export function TrackLink({ app, id, name }: { app: App; id: number; name: string }) {
  return (
    <button class="link" onClick={() => (app.state.selection.value = { kind: "track", id })}>
      <i class="dot" style={{ background: trackColourName(id) }} />
      {name}
    </button>
  );
}

export function InstanceLink({ app, id, name }: { app: App; id: number; name: string }) {
  return (
    <button class="link" onClick={() => (app.state.selection.value = { kind: "instance", id })}>
      {name}
    </button>
  );
}

export function Failed({ problem }: { problem: Problem }) {
  return (
    <p class="note bad" role="alert">
      {problem.detail} {problem.remedy}
    </p>
  );
}

/** A value of any kind as text. */
export function textOf(value: unknown): string {
  if (typeof value === "number")
    return Number.isInteger(value) ? String(value) : String(Math.round(value * 1000) / 1000);
  return typeof value === "string" ? value : JSON.stringify(value);
}
