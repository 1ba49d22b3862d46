/** Keys that work anywhere on the page, except while something is typed. */

import type { App } from "../app";
import type { Showing } from "../showing";
import type { Tab } from "../state";
import { EDIT_KEYS } from "../edit/keys";
import type { Stage } from "../scene/stage";
import { isHelpOpen } from "./head";
import { isSideOpen } from "./side";
import { toggleTheme } from "./theme";
import { t } from "../language/catalogue";
import { tourAt } from "../welcome/tour";

/** Keys and what they do, as the help lists them. */
export const KEYS: readonly [string[], string][] = [
  [["?"], t("These keys")],
  [["V"], t("Plan or 3D")],
  [["0"], t("Show all of the map")],
  [["+", "−"], t("Nearer, farther (on the map or the timeline, whichever is focused)")],
  [["←", "→", "↑", "↓"], t("On the map: move it; with Shift in 3D: turn it")],
  [["←", "→"], t("On the timeline: back and forth in time; with Shift ten times as far")],
  [[t("Page ↑"), t("Page ↓")], t("On the timeline: the event before, the event after")],
  [[t("Space")], t("Play the past, or pause")],
  [["L"], t("Back to live")],
  [["1", "…", "6"], t("The panels: details, events, edit, rules, queries, import")],
  [["/"], t("Find on the map, or among the events where they are listed")],
  [["P"], t("Open or close the panels")],
  [["D"], t("Light or dark")],
  [[t("Esc")], t("Select nothing; leave a tool")],
  ...EDIT_KEYS,
];

const PANELS: readonly Tab[] = ["details", "events", "edit", "rules", "queries", "import"];

export function startKeys(app: App, showing: Showing, stage: Stage): void {
  addEventListener("keydown", (event) => {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target))
      return;
    if (document.querySelector("dialog[open]")) return;
    const panel = PANELS[Number(event.key) - 1];
    if (panel) {
      isSideOpen.value = true;
      app.state.tab.value = panel;
      document.getElementById(`tab-${panel}`)?.focus();
    } else if (event.key === "?") isHelpOpen.value = true;
    else if (event.key === "v") app.state.view.value = app.state.view.value === "plan" ? "space" : "plan";
    else if (event.key === "0") stage.fit();
    else if (event.key === "l") app.moveTo(null);
    else if (event.key === "/") find(app);
    else if (event.key === "p") isSideOpen.value = !isSideOpen.value;
    else if (event.key === "d") toggleTheme();
    else if (event.key === "Escape") leave(app);
    else if (event.key === " " && !isControl(event.target)) {
      if (showing.playing.value === null) showing.play(1);
      else showing.pause();
    } else return;
    event.preventDefault();
  });
}

/** Leaves the tour, wherever the focus is; without one, selects nothing. */
function leave({ state }: App): void {
  if (tourAt.value !== null) tourAt.value = null;
  else state.selection.value = null;
}

/** Goes to the field of what is found on the map; among the events, to that of the events. */
function find({ state }: App): void {
  isSideOpen.value = true;
  if (state.tab.value !== "events") {
    state.tab.value = "details";
    state.selection.value = null;
  }
  // What is chosen here is drawn before the next frame.
  requestAnimationFrame(() => {
    const field = document.querySelector<HTMLInputElement>(`#panel-${state.tab.value} input[type=search]`);
    field?.focus();
    field?.select();
  });
}

function isTyping(target: EventTarget | null): boolean {
  if (!(target instanceof HTMLElement)) return false;
  if (target instanceof HTMLInputElement)
    return !["checkbox", "radio", "range", "button"].includes(target.type);
  return (
    target instanceof HTMLTextAreaElement || target instanceof HTMLSelectElement || target.isContentEditable
  );
}

/** Space is theirs. */
function isControl(target: EventTarget | null): boolean {
  return target instanceof HTMLElement && target.closest("button, a, input, summary, [role=tab]") !== null;
}
