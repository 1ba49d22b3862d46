/** The head of the page: which map, plan or space, how the page stands with the service. */

import { signal } from "@preact/signals";
import { useEffect, useState } from "preact/hooks";

import type { App } from "../app";
import type { Showing } from "../showing";
import { agoText, clockText, dateText, momentText } from "../timeline/clock";
import { Icon } from "./icons";
import { isSheet, isSideOpen } from "./side";
import { theme, toggleTheme } from "./theme";
import { say, t } from "../language/catalogue";

const FRESH_MS = 60_000;

export const isHelpOpen = signal(false);
export const isSignInOpen = signal(false);

interface HeadProps {
  app: App;
  showing: Showing;
  copyLink(): void;
}

export function Head({ app, showing, copyLink }: HeadProps) {
  const { state } = app;
  const maps = state.maps.value ?? [];
  return (
    <>
      <h1 class="brand">
        <img src="/page/icon.svg" width="26" height="26" alt="" />
        <span>semap</span>
      </h1>
      {maps.length > 0 && (
        <select
          id="map-choice"
          aria-label={t("Map")}
          value={state.mapName.value ?? ""}
          onChange={(event) => event.currentTarget.value && showing.showMap(event.currentTarget.value)}
        >
          {state.mapName.value === null && <option value="">{t("choose a map")}</option>}
          {maps.map(({ name }) => (
            <option key={name} value={name}>
              {name}
            </option>
          ))}
        </select>
      )}
      <div class="segmented" role="group" aria-label={t("View")}>
        <button
          id="view-plan"
          aria-pressed={state.view.value === "plan"}
          onClick={() => (state.view.value = "plan")}
        >
          {t("Plan")}
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
      <span class="status-place">
        <Status app={app} />
      </span>
      <button
        class="icon plain"
        aria-label={t("Copy a link to what is shown")}
        title={t("Copy a link to what is shown")}
        disabled={state.map.value === null}
        onClick={copyLink}
      >
        <Icon name="link" />
      </button>
      <button
        class="icon plain"
        aria-label={theme.value === "dark" ? t("Light colours") : t("Dark colours")}
        title={t("Light or dark (D)")}
        onClick={toggleTheme}
      >
        <Icon name={theme.value === "dark" ? "sun" : "moon"} />
      </button>
      {(app.api.token !== null || state.unauthorised.value !== null) && (
        <button class="plain" id="sign-in" onClick={() => (isSignInOpen.value = true)}>
          {state.unauthorised.value ? t("Sign in") : t("Token")}
        </button>
      )}
      <button
        class="icon plain"
        aria-label={t("Keys and help")}
        title={t("Keys and help (?)")}
        onClick={() => (isHelpOpen.value = true)}
      >
        <Icon name="help" />
      </button>
      {!isSheet.value && <SideButton />}
    </>
  );
}

/** Opens and closes the panels: in the head, and on a small window beside their tabs. */
export function SideButton() {
  return (
    <button
      class="icon plain side-button"
      aria-label={isSideOpen.value ? t("Close the panels") : t("Open the panels")}
      aria-expanded={isSideOpen.value}
      aria-controls="side"
      title={t("Panels (P)")}
      onClick={() => (isSideOpen.value = !isSideOpen.value)}
    >
      <Icon name={isSideOpen.value ? "close" : "open"} />
    </button>
  );
}

function Status({ app }: { app: App }) {
  const connection = app.state.connection.value;
  const at = app.state.at.value;
  const newest = app.state.newest.value;
  if (connection.state === "disconnected") {
    return (
      <span class="status disconnected" id="status" data-state="disconnected">
        {t("Disconnected")}
      </span>
    );
  }
  if (at !== null) {
    return (
      <span class="status past" id="status" data-state="past">
        <span class="number">
          <span class="date">{dateText(at)}</span> {clockText(at, 100)}
        </span>
      </span>
    );
  }
  if (app.state.unauthorised.value) return null;
  if (app.state.mapName.value === null || connection.state === "loading") {
    if (app.state.maps.value !== null && app.state.mapName.value === null) return null;
    return (
      <span class="status loading" id="status" data-state="loading">
        {t("Loading")}
      </span>
    );
  }
  return (
    <>
      <span
        class={`status ${isFresh(newest) ? "live" : "stale"}`}
        id="status"
        data-state={connection.resumed ? "resumed" : "live"}
      >
        {connection.resumed ? t("Live again") : t("Live")}
      </span>
      <Freshness newest={newest} />
    </>
  );
}

/** How old the newest is that is shown as live: a service may be there, and nothing come from the building. */
function Freshness({ newest }: { newest: number | null }) {
  const [, setTick] = useState(0);
  useEffect(() => {
    const timer = setInterval(() => setTick((before) => before + 1), 1000);
    return () => clearInterval(timer);
  }, []);
  if (newest === null) return <span id="freshness">{t("nothing yet")}</span>;
  return (
    <span id="freshness" title={t("The newest is of {0}", momentText(newest))}>
      {say("newest: {0}", agoText(Date.now() - newest))}
    </span>
  );
}

function isFresh(newest: number | null): boolean {
  return newest !== null && Math.abs(Date.now() - newest) < FRESH_MS;
}
