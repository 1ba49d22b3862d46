import { effect, untracked } from "@preact/signals";
import { render } from "preact";

import type { Concept } from "../documents";
import type { App } from "../app";
import { FixedCamera } from "../camera/mount";
import "../panel/panel.css";
import { Guarded } from "../panel/guarded";
import { ProblemNote, problemOf } from "../panel/problem";
import { useResource } from "../panel/resource";
import { contact } from "../unanswered";
import { ChangesList } from "./changes_list";
import { choicesOf } from "./concepts";
import { Drawing } from "./drawing";
import "./edit.css";
import { InstanceForm, remove } from "./instance_form";
import { listenForKeys } from "./keys";
import { Log, nameOf } from "./log";
import { ChangedShape, NewThing } from "./naming";
import { Sketch } from "./sketch";
import { readInstance } from "./writes";
import { t } from "../language/catalogue";

/** Puts the panel for editing into its element, its drawing over the map, and listens for its keys. */
export function mount(element: HTMLElement, app: App): void {
  const drawing = new Drawing(app);
  const log = new Log(app);
  effect(() => {
    // A new state of the map is the only sign of changes that others made.
    void [app.state.map.value, contact.value];
    if (app.state.mapName.value !== null) void log.read();
  });
  effect(() => {
    void app.state.mapName.value;
    drawing.stop();
    log.changes.value = null;
  });
  effect(() => {
    const isShown = app.state.tab.value === "edit";
    untracked(() => (isShown ? drawing.takeUp() : drawing.putAway()));
  });
  listenForKeys(app, {
    isDrawing: () => drawing.isOn,
    drawRoom: () => drawing.drawRoom(),
    drawDoor: () => drawing.drawDoor(),
    change: () => void changeSelected(app, drawing),
    remove: () => void removeSelected(app),
    undo: () => void log.undo(),
    redo: () => void log.redo(),
    go: (steps) => drawing.go(steps),
    place: () => drawing.place(),
    back: () => drawing.editing.back(),
    stop: () => drawing.stop(),
  });
  const over = document.createElement("div");
  over.className = "sketch-place";
  document.getElementById("stage-chrome")?.before(over);
  render(<Sketch editing={drawing.editing} surface={app.surface} crosshair={drawing.crosshair} />, over);
  render(<Panel app={app} drawing={drawing} log={log} />, element);
}

function Panel({ app, drawing, log }: { app: App; drawing: Drawing; log: Log }) {
  const map = app.state.mapName.value;
  if (map === null) return <p class="soft">{t("There is no map yet. Bring one in under Import.")}</p>;
  return <OnMap key={map} app={app} drawing={drawing} log={log} />;
}

function OnMap({ app, drawing, log }: { app: App; drawing: Drawing; log: Log }) {
  const found = useResource((signal) => app.api.get<{ concepts: Concept[] }>("/concepts", signal), []);
  const concepts = choicesOf(found.value?.concepts ?? []);
  const draft = drawing.editing.draft.value;
  const selection = app.state.selection.value;
  const isDrawn = draft?.kind === "room" || draft?.kind === "door";
  return (
    <div class="stack">
      <Guarded app={app} what={t("Editing")}>
        <Toolbar drawing={drawing} log={log} />
        {found.problem && <ProblemNote problem={found.problem} retry={found.reload} />}
        {isDrawn && (
          <NewThing key={draft.kind} app={app} drawing={drawing} concepts={concepts} draft={draft} />
        )}
        {draft && !isDrawn && <ChangedShape drawing={drawing} draft={draft} />}
        {draft === null && selection?.kind === "instance" && (
          <InstanceForm
            key={selection.id}
            app={app}
            drawing={drawing}
            id={selection.id}
            concepts={concepts}
            isUndoing={log.isUndoing.value}
          />
        )}
        {draft === null && selection?.kind !== "instance" && (
          <p class="soft">
            {t("Choose a room, a door or a thing on the map to change it, or draw a new one.")}
          </p>
        )}
        <details open>
          <summary>{t("Changes of this map")}</summary>
          <div class="stack">
            <ChangesList log={log} />
          </div>
        </details>
      </Guarded>
      <FixedCamera app={app} />
    </div>
  );
}

function Toolbar({ drawing, log }: { drawing: Drawing; log: Log }) {
  const kind = drawing.editing.draft.value?.kind;
  const { undo, redo } = log.steps.value;
  return (
    <div class="row" role="toolbar" aria-label={t("Editing")}>
      <button type="button" aria-pressed={kind === "room"} title="R" onClick={() => drawing.drawRoom()}>
        {t("Draw a room")}
      </button>
      <button type="button" aria-pressed={kind === "door"} title="O" onClick={() => drawing.drawDoor()}>
        {t("Draw a door")}
      </button>
      <span class="grow" />
      <button
        type="button"
        class="icon"
        aria-label={undo === null ? t("Undo") : t("Undo: {0}", nameOf(undo))}
        title={undo === null ? t("Undo (Ctrl+Z)") : t("Undo: {0} (Ctrl+Z)", nameOf(undo))}
        disabled={undo === null || log.isUndoing.value}
        onClick={() => void log.undo()}
      >
        ↶
      </button>
      <button
        type="button"
        class="icon"
        aria-label={t("Do again")}
        title={t("Do again (Ctrl+Shift+Z)")}
        disabled={redo === null || log.isUndoing.value}
        onClick={() => void log.redo()}
      >
        ↷
      </button>
    </div>
  );
}

async function changeSelected(app: App, drawing: Drawing): Promise<void> {
  const thing = drawing.selected();
  if (thing === null) return app.announce(t("Select something on the map first."));
  try {
    await drawing.change(thing);
  } catch (error) {
    app.announce(problemOf(error).detail, "error");
  }
}

async function removeSelected(app: App): Promise<void> {
  const selection = app.state.selection.value;
  if (selection?.kind !== "instance") return;
  try {
    const read = await readInstance(app.api, selection.id);
    await remove(app, read, (problem) => app.announce(problem.detail, "error"));
  } catch (error) {
    app.announce(problemOf(error).detail, "error");
  }
}
