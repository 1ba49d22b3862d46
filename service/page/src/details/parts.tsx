/** Pieces that the details share. */

import type { ComponentChildren } from "preact";

import type { Problem } from "../documents";
import type { App } from "../app";
import { trackColourName } from "../scene/colours";
import { nameIn } from "../words";
import { durationText, momentText } from "../timeline/clock";
import { say, t } from "../language/catalogue";

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

/** A moment that can be gone to, with how long ago that was by the moment shown, unless it is plain. */
export function Moment({ app, stamp, isPlain = false }: { app: App; stamp: string; isPlain?: boolean }) {
  const at = Date.parse(stamp);
  const shown = app.state.at.value ?? app.state.newest.value;
  const ago = shown === null ? null : shown - at;
  return (
    <button class="link number" title={t("Show this moment")} onClick={() => app.moveTo(at)}>
      {momentText(at)}
      {!isPlain && ago !== null && ago >= LEAST_AGO_MS && (
        <span class="soft ago"> {say("{0} ago", durationText(ago))}</span>
      )}
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

/** In place of what is not known of the moment that is shown. */
export function Unread({ app }: { app: App }) {
  return (
    <p class="note unread">
      {app.state.unread.value === null ? t("Being read …") : t("Not known: it could not be read.")}
    </p>
  );
}

export function nameOf(app: App, id: number, otherwise: string | null): string {
  return nameIn(app.state.map.value, id, otherwise);
}
