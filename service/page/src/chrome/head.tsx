/** The head of the page: which map and storey, plan or space, how the page stands with the service. */

import { signal } from "@preact/signals";

import type { App } from "../app";
import type { Showing } from "../showing";
import { momentText } from "../timeline/scale";
import { Icon } from "./icons";
import { theme, toggleTheme } from "./theme";

export const isSideOpen = signal(true);
export const isHelpOpen = signal(false);
export const isSignInOpen = signal(false);

export function Head({ app, showing }: { app: App; showing: Showing }) {
  const { state } = app;
  const maps = state.maps.value ?? [];
  const storeys = state.map.value?.storeys ?? [];
  return (
    <>
      <h1 class="brand">
        <img src="/page/icon.svg" width="26" height="26" alt="" />
        semap
      </h1>
      {maps.length > 0 && (
        <select
          id="map-choice"
          aria-label="Map"
          value={state.mapName.value ?? ""}
          onChange={(event) => showing.showMap(event.currentTarget.value)}
        >
          {maps.map(({ name }) => (
            <option key={name} value={name}>
              {name}
            </option>
          ))}
        </select>
      )}
      {storeys.length > 1 && (
        <select
          id="storey-choice"
          aria-label="Storey"
          value={state.storey.value ?? ""}
          onChange={(event) => (state.storey.value = event.currentTarget.value || null)}
        >
          <option value="">all storeys</option>
          {storeys.toReversed().map(({ name }) => (
            <option key={name} value={name}>
              {name}
            </option>
          ))}
        </select>
      )}
      <div class="segmented" role="group" aria-label="View">
        <button
          id="view-plan"
          aria-pressed={state.view.value === "plan"}
          onClick={() => (state.view.value = "plan")}
        >
          Plan
        </button>
        <button
          id="view-space"
          aria-pressed={state.view.value === "space"}
          onClick={() => (state.view.value = "space")}
        >
          3D
        </button>
      </div>
      <span class="grow" />
      <Status app={app} />
      <button
        class="icon plain"
        aria-label={theme.value === "dark" ? "Light colours" : "Dark colours"}
        title="Light or dark (D)"
        onClick={toggleTheme}
      >
        <Icon name={theme.value === "dark" ? "sun" : "moon"} />
      </button>
      {(app.api.token !== null || state.unauthorised.value !== null) && (
        <button class="plain" id="sign-in" onClick={() => (isSignInOpen.value = true)}>
          {state.unauthorised.value ? "Sign in" : "Token"}
        </button>
      )}
      <button
        class="icon plain"
        aria-label="Keys and help"
        title="Keys and help (?)"
        onClick={() => (isHelpOpen.value = true)}
      >
        <Icon name="help" />
      </button>
      <button
        class="icon plain"
        aria-label={isSideOpen.value ? "Close the panels" : "Open the panels"}
        aria-expanded={isSideOpen.value}
        aria-controls="side"
        title="Panels (P)"
        onClick={() => (isSideOpen.value = !isSideOpen.value)}
      >
        <Icon name={isSideOpen.value ? "close" : "open"} />
      </button>
    </>
  );
}

function Status({ app }: { app: App }) {
  const connection = app.state.connection.value;
  const at = app.state.at.value;
  const newest = app.state.newest.value;
  if (connection.state === "disconnected") {
    return (
      <span class="status disconnected" id="status" data-state="disconnected">
        Disconnected
      </span>
    );
  }
  if (at !== null) {
    return (
      <span class="status past" id="status" data-state="past">
        <span class="number">{momentText(at)}</span>
      </span>
    );
  }
  if (app.state.unauthorised.value) return null;
  if (app.state.mapName.value === null || connection.state === "loading") {
    if (app.state.maps.value !== null && app.state.mapName.value === null) return null;
    return (
      <span class="status loading" id="status" data-state="loading">
        Loading
      </span>
    );
  }
  return (
    <span
      class="status live"
      id="status"
      data-state={connection.resumed ? "resumed" : "live"}
      title={newest === null ? "Nothing has moved yet" : `Newest: ${momentText(newest)}`}
    >
      {connection.resumed ? "Live again" : "Live"}
    </span>
  );
}
