/** What lies on the picture: legend, buttons, what is under the pointer, and words where there is no picture. */

import { useEffect, useState } from "preact/hooks";

import type { App } from "../app";
import type { Connection } from "../state";
import type { Showing } from "../showing";
import { OCCUPANCY_STEPS } from "../scene/colours";
import type { Stage } from "../scene/stage";
import { durationText } from "../timeline/clock";
import { askAgain, UNANSWERED } from "../unanswered";
import { SampleBanner, Welcome } from "../welcome/welcome";
import { isSignInOpen } from "./head";
import { Icon } from "./icons";

export function StageChrome({ app, showing, stage }: { app: App; showing: Showing; stage: Stage }) {
  const { state } = app;
  const connection = state.connection.value;
  return (
    <>
      <div class="stage-tools" role="group" aria-label="Zoom">
        <button class="icon" aria-label="Nearer" onClick={() => stage.zoom(1.4)}>
          <Icon name="plus" />
        </button>
        <button class="icon" aria-label="Farther" onClick={() => stage.zoom(1 / 1.4)}>
          <Icon name="minus" />
        </button>
        <button class="icon" aria-label="Show all of the map" title="All (0)" onClick={() => stage.fit()}>
          <Icon name="all" />
        </button>
      </div>
      <div class="banners">
        {connection.state === "disconnected" && <Disconnected connection={connection} showing={showing} />}
        <UnreadMoment app={app} />
        <SampleBanner />
      </div>
      <Word app={app} showing={showing} />
      {state.map.value && <Legend />}
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
        No connection for {durationText(Math.max(0, now - connection.since))};{" "}
        {wait_s > 0 ? `trying again in ${wait_s} s` : "trying again"}
      </span>
      <button onClick={() => showing.retryNow()}>Try now</button>
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
        ? "Reading this moment …"
        : `How it was at this moment could not be read. ${willRetry ? "It is read again as soon as the service answers." : `${problem.detail} ${problem.remedy}`}`}
      {problem !== null && !willRetry && <button onClick={askAgain}>Try again</button>}
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
        <h2>Sign in to see the map</h2>
        <p class="soft">{state.unauthorised.value.detail}</p>
        <p class="row note-actions">
          <button class="primary" onClick={() => (isSignInOpen.value = true)}>
            Sign in
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
            ? "This token may not do that"
            : problem.status === 0
              ? "No answer"
              : "That did not work"}
        </h2>
        <p>{problem.detail}</p>
        {problem.remedy && <p class="soft">{problem.remedy}</p>}
        <p class="row note-actions">
          <button class="primary" onClick={() => void showing.reloadMaps()}>
            Try again
          </button>
          {state.map.value && <button onClick={() => (state.problem.value = null)}>Dismiss</button>}
        </p>
      </div>
    );
  }
  if (state.maps.value?.length === 0) return <Welcome app={app} />;
  if (state.mapName.value !== null && state.map.value === null) {
    return (
      <div class="stage-note" role="status">
        Reading the map {state.mapName.value} …
      </div>
    );
  }
  if (state.map.value?.things.length === 0) {
    return (
      <div class="stage-note">
        <h2>This map is empty</h2>
        <p class="row note-actions">
          <button onClick={() => (state.tab.value = "edit")}>Draw a room</button>
          <button onClick={() => (state.tab.value = "import")}>Import a file</button>
        </p>
      </div>
    );
  }
  return null;
}

export function NoGraphics() {
  return (
    <div class="stage-note" role="alert">
      <h2>No WebGL</h2>
      <p>
        This browser draws no 3D graphics (WebGL 2), which the map needs. Turn on hardware acceleration, or
        use another browser.
      </p>
    </div>
  );
}

function Legend() {
  return (
    <details class="legend">
      <summary>
        <span>People in a room</span>
        <span class="swatches">
          {OCCUPANCY_STEPS.map((least, i) => (
            <i key={least} class={`occupancy-${least}`}>
              {i === OCCUPANCY_STEPS.length - 1 ? `${least}+` : least === 3 ? "3–4" : least}
            </i>
          ))}
        </span>
      </summary>
      <dl>
        <dt>
          <svg width="26" height="20" viewBox="-10 -10 26 20" aria-hidden="true">
            <ellipse rx="10" ry="8" class="legend-uncertain" />
            <path d="M3 -4.5 12 0 3 4.5Z" class="legend-person" />
            <circle r="5" class="legend-person" />
          </svg>
        </dt>
        <dd>who, heading; within the ellipse at 95 %</dd>
        <dt>
          <DoorSign d="M3 17V3 M3 3A14 14 0 0 1 17 17" state="open" />
          <DoorSign d="M3 17 12 6 M12 6A14 14 0 0 1 17 17" state="moving" />
          <DoorSign d="M3 17H17" state="closed" />
          <DoorSign d="M3 17h3m2 0h3m2 0h3" state="unknown" />
        </dt>
        <dd>door open, moving, closed, not known</dd>
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
    const count = app.state.occupancy.value.get(thing.id) ?? 0;
    more =
      thing.kind !== "room"
        ? (door?.state ?? thing.concept)
        : app.state.isKnown.value
          ? `${count} in it`
          : "not known";
  } else if (selection.kind === "track") {
    const mover = (app.state.isLive.value ? showing.now : showing.then).movers.get(selection.id);
    if (!mover) return null;
    name = mover.state.name;
    more = mover.state.speed_mps === null ? "" : `${mover.state.speed_mps.toFixed(1)} m/s`;
  }
  return (
    <div class="hover-card" style={{ transform: `translate(${x_px + 14}px, ${y_px + 14}px)` }}>
      <b>{name}</b> <span class="soft">{more}</span>
    </div>
  );
}
