/** What is known of what is selected: an instance, a track or an event; else a list of what there is. */

import "./details.css";

import { render } from "preact";

import type { App } from "../app";
import type { Showing } from "../showing";
import { Contents } from "./contents";
import { EventDetails } from "./event_details";
import { InstanceDetails } from "./instance_details";
import { TrackDetails } from "./track_details";
import { t } from "../language/catalogue";

export function mount(element: HTMLElement, app: App, showing: Showing): void {
  render(<Details app={app} showing={showing} />, element);
}

function Details({ app, showing }: { app: App; showing: Showing }) {
  const selection = app.state.selection.value;
  if (app.state.map.value === null) return <p class="soft">{t("No map is shown.")}</p>;
  if (selection === null) return <Contents app={app} showing={showing} />;
  return (
    <div class="stack">
      <div>
        <button class="plain back" onClick={() => (app.state.selection.value = null)}>
          {t("← all that is on the map")}
        </button>
      </div>
      {selection.kind === "instance" && (
        <InstanceDetails key={selection.id} id={selection.id} app={app} showing={showing} />
      )}
      {selection.kind === "track" && (
        <TrackDetails key={selection.id} id={selection.id} app={app} showing={showing} />
      )}
      {selection.kind === "event" && (
        <EventDetails key={selection.event.event_id} event={selection.event} app={app} />
      )}
    </div>
  );
}
