import { useState } from "preact/hooks";

import type { Problem } from "../documents";
import type { App } from "../app";
import { ProblemNote, problemOf } from "../panel/problem";
import type { ConceptChoice } from "./concepts";
import { Corners, Metres } from "./corners";
import type { Doorway } from "./doorway";
import type { Drawing } from "./drawing";
import type { Draft } from "./editing";
import { ConceptSelect, LeafSelect } from "./instance_form";
import { areaOf } from "./plane";
import { fixed, t } from "../language/catalogue";

const ROOM_HEIGHT_M = 2.7;

interface DraftProps {
  app: App;
  drawing: Drawing;
  concepts: readonly ConceptChoice[];
}

/** What is being drawn, in words and numbers, and what it shall be called. */
export function NewThing({
  app,
  drawing,
  concepts,
  draft,
}: DraftProps & { draft: Draft & { kind: "room" | "door" } }) {
  const kind = draft.kind === "room" ? "Room" : "Door";
  const [name, setName] = useState(() => freeName(app, kind));
  const [concept, setConcept] = useState(kind);
  const [height_m, setHeight] = useState(ROOM_HEIGHT_M);
  const [leaf, setLeaf] = useState("left");
  const [problem, setProblem] = useState<Problem | null>(null);
  const { editing } = drawing;
  const isReady =
    editing.fault.value === null && (draft.kind === "door" || draft.isClosed) && name.trim() !== "";
  const make = (): void => {
    setProblem(null);
    const naming = {
      name: name.trim(),
      concept,
      height_m,
      leaf: leaf === "" ? null : (leaf as "left" | "right"),
    };
    drawing.make(naming).catch((error: unknown) => setProblem(problemOf(error)));
  };
  return (
    <form
      class="stack"
      aria-label={draft.kind === "room" ? t("New room") : t("New door")}
      onSubmit={(event) => {
        event.preventDefault();
        if (isReady) make();
      }}
    >
      <Advice drawing={drawing} draft={draft} />
      {draft.kind === "room" ? (
        <>
          {!draft.isClosed && (
            <div class="row">
              <button type="button" disabled={editing.fault.value !== null} onClick={() => editing.close()}>
                {t("Close the outline")}
              </button>
              <button type="button" disabled={draft.corners.length === 0} onClick={() => editing.back()}>
                {t("Take the last corner back")}
              </button>
            </div>
          )}
          <Corners editing={editing} />
        </>
      ) : (
        <DoorNumbers drawing={drawing} doorway={draft.doorway} />
      )}
      <label class="field">
        <span>{t("Name")}</span>
        <input value={name} maxLength={200} onInput={(event) => setName(event.currentTarget.value)} />
      </label>
      <label class="field">
        <span>{t("Concept")}</span>
        <ConceptSelect value={concept} concepts={concepts} set={setConcept} />
      </label>
      {draft.kind === "room" ? (
        <label class="field">
          <span>{t("Height [m]")}</span>
          <Metres label={t("Height in metres")} value={height_m} set={setHeight} min={0.01} />
        </label>
      ) : (
        <LeafSelect value={leaf} set={setLeaf} />
      )}
      {problem && <ProblemNote problem={problem} />}
      <div class="row">
        <button type="submit" class="primary" disabled={!isReady || drawing.isSending.value}>
          {draft.kind === "room" ? t("Make the room") : t("Make the door")}
        </button>
        <button type="button" onClick={() => drawing.stop()}>
          {t("Cancel")}
        </button>
      </div>
    </form>
  );
}

/** What is moved or reshaped, to be put in its new place. */
export function ChangedShape({
  drawing,
  draft,
}: {
  drawing: Drawing;
  draft: Draft & { kind: "shape" | "place" };
}) {
  const [problem, setProblem] = useState<Problem | null>(null);
  const fault = drawing.editing.fault.value;
  const settle = (): void => {
    setProblem(null);
    drawing.settle().catch((error: unknown) => setProblem(problemOf(error)));
  };
  return (
    <form
      class="stack"
      aria-label={t("Move {0}", draft.thing.name)}
      onSubmit={(event) => {
        event.preventDefault();
        if (fault === null) settle();
      }}
    >
      <h3>{draft.thing.alias ?? draft.thing.name}</h3>
      <p class="soft">
        {draft.kind === "shape"
          ? t(
              "Drag a corner, the middle of a side to add one, or the inside to move all of it. Arrows move it, too.",
            )
          : t("Drag it to its new place, or move it with the arrows.")}
      </p>
      {fault && <p class="note bad">{fault}</p>}
      {draft.kind === "shape" && <Corners editing={drawing.editing} />}
      {problem && <ProblemNote problem={problem.status === 412 ? overtaken(problem) : problem} />}
      <div class="row">
        <button type="submit" class="primary" disabled={fault !== null || drawing.isSending.value}>
          {t("Put it there")}
        </button>
        <button type="button" onClick={() => drawing.stop()}>
          {t("Cancel")}
        </button>
      </div>
    </form>
  );
}

function overtaken(problem: Problem): Problem {
  return {
    ...problem,
    detail: t("Somebody else changed it meanwhile."),
    remedy: t("It is shown as it is now; move it again if it should still go elsewhere."),
  };
}

/** How far a drawing is and what comes next; read out as it changes. */
function Advice({ drawing, draft }: { drawing: Drawing; draft: Draft & { kind: "room" | "door" } }) {
  const fault = drawing.editing.fault.value;
  const isWrong = draft.kind === "room" && draft.corners.length >= 3 && fault !== null;
  return (
    <p class={isWrong ? "note bad" : "note"} role="status">
      {draft.kind === "room" ? roomAdvice(draft, fault) : doorAdvice(draft)}
    </p>
  );
}

function roomAdvice({ corners, isClosed }: Draft & { kind: "room" }, fault: string | null): string {
  if (isClosed) return t("An area of {0} m². Give it a name.", fixed(Math.abs(areaOf(corners)), 1));
  if (corners.length < 3)
    return t(
      "Click the corners one after the other; with Shift sides keep square. Or use the arrows and Enter.",
    );
  return fault ?? t("Click the first corner, or press Enter, to close the outline.");
}

function doorAdvice({ doorway, isPlaced }: Draft & { kind: "door" }): string {
  if (doorway === null) return t("Point at a wall and click where the door is. Or use the arrows and Enter.");
  const joins =
    doorway.joins.length === 2
      ? t("between {0} and {1}", ...doorway.joins)
      : t("of {0}", doorway.joins[0] ?? t("no room"));
  return isPlaced
    ? t("A door {0}, {1} m wide.", joins, fixed(doorway.width_m, 2))
    : t("Click to place it: a door {0}.", joins);
}

function DoorNumbers({ drawing: { editing }, doorway }: { drawing: Drawing; doorway: Doorway | null }) {
  const present = doorway ?? {
    middle: [0, 0] as const,
    yaw_rad: 0,
    width_m: editing.doorWidth_m.value,
    joins: [],
  };
  const [x, y] = present.middle;
  const set = (changed: Partial<Doorway>): void => editing.setDoorway({ ...present, ...changed });
  return (
    <>
      <label class="field">
        <span>{t("Width [m]")}</span>
        <Metres
          label={t("Width in metres")}
          value={present.width_m}
          min={0.1}
          set={(width_m) => {
            editing.doorWidth_m.value = width_m;
            if (doorway !== null) set({ width_m });
          }}
        />
      </label>
      <details class="corners">
        <summary>{t("Place in metres")}</summary>
        <div class="pair">
          <Metres label={t("x of the door")} value={x} set={(value) => set({ middle: [value, y] })} />
          <Metres label={t("y of the door")} value={y} set={(value) => set({ middle: [x, value] })} />
        </div>
        <label class="field">
          <span>{t("Direction from the x axis [degrees]")}</span>
          <Metres
            label={t("Direction in degrees")}
            value={(present.yaw_rad * 180) / Math.PI}
            set={(degrees) => set({ yaw_rad: (degrees * Math.PI) / 180 })}
          />
        </label>
      </details>
    </>
  );
}

/** Kind and number, the first that no instance of the map has. */
function freeName(app: App, kind: string): string {
  const taken = new Set(app.state.map.value?.things.map((thing) => thing.name));
  let number = 1;
  while (taken.has(`${kind} ${number}`)) number += 1;
  return `${kind} ${number}`;
}
