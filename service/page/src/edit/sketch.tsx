/** What is being drawn, as an SVG over the picture of the map. */

import type { ReadonlySignal } from "@preact/signals";

import type { Surface } from "../app";
import type { Outline, Point } from "../map/model";
import { endsOf, type Doorway } from "./doorway";
import type { Draft, Editing } from "./editing";
import { faultOf, mayFollow } from "./outline";
import { areaOf, distance } from "./plane";
import type { Snapped } from "./snapping";
import { fixed, say } from "../language/catalogue";

type ToPixels = (point: Point) => string;

interface SketchProps {
  editing: Editing;
  surface: Surface;
  /** The crosshair of the keyboard; null: the pointer leads. */
  crosshair: ReadonlySignal<Point | null>;
}

export function Sketch({ editing, surface, crosshair }: SketchProps) {
  surface.viewed.value;
  const draft = editing.draft.value;
  if (draft === null) return null;
  const to: ToPixels = ([x_m, y_m]) => {
    const { x, y } = surface.pixelOf({ x_m, y_m });
    return `${x.toFixed(1)},${y.toFixed(1)}`;
  };
  return (
    <svg class="sketch" aria-hidden="true">
      <Drawn draft={draft} aim={editing.aim.value} to={to} />
      {crosshair.value && <Crosshair at={to(crosshair.value)} />}
    </svg>
  );
}

function Drawn({ draft, aim, to }: { draft: Draft; aim: Snapped | null; to: ToPixels }) {
  switch (draft.kind) {
    case "room":
      return draft.isClosed ? (
        <Area rings={[draft.corners]} to={to} />
      ) : (
        <Open corners={draft.corners} aim={aim} to={to} />
      );
    case "door":
      return draft.doorway && <DoorLine doorway={draft.doorway} isPlaced={draft.isPlaced} to={to} />;
    case "shape":
      return (
        <>
          <Area rings={draft.rings} to={to} />
          <Middles rings={draft.rings} to={to} />
        </>
      );
    case "place":
      return draft.doorway ? (
        <DoorLine doorway={draft.doorway} isPlaced to={to} />
      ) : (
        <Dot
          class="corner"
          at={to([draft.thing.place[0] + draft.moved[0], draft.thing.place[1] + draft.moved[1]])}
        />
      );
  }
}

function Area({ rings, to }: { rings: Outline; to: ToPixels }) {
  const isFaulty = rings.some((ring) => faultOf(ring) !== null);
  const outline = rings.map((ring) => `M${ring.map(to).join("L")}Z`).join("");
  return (
    <>
      <path class={isFaulty ? "area faulty" : "area"} d={outline} fill-rule="evenodd" />
      {rings.map((ring, i) =>
        ring.map((corner, j) => <Dot key={`${i}/${j}`} class="corner" at={to(corner)} />),
      )}
      {rings[0] && <Lengths ring={rings[0]} to={to} isClosed />}
    </>
  );
}

function Middles({ rings, to }: { rings: Outline; to: ToPixels }) {
  return (
    <>
      {rings.map((ring, i) =>
        ring.map(([x, y], j) => {
          const [nextX, nextY] = ring[(j + 1) % ring.length] as Point;
          return <Dot key={`${i}/${j}`} class="middle" at={to([(x + nextX) / 2, (y + nextY) / 2])} />;
        }),
      )}
    </>
  );
}

function Open({ corners, aim, to }: { corners: readonly Point[]; aim: Snapped | null; to: ToPixels }) {
  const next = aim?.point;
  const isFaulty = next !== undefined && aim?.to !== "start" && !mayFollow(corners, next);
  const all = next === undefined ? corners : [...corners, next];
  return (
    <>
      {all.length > 2 && <polygon class="inside" points={all.map(to).join(" ")} />}
      <polyline class={isFaulty ? "side faulty" : "side"} points={all.map(to).join(" ")} />
      {corners.map((corner, i) => (
        <Dot key={i} class={i === 0 ? "corner first" : "corner"} at={to(corner)} />
      ))}
      {aim && <Dot class={`aim ${aim.to ?? "free"}`} at={to(aim.point)} />}
      <Lengths ring={all} to={to} isClosed={false} />
    </>
  );
}

/** Beside its side, where no handle lies. */
const LENGTH_BESIDE_PX = 15;

function Lengths({ ring, to, isClosed }: { ring: readonly Point[]; to: ToPixels; isClosed: boolean }) {
  const ends = isClosed ? ring : ring.slice(0, -1);
  return (
    <>
      {ends.map((a, i) => {
        const b = ring[(i + 1) % ring.length] as Point;
        const [from, until] = [numbersOf(to(a)), numbersOf(to(b))];
        const long_px = Math.max(distance(from, until), 1);
        const outwards = (areaOf(ring) < 0 ? -LENGTH_BESIDE_PX : LENGTH_BESIDE_PX) / long_px;
        const x = (from[0] + until[0]) / 2 - (until[1] - from[1]) * outwards;
        const y = (from[1] + until[1]) / 2 + (until[0] - from[0]) * outwards;
        return (
          <text key={i} class="length" x={x} y={y}>
            {say("{0} m", fixed(distance(a, b), 2))}
          </text>
        );
      })}
    </>
  );
}

function DoorLine({ doorway, isPlaced, to }: { doorway: Doorway; isPlaced: boolean; to: ToPixels }) {
  const [a, b] = endsOf(doorway);
  const [x1, y1] = to(a).split(",");
  const [x2, y2] = to(b).split(",");
  return (
    <>
      <line class={isPlaced ? "doorway placed" : "doorway"} x1={x1} y1={y1} x2={x2} y2={y2} />
      <Dot class="corner first" at={to(a)} />
    </>
  );
}

function Dot({ class: kind, at }: { class: string; at: string }) {
  const [x, y] = at.split(",");
  return <circle class={kind} cx={x} cy={y} r={kind.startsWith("middle") ? 4 : 6} />;
}

function Crosshair({ at }: { at: string }) {
  const [x, y] = numbersOf(at);
  return <path class="crosshair" d={`M${x - 14},${y}h28M${x},${y - 14}v28`} />;
}

function numbersOf(at: string): Point {
  const [x = 0, y = 0] = at.split(",").map(Number);
  return [x, y];
}
