import type { EventDocument } from "../documents";
import type { App } from "../app";

/** Shows an event: its details, and the moment at which it happened. */
export function openEvent(app: App, event: EventDocument): void {
  app.state.selection.value = { kind: "event", event };
  app.state.tab.value = "details";
  app.moveTo(Date.parse(event.stamp));
}
