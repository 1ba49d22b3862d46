/** The newest events of the map, as they come. */

import { render } from "preact";

import type { EventDocument } from "../documents";
import type { App } from "../app";
import { trackColourName } from "../scene/colours";
import { momentText, timeText } from "../timeline/scale";

const SHOWN = 150;

export function mount(element: HTMLElement, app: App): void {
  render(<Events app={app} />, element);
}

function Events({ app }: { app: App }) {
  const events = app.state.events.value;
  const selection = app.state.selection.value;
  if (app.state.map.value === null) return <p class="soft">No map is shown.</p>;
  if (events.length === 0) {
    return (
      <p class="soft">
        Nothing has happened yet. Events come here, and onto the timeline, as rules find them.
      </p>
    );
  }
  return (
    <ol class="events" id="event-list" aria-label="Newest events first">
      {events.slice(0, SHOWN).map((event) => (
        <li key={event.event_id}>
          <button
            aria-pressed={selection?.kind === "event" && selection.event.event_id === event.event_id}
            onClick={() => openEvent(app, event)}
          >
            <time dateTime={event.stamp} title={momentText(Date.parse(event.stamp))} class="number">
              {timeText(Date.parse(event.stamp), 100)}
            </time>
            <span>
              {event.track && (
                <>
                  <i class="dot" style={{ background: trackColourName(event.track.id) }} />
                  {event.track.name}{" "}
                </>
              )}
              <b class={event.cause === null ? "complex" : ""}>{event.type}</b> {event.instance?.name}
            </span>
            {event.verdict === "retracted" && <span class="chip">retracted</span>}
          </button>
        </li>
      ))}
    </ol>
  );
}

/** Shows an event: its details, and the moment at which it happened. */
export function openEvent(app: App, event: EventDocument): void {
  app.state.selection.value = { kind: "event", event };
  app.state.tab.value = "details";
  app.moveTo(Date.parse(event.stamp));
}
