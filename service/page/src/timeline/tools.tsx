/** The elements of the timeline. */

import type { ReadonlySignal, Signal } from "@preact/signals";

import type { App, OverlayEvent, TimelineView } from "../app";
import { Icon } from "../chrome/icons";
import type { MapModel } from "../map/model";
import type { Showing } from "../showing";
import { Divider } from "./divider";
import { LABELS_PX, type Target } from "./painter";
import { durationText, momentText, switchZone, zone } from "./clock";
import { sentenceOf } from "../words";
import { say, t } from "../language/catalogue";

const SPEEDS = [1, 2, 4, 8] as const;

/** What the buttons do to the timeline, and what they show of it. */
export interface TimelineTools extends TimelineView {
  readonly map: MapModel | null;
  readonly found: ReadonlySignal<{ events: readonly OverlayEvent[]; title: string }>;
  readonly hover: ReadonlySignal<{ target: Target; x: number; y: number } | null>;
  readonly speed: Signal<number>;
  /** Goes to the event before or after the moment that is shown. */
  step(direction: 1 | -1): void;
  zoom(factor: number): void;
  /** Shows all that is known to have happened. */
  fit(): Promise<void>;
}

/** The buttons above the rows, the canvas and what is under the pointer there. */
export function Tools({ app, showing, timeline }: { app: App; showing: Showing; timeline: TimelineTools }) {
  const { state } = app;
  const playing = showing.playing.value;
  const at = state.at.value;
  const shown = at ?? state.newest.value;
  const { from, to } = state.span.value;
  const isThere = state.newest.value !== null;
  void showing.beat.value;
  return (
    <>
      <Divider />
      <div class="time-tools">
        <button
          class="icon"
          aria-label={t("The event before")}
          title={t("The event before (Page ↑)")}
          disabled={!isThere}
          onClick={() => timeline.step(-1)}
        >
          <Icon name="before" />
        </button>
        <button
          class="icon"
          id="play"
          aria-label={playing === null ? t("Play") : t("Pause")}
          title={t("Play or pause (Space)")}
          disabled={!isThere}
          onClick={() => (playing === null ? showing.play(timeline.speed.value) : showing.pause())}
        >
          <Icon name={playing === null ? "play" : "pause"} />
        </button>
        <button
          class="icon"
          aria-label={t("The event after")}
          title={t("The event after (Page ↓)")}
          disabled={!isThere}
          onClick={() => timeline.step(1)}
        >
          <Icon name="after" />
        </button>
        <select
          aria-label={t("Speed")}
          value={timeline.speed.value}
          onChange={(event) => {
            timeline.speed.value = Number(event.currentTarget.value);
            if (showing.playing.value !== null) showing.play(timeline.speed.value);
          }}
        >
          {SPEEDS.map((speed) => (
            <option key={speed} value={speed}>
              {speed}×
            </option>
          ))}
        </select>
        <output class="number moment" id="shown-moment">
          {shown === null ? t("nothing has happened yet") : momentText(shown)}
        </output>
        <button
          id="zone"
          aria-pressed={zone.value === "utc"}
          title={t("Times in UTC, or by the clock of this machine")}
          onClick={switchZone}
        >
          UTC
        </button>
        {at !== null && (
          <button class="primary" id="go-live" onClick={() => app.moveTo(null)} title={t("Back to live (L)")}>
            {t("Live")}
          </button>
        )}
        <span class="grow" />
        {timeline.found.value.events.length > 0 && (
          <button
            class="chip found"
            title={t("Remove from the timeline")}
            onClick={() => timeline.overlay([])}
          >
            ◇ {timeline.found.value.title} ({timeline.found.value.events.length}) ✕
          </button>
        )}
        {showing.isHistoryUnread.value && (
          <span class="soft" role="status" id="unread-time">
            {t("grey: not read yet")}
          </span>
        )}
        {showing.history.hasMore && <span class="soft">{t("more than is shown: zoom in")}</span>}
        <span class="soft number span-length">{durationText(to - from)}</span>
        <button class="icon" aria-label={t("Shorter time")} onClick={() => timeline.zoom(1.6)}>
          <Icon name="plus" />
        </button>
        <button class="icon" aria-label={t("Longer time")} onClick={() => timeline.zoom(1 / 1.6)}>
          <Icon name="minus" />
        </button>
        <button class="icon" aria-label={t("All of the time")} onClick={() => void timeline.fit()}>
          <Icon name="all" />
        </button>
      </div>
      <div class="time-canvas">
        <canvas
          id="timeline"
          tabIndex={0}
          role="slider"
          aria-label={t("Moment that is shown")}
          aria-valuemin={Math.round(from / 1000)}
          aria-valuemax={Math.round(to / 1000)}
          aria-valuenow={Math.round((shown ?? to) / 1000)}
          aria-valuetext={
            shown === null
              ? t("nothing has happened yet")
              : at === null
                ? t("live, {0}", momentText(shown))
                : momentText(shown)
          }
        />
        <Hovered timeline={timeline} />
      </div>
    </>
  );
}

function Hovered({ timeline }: { timeline: TimelineTools }) {
  const hover = timeline.hover.value;
  if (!hover) return null;
  const { target, x, y } = hover;
  const isRight = x > LABELS_PX + 300;
  return (
    <div
      class="hover-card"
      style={{
        transform: `translate(${isRight ? x - 12 : x + 14}px, ${y + 12}px) translate(${isRight ? "-100%" : "0"}, ${y > 110 ? "calc(-100% - 24px)" : "0"})`,
      }}
    >
      {target.kind === "stay" ? (
        <>
          <b>{target.stay.name}</b>{" "}
          <span class="soft">
            {say(
              "in {0}{1}",
              target.row.label,
              target.stay.to === null ? "" : t(" for {0}", durationText(target.stay.to - target.stay.from)),
            )}
          </span>
        </>
      ) : (
        <>
          <b>{sentenceOf(target.event, timeline.map)}</b>
          {target.kind === "event" && target.count > 1 && (
            <span class="soft"> {say("and {0} more", target.count - 1)}</span>
          )}
          <div class="soft number">{momentText(Date.parse(target.event.stamp))}</div>
        </>
      )}
    </div>
  );
}
