/** Keys for editing; while a tool is on they lead it instead of the scene. */

import type { App } from "../app";
import type { Point } from "../map/model";
import { t } from "../language/catalogue";

/** For the list of keys that `?` shows. */
export const EDIT_KEYS: readonly [string[], string][] = [
  [["R"], t("Draw a room")],
  [["O"], t("Draw a door")],
  [["M"], t("Move or reshape what is selected")],
  [["Delete"], t("Delete what is selected")],
  [[t("Ctrl Z")], t("Undo your last change of the map")],
  [[t("Ctrl Shift Z")], t("Do it again")],
  [["←", "→", "↑", "↓"], t("While drawing: the crosshair; with Shift further")],
  [["Enter"], t("While drawing: place a corner, or close the outline")],
  [["Backspace"], t("While drawing: take the last corner back")],
];

const ARROWS: Readonly<Record<string, Point>> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
};

/** What keys ask for. */
export interface Commands {
  isDrawing(): boolean;
  drawRoom(): void;
  drawDoor(): void;
  change(): void;
  remove(): void;
  undo(): void;
  redo(): void;
  /** Moves the crosshair by steps of the grid, y up. */
  go(steps: Point): void;
  place(): void;
  back(): void;
  stop(): void;
}

const FURTHER = 10;

export function listenForKeys(app: App, commands: Commands): () => void {
  const heard = (event: KeyboardEvent): void => {
    if (isTyping(event.target) || document.querySelector("dialog[open]") || app.state.map.value === null)
      return;
    const done = event.ctrlKey || event.metaKey ? history(event, commands) : plain(event, app, commands);
    if (!done) return;
    event.preventDefault();
    event.stopPropagation();
  };
  document.addEventListener("keydown", heard, { capture: true });
  return () => document.removeEventListener("keydown", heard, { capture: true });
}

function history(event: KeyboardEvent, commands: Commands): boolean {
  const key = event.key.toLowerCase();
  if (key === "y" || (key === "z" && event.shiftKey)) commands.redo();
  else if (key === "z" && commands.isDrawing()) commands.back();
  else if (key === "z") commands.undo();
  else return false;
  return true;
}

function plain(event: KeyboardEvent, app: App, commands: Commands): boolean {
  if (event.altKey) return false;
  if (commands.isDrawing() && whileDrawing(event, app, commands)) return true;
  switch (event.key) {
    case "r":
    case "R":
      commands.drawRoom();
      return true;
    case "o":
    case "O":
      commands.drawDoor();
      return true;
    case "m":
    case "M":
      commands.change();
      return true;
    case "Delete":
      if (!commands.isDrawing()) commands.remove();
      return true;
    default:
      return false;
  }
}

function whileDrawing(event: KeyboardEvent, app: App, commands: Commands): boolean {
  const arrow = ARROWS[event.key];
  if (event.key === "Escape") commands.stop();
  else if (event.key === "Backspace") commands.back();
  else if (!app.surface.element.contains(document.activeElement) && isControl(event.target)) return false;
  else if (arrow !== undefined)
    commands.go(event.shiftKey ? [arrow[0] * FURTHER, arrow[1] * FURTHER] : arrow);
  else if (event.key === "Enter") commands.place();
  else return false;
  return true;
}

function isTyping(target: EventTarget | null): boolean {
  return (
    target instanceof HTMLElement &&
    target.matches("input:not([type=checkbox],[type=radio]), textarea, select")
  );
}

/** What has keys of its own. */
function isControl(target: EventTarget | null): boolean {
  return (
    target instanceof HTMLElement && target.matches("button, a, input, [role=tab], summary, [role=slider]")
  );
}
