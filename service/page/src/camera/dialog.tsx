/** Places a fixed camera: its picture beside the plan, and the part of a rig that follows from points in both. */

import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";

import { distance } from "../edit/plane";
import type { Outline, Point } from "../map/model";
import { hasCopied, save } from "../panel/taking";
import "./camera.css";
import { paintFloor } from "./floor";
import { Pane, type Fraction } from "./pane";
import type { Picture, Placing } from "./placing";
import { PointList } from "./point_list";
import { Settings } from "./settings";
import { Verdict } from "./verdict";
import { t } from "../language/catalogue";

export function CameraDialog({ placing, close }: { placing: Placing; close: () => void }) {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => dialog.current?.showModal(), []);
  const picture = placing.picture.value;
  const rig = placing.rig();
  return (
    <dialog
      ref={dialog}
      class="camera"
      aria-label={t("Place a camera")}
      onClose={close}
      onDragEnter={keep}
      onDragOver={keep}
      onDragLeave={keep}
      onDrop={(event) => {
        keep(event);
        const file = event.dataTransfer?.files[0];
        if (file) void placing.take(file);
      }}
    >
      <h2 tabIndex={-1} autofocus>
        {t("Place a camera")}
      </h2>
      <div class="stack">
        <p class="soft">
          {t(
            "Mark four or more points of the floor in the picture and the same ones on the plan, such as corners of rooms and feet of door frames, as far from one another as the picture shows. The picture stays in this browser.",
          )}
        </p>
        <Settings placing={placing} />
        <div class="panes">
          {picture && <PicturePane placing={placing} picture={picture} />}
          <PlanPane placing={placing} />
        </div>
        <PointList placing={placing} />
        <div class="stack outcome">
          <Verdict placing={placing} />
          {rig !== null && <Rig name={placing.name.value} text={rig} />}
        </div>
      </div>
      <footer>
        <button type="button" onClick={() => dialog.current?.close()}>
          {t("Close")}
        </button>
      </footer>
    </dialog>
  );
}

/** Files that are dropped here are no maps to import. */
function keep(event: DragEvent): void {
  event.preventDefault();
  event.stopPropagation();
}

function PicturePane({ placing, picture }: { placing: Placing; picture: Picture }) {
  const [width, height] = picture.size;
  const pixelOf = ([x, y]: Fraction): Point => [x * width, y * height];
  return (
    <Pane
      title={t("Picture")}
      where="in the picture"
      ratio={width / height}
      marks={placing.marks.value.map(({ pixel }) => pixel && [pixel[0] / width, pixel[1] / height])}
      put={(at) => placing.put("pixel", pixelOf(at))}
      move={(i, at) => placing.move(i, "pixel", pixelOf(at))}
      step={(i, [right, down]) => {
        const [u, v] = placing.marks.value[i]!.pixel!;
        placing.move(i, "pixel", [u + right, v + down]);
      }}
      remove={(i) => placing.remove(i)}
    >
      <img src={picture.url} alt={picture.name} draggable={false} />
    </Pane>
  );
}

const STEP_M = 0.01;

function PlanPane({ placing }: { placing: Placing }) {
  const bounds = placing.bounds();
  const { xMin_m, yMax_m } = bounds;
  const [width_m, height_m] = [bounds.xMax_m - xMin_m, yMax_m - bounds.yMin_m];
  const placeOf = ([x, y]: Fraction, [reach]: Fraction): Point =>
    nearCorner(placing, [xMin_m + x * width_m, yMax_m - y * height_m], reach * width_m);
  const [picture, lens] = [placing.picture.value, placing.lens.value];
  const canvas = useRef<HTMLCanvasElement>(null);
  const storey = placing.storey.value;
  useLayoutEffect(() => {
    if (canvas.current && picture && lens && typeof lens !== "string")
      paintFloor(canvas.current, lens, picture, bounds);
  }, [lens, picture, storey]);
  const lines = placing.things().flatMap((thing) => thing.outlines);
  return (
    <Pane
      title={t("Plan")}
      where="on the plan"
      ratio={width_m / height_m}
      marks={placing.marks.value.map(
        ({ place }) => place && [(place[0] - xMin_m) / width_m, (yMax_m - place[1]) / height_m],
      )}
      put={(at, reach) => placing.put("place", placeOf(at, reach))}
      move={(i, at, reach) => placing.move(i, "place", placeOf(at, reach))}
      step={(i, [right, down]) => {
        const [x, y] = placing.marks.value[i]!.place!;
        placing.move(i, "place", [x + right * STEP_M, y - down * STEP_M]);
      }}
      remove={(i) => placing.remove(i)}
    >
      {lens && typeof lens !== "string" && (
        <canvas ref={canvas} aria-label={t("The picture's floor on the plan")} role="img" />
      )}
      <svg viewBox={`${xMin_m} ${-yMax_m} ${width_m} ${height_m}`} aria-hidden="true">
        {lines.map((outline, i) => (
          <path key={i} d={pathOf(outline)} />
        ))}
        {lens && typeof lens !== "string" && (
          <circle cx={lens.place[0]} cy={-lens.place[1]} r={width_m / 80} />
        )}
      </svg>
    </Pane>
  );
}

/** A corner of what stands there, if one is near: people click it and mean it exactly. */
function nearCorner(placing: Placing, place: Point, reach_m: number): Point {
  let [best, least_m] = [place, reach_m];
  for (const { outlines, line } of placing.things())
    for (const corner of [...outlines.flat(2), ...(line ?? [])])
      if (distance(corner, place) < least_m) [best, least_m] = [corner, distance(corner, place)];
  return best;
}

function pathOf(outline: Outline): string {
  return outline.map((ring) => `M${ring.map(([x, y]) => `${x} ${-y}`).join("L")}Z`).join("");
}

function Rig({ name, text }: { name: string; text: string }) {
  // What is said elsewhere on the page lies under the dialog.
  const [said, setSaid] = useState({ of: "", text: "" });
  const copy = async (): Promise<void> => {
    const isCopied = await hasCopied(text);
    setSaid({ of: text, text: isCopied ? t("Copied.") : t("This browser copies nothing: download it.") });
  };
  return (
    <section class="stack" aria-label={t("Part of a rig")}>
      <pre class="why" tabIndex={0}>
        {text}
      </pre>
      <div class="row">
        <button type="button" onClick={() => void copy()}>
          {t("Copy")}
        </button>
        <button type="button" class="primary" onClick={() => save(name, "yaml", text, "application/yaml")}>
          {t("Download")}
        </button>
        <span role="status">{said.of === text && said.text}</span>
      </div>
    </section>
  );
}
