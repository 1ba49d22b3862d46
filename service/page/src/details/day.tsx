/** A day of somebody, also of one who has left: in which rooms, on which way, where at which moment. */

import { useEffect } from "preact/hooks";

import type { RoomStayList, TrackPath } from "../documents";
import { path } from "../api";
import type { App } from "../app";
import { Roving } from "../panel/roving";
import type { Way } from "../state";
import { clockText, dateText, dayText, durationText, timeText, zone } from "../timeline/clock";
import { dayOf, momentFrom } from "../timeline/day";
import { DayChoice } from "./day_choice";
import { Failed, InstanceLink, nameOf } from "./parts";
import { useReading } from "./reading";
import { Strip } from "./strip";
import { lengthOf, spanOf, staysOf, whereAt, type Day, type Stay } from "./whereabouts";
import { fixed, say, t } from "../language/catalogue";

const MOST_STAYS = 1000;
const S = 1000;

interface Who {
  id: number;
  name: string;
  /** When he was seen last. */
  seen: number;
  app: App;
}

/** because  what it depends on that the day has changed */
export function DayOf({ because, ...who }: Who & { because: readonly unknown[] }) {
  const { id, app, seen } = who;
  const at = app.state.at.value;
  const span = dayOf(at ?? seen);
  const limits = `?from=${new Date(span.from).toISOString()}&to=${new Date(span.to - 1).toISOString()}`;
  const stays = useReading<RoomStayList>(
    app.api,
    path`/tracks/${id}/stays` + `${limits}&limit=${MOST_STAYS}`,
    because,
  );
  const way = useReading<TrackPath>(app.api, path`/tracks/${id}/path` + limits, because);
  const day: Day | null =
    stays.state === "there" && way.state === "there"
      ? {
          stays: staysOf(stays.value.stays, app.state.newest.value ?? seen),
          parts: way.value.parts.map((part) =>
            part.map(([x = 0, y = 0, t_s = 0]) => [x, y, span.from + S * t_s]),
          ),
        }
      : null;
  useWay(who, day, [stays, way, app.state.map.value]);
  return (
    <section aria-label={t("The day")} class="stack">
      <DayChoice app={app} shown={at ?? seen} />
      <TimeField app={app} shown={at ?? seen} />
      {stays.state === "failed" && <Failed problem={stays.problem} />}
      {way.state === "failed" && <Failed problem={way.problem} />}
      {stays.state === "loading" || way.state === "loading" ? (
        <p class="soft">{t("Reading this day …")}</p>
      ) : (
        day && <Told {...who} day={day} isCut={stays.state === "there" && stays.value.more} />
      )}
    </section>
  );
}

function Told({ day, isCut, ...who }: Who & { day: Day; isCut: boolean }) {
  const { app, name } = who;
  const at = app.state.at.value;
  const seen = day.parts.map(spanOf);
  if (seen.length === 0 && day.stays.length === 0)
    return <p class="soft">{say("{0} was not seen on this day.", name)}</p>;
  const bounds = [...seen, ...day.stays];
  const { from, to } = dayOf(at ?? who.seen);
  const span = {
    from: Math.max(from, Math.min(...bounds.map((each) => each.from))),
    to: Math.min(to - 1, Math.max(...bounds.map((each) => each.to))),
  };
  return (
    <>
      {at !== null && (
        <p class="note" id="where-then" role="status">
          {whereText(who, day, at)}
        </p>
      )}
      <Strip app={app} day={day} seen={span} />
      <p class="soft">
        {say(
          "From {0} to {1}, on a way of {2}.",
          timeText(span.from, S),
          clockText(span.to, S),
          distanceText(lengthOf(day.parts)),
        )}
      </p>
      <section aria-label={t("Stays")}>
        {day.stays.length === 0 && (
          <p class="soft">{t("In no room, as far as the queries of this map tell.")}</p>
        )}
        {isCut && <p class="soft">{t("The earlier stays of this day are not shown.")}</p>}
        <Roving class="list stays" isOrdered>
          {day.stays.map((stay) => (
            <StayRow key={`${stay.room} ${stay.from}`} app={app} stay={stay} />
          ))}
        </Roving>
      </section>
    </>
  );
}

function StayRow({ app, stay }: { app: App; stay: Stay }) {
  const { at } = app.state;
  const isShown = at.value !== null && stay.from <= at.value && at.value < stay.to;
  return (
    <li aria-current={isShown ? "time" : undefined}>
      <button class="link number" title={t("Show this moment")} onClick={() => app.moveTo(stay.from)}>
        {timeText(stay.from, S)}–{stay.isOpen ? t("now") : timeText(stay.to, S)}
      </button>
      <InstanceLink app={app} id={stay.room} name={nameOf(app, stay.room, stay.name)} />
      <span class="soft number">{durationText(stay.to - stay.from)}</span>
    </li>
  );
}

/** Answers where somebody was at a time of the day, which is shown as well. */
function TimeField({ app, shown }: { app: App; shown: number }) {
  const { at } = app.state;
  void zone.value;
  return (
    <label class="field">
      <span>{t("Where at")}</span>
      <input
        type="time"
        step={1}
        value={at.value === null ? "" : timeText(at.value, S)}
        onChange={(event) => {
          const moment = momentFrom(dayText(shown), event.currentTarget.value);
          if (moment !== null && moment !== at.peek()) app.moveTo(moment);
        }}
      />
    </label>
  );
}

function whereText({ app, name, seen }: Who, day: Day, at: number): string {
  const then = clockText(at, S);
  const found = whereAt(day, at);
  if (found.kind === "outside") return t("At {0} {1} was in no room.", then, name);
  if (found.kind === "rooms") {
    const rooms = found.stays.map((each) => nameOf(app, each.room, each.name)).join(" and ");
    return t("At {0} {1} was in {2}, since {3}.", then, name, rooms, timeText(found.stays[0]!.from, S));
  }
  if (found.since !== null)
    return t("At {0} {1} was not seen; last before that at {2}.", then, name, timeText(found.since, S));
  return at < seen
    ? t("At {0} {1} was not seen yet on this day.", then, name)
    : t("At {0} {1} was no longer seen; last on {2} at {3}.", then, name, dateText(seen), timeText(seen, S));
}

function distanceText(length_m: number): string {
  return length_m < 1000 ? `${fixed(length_m, 0)} m` : `${fixed(length_m / 1000, 1)} km`;
}

/** Has the way drawn on the map for as long as the day is shown. */
function useWay({ id, app }: Who, day: Day | null, causes: readonly unknown[]): void {
  useEffect(() => {
    if (day === null) return;
    const storeyOf = (moment: number): string | null => {
      const found = whereAt(day, moment);
      return (found.kind === "rooms" && app.state.map.peek()?.byId.get(found.stays[0]!.room)?.storey) || null;
    };
    const way: Way = {
      trackId: id,
      lines: day.parts.flatMap((part) =>
        part.slice(1).map(([x, y, at], i) => ({
          from: [part[i]![0], part[i]![1]] as const,
          to: [x, y] as const,
          storey: storeyOf(at),
        })),
      ),
    };
    app.state.way.value = way;
    return () => {
      if (app.state.way.peek() === way) app.state.way.value = null;
    };
  }, causes);
}
