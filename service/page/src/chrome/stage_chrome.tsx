/** What lies on the picture: legend, buttons, what is under the pointer, and words where there is no picture. */

import { useEffect, useState } from "preact/hooks";

import type { App } from "../app";
import type { Connection, Heat, State } from "../state";
import type { Showing } from "../showing";
import { limitsOf } from "../heat/warmth";
import { OCCUPANCY_STEPS } from "../scene/steps";
import type { Stage } from "../scene/stage";
import { durationText } from "../timeline/clock";
import { askAgain, UNANSWERED } from "../unanswered";
import { SampleBanner, Welcome } from "../welcome/welcome";
import { isSignInOpen } from "./head";
import { Icon } from "./icons";
import { Storeys } from "./storeys";
import { fixed, say, t } from "../language/catalogue";
import { doorState } from "../words";

export function StageChrome({ app, showing, stage }: { app: App; showing: Showing; stage: Stage }) {
  const { state } = app;
  const connection = state.connection.value;
  return (
    <>
      <div class="stage-tools" role="group" aria-label={t("Zoom")}>
        <button class="icon" aria-label={t("Nearer")} onClick={() => stage.zoom(1.4)}>
          <Icon name="plus" />
        </button>
        <button class="icon" aria-label={t("Farther")} onClick={() => stage.zoom(1 / 1.4)}>
          <Icon name="minus" />
        </button>
        <button
          class="icon"
          aria-label={t("Show all of the map")}
          title={t("All (0)")}
          onClick={() => stage.fit()}
        >
          <Icon name="all" />
        </button>
      </div>
      <Storeys state={state} showing={showing} />
      <div class="banners">
        {connection.state === "disconnected" && <Disconnected connection={connection} showing={showing} />}
        <UnreadMoment app={app} />
        <SampleBanner />
      </div>
      <Word app={app} showing={showing} />
      {state.map.value && <Legend state={state} />}
      <HoverCard app={app} showing={showing} stage={stage} />
    </>
  );
}

function Disconnected({
  connection,
  showing,
}: {
  connection: Connection & { state: "disconnected" };
  showing: Showing;
}) {
  const [now, setNow] = useState(Date.now());
  useEffect(() => {
    const timer = setInterval(() => setNow(Date.now()), 500);
    return () => clearInterval(timer);
  }, []);
  const wait_s = Math.max(0, Math.ceil((connection.retryAt - now) / 1000));
  return (
    <div class="banner" role="alert">
      <span class="number">
        {say(
          "No connection for {0}; {1}",
          durationText(Math.max(0, now - connection.since)),
          wait_s > 0 ? t("trying again in {0} s", wait_s) : t("trying again"),
        )}
      </span>
      <button onClick={() => showing.retryNow()}>{t("Try now")}</button>
    </div>
  );
}

/** Nothing of the past is made up: what was not read is grey, and this says so. */
function UnreadMoment({ app }: { app: App }) {
  const { at, isKnown, unread, map } = app.state;
  if (at.value === null || isKnown.value || map.value === null) return null;
  const problem = unread.value;
  const willRetry = problem !== null && UNANSWERED.has(problem.status);
  return (
    <div class="banner unread" role="status" id="unread">
      {problem === null
        ? t("Reading this moment …")
        : t(
            "How it was at this moment could not be read. {0}",
            willRetry
              ? t("It is read again as soon as the service answers.")
              : `${problem.detail} ${problem.remedy}`,
          )}
      {problem !== null && !willRetry && <button onClick={askAgain}>{t("Try again")}</button>}
    </div>
  );
}

/** Why there is no picture, and what to do. */
function Word({ app, showing }: { app: App; showing: Showing }) {
  const { state } = app;
  const problem = state.problem.value;
  if (state.unauthorised.value) {
    return (
      <div class="stage-note" role="alert">
        <h2>{t("Sign in to see the map")}</h2>
        <p class="soft">{state.unauthorised.value.detail}</p>
        <p class="row note-actions">
          <button class="primary" onClick={() => (isSignInOpen.value = true)}>
            {t("Sign in")}
          </button>
        </p>
      </div>
    );
  }
  if (problem) {
    return (
      <div class="stage-note" role="alert" id="problem">
        <h2>
          {problem.status === 403
            ? t("This token may not do that")
            : problem.status === 0
              ? t("No answer")
              : t("That did not work")}
        </h2>
        <p>{problem.detail}</p>
        {problem.remedy && <p class="soft">{problem.remedy}</p>}
        <p class="row note-actions">
          <button class="primary" onClick={() => void showing.reloadMaps()}>
            {t("Try again")}
          </button>
          {state.map.value && <button onClick={() => (state.problem.value = null)}>{t("Dismiss")}</button>}
        </p>
      </div>
    );
  }
  if (state.maps.value?.length === 0) return <Welcome app={app} />;
  if (state.mapName.value !== null && state.map.value === null) {
    return (
      <div class="stage-note" role="status">
        {say("Reading the map {0} …", state.mapName.value)}
      </div>
    );
  }
  if (state.map.value?.things.length === 0) {
    return (
      <div class="stage-note">
        <h2>{t("This map is empty")}</h2>
        <p class="row note-actions">
          <button onClick={() => (state.tab.value = "edit")}>{t("Draw a room")}</button>
          <button onClick={() => (state.tab.value = "import")}>{t("Import a file")}</button>
        </p>
      </div>
    );
  }
  return null;
}

export function NoGraphics() {
  return (
    <div class="stage-note" role="alert">
      <h2>{t("No WebGL")}</h2>
      <p>
        {t(
          "This browser draws no 3D graphics (WebGL 2), which the map needs. Turn on hardware acceleration, or use another browser.",
        )}
      </p>
    </div>
  );
}

const STEPS = OCCUPANCY_STEPS.length;
const HEATS: readonly (readonly [Heat, string])[] = [
  ["now", t("people now")],
  ["day", t("hours of the day")],
  ["week", t("hours of the week")],
];

function Legend({ state }: { state: State }) {
  const hours = state.heat.value === "now" ? null : state.hours.value;
  const limits = hours && limitsOf(hours);
  const said = (least: number, i: number): string | number => {
    if (limits) return i === 0 ? 0 : fixed(limits[i]!, limits[STEPS - 1]! < 10 ? 1 : 0);
    return i === STEPS - 1 ? `${least}+` : least === 3 ? "3–4" : least;
  };
  return (
    <details class="legend">
      <summary>
        <span>{state.heat.value === "now" ? t("People in a room") : t("Hours that people spent there")}</span>
        <span class="swatches">
          {OCCUPANCY_STEPS.map((least, i) => (
            <i key={least} class={`occupancy-${least}`}>
              {said(least, i)}
            </i>
          ))}
        </span>
      </summary>
      <label class="field">
        <span>{t("Colours of the rooms")}</span>
        <select
          id="heat-choice"
          value={state.heat.value}
          onChange={(event) => (state.heat.value = event.currentTarget.value as Heat)}
        >
          {HEATS.map(([heat, label]) => (
            <option key={heat} value={heat}>
              {label}
            </option>
          ))}
        </select>
      </label>
      {limits?.[STEPS - 1] === 0 && <p class="soft">{t("Nobody was anywhere in that time.")}</p>}
      <dl>
        <dt>
          <svg width="26" height="20" viewBox="-10 -10 26 20" aria-hidden="true">
            <ellipse rx="10" ry="8" class="legend-uncertain" />
            <path d="M3 -4.5 12 0 3 4.5Z" class="legend-person" />
            <circle r="5" class="legend-person" />
          </svg>
        </dt>
        <dd>{t("who, heading; within the ellipse at 95 %")}</dd>
        <dt>
          <DoorSign d="M3 17V3 M3 3A14 14 0 0 1 17 17" state="open" />
          <DoorSign d="M3 17 12 6 M12 6A14 14 0 0 1 17 17" state="moving" />
          <DoorSign d="M3 17H17" state="closed" />
          <DoorSign d="M3 17h3m2 0h3m2 0h3" state="unknown" />
        </dt>
        <dd>{t("door open, moving, closed, not known")}</dd>
      </dl>
    </details>
  );
}

function DoorSign({ d, state }: { d: string; state: string }) {
  return (
    <svg width="19" height="20" viewBox="0 0 20 20" aria-hidden="true">
      <path d={d} class={`legend-door ${state}`} />
    </svg>
  );
}

function HoverCard({ app, showing, stage }: { app: App; showing: Showing; stage: Stage }) {
  const hover = stage.hover.value;
  if (!hover) return null;
  const { selection, x_px, y_px } = hover;
  let name = "";
  let more = "";
  if (selection.kind === "instance") {
    const thing = app.state.map.value?.byId.get(selection.id);
    if (!thing) return null;
    name = thing.alias ?? thing.name;
    const door = (app.state.isLive.value ? showing.now : showing.then).doors.get(thing.id);
    more = thing.kind === "room" ? inRoom(app.state, thing.id) : door ? doorState(door.state) : thing.concept;
  } else if (selection.kind === "track") {
    const mover = (app.state.isLive.value ? showing.now : showing.then).movers.get(selection.id);
    if (!mover) return null;
    name = mover.state.name;
    more = mover.state.speed_mps === null ? "" : `${fixed(mover.state.speed_mps, 1)} m/s`;
  }
  return (
    <div class="hover-card" style={{ transform: `translate(${x_px + 14}px, ${y_px + 14}px)` }}>
      <b>{name}</b> <span class="soft">{more}</span>
    </div>
  );
}

/** How many are in a room, or how many hours people spent there, as its colour tells. */
function inRoom({ heat, hours, isKnown, occupancy }: State, id: number): string {
  if (heat.value !== "now") {
    const spent = hours.value?.get(id);
    return spent === undefined ? t("Being read …") : t("{0} h", fixed(spent, 1));
  }
  return isKnown.value ? t("{0} in it", occupancy.value.get(id) ?? 0) : t("not known");
}
