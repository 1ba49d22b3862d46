/** How a room is used: how many were in it over a day or a month, when most, how long, and who. */

import { useState } from "preact/hooks";

import type { OccupancyDocument } from "../documents";
import { path } from "../api";
import type { App } from "../app";
import { csvOf, saveCsv } from "../panel/csv";
import { Roving } from "../panel/roving";
import { dateText, dayText, durationText, stampText, timeText, zone } from "../timeline/clock";
import { dayOf, monthOf } from "../timeline/day";
import { DayChoice } from "./day_choice";
import { Facts, Failed, Moment, TrackLink } from "./parts";
import { useReading } from "./reading";
import { fixed, say, t } from "../language/catalogue";

const S = 1000;
const EACH = { day: "hour", month: "day" } as const;

type Length = keyof typeof EACH;

export function RoomUse({ id, app }: { id: number; app: App }) {
  const [length, setLength] = useState<Length>("day");
  const { at, newest } = app.state;
  void zone.value;
  const shown = at.value ?? newest.value;
  const span = shown === null ? null : length === "day" ? dayOf(shown) : monthOf(shown);
  const asked =
    span &&
    new URLSearchParams({
      from: new Date(span.from).toISOString(),
      to: new Date(span.to).toISOString(),
      each: EACH[length],
      zone: zone.value === "utc" ? "UTC" : Intl.DateTimeFormat().resolvedOptions().timeZone,
    });
  // Now it changes as people come and go; of what is over only with the map.
  const because = [app.state.isLive.value && app.state.occupancy.value.get(id), app.state.map.value];
  const reading = useReading<OccupancyDocument>(
    app.api,
    asked && path`/rooms/${id}/occupancy` + `?${asked.toString()}`,
    because,
  );
  if (shown === null) return null;
  return (
    <section aria-label={t("Use")} class="stack">
      <h3>{length === "day" ? t("Over the day") : t("Over the month")}</h3>
      <div class="row" role="group" aria-label={t("Shown")}>
        {(["day", "month"] as const).map((each) => (
          <button key={each} aria-pressed={each === length} onClick={() => setLength(each)}>
            {each === "day" ? t("Day") : t("Month")}
          </button>
        ))}
      </div>
      <DayChoice app={app} shown={shown} />
      {reading.state === "failed" && <Failed problem={reading.problem} />}
      {reading.state === "loading" && (
        <p class="soft">{length === "day" ? t("Reading this day …") : t("Reading this month …")}</p>
      )}
      {reading.state === "there" && <Use app={app} use={reading.value} length={length} />}
    </section>
  );
}

function Use({ app, use, length }: { app: App; use: OccupancyDocument; length: Length }) {
  const most = Math.max(...use.spans.map((each) => each.peak));
  if (most === 0) return <p class="soft">{t("Nobody was in it.")}</p>;
  const peak = use.spans.find((each) => each.peak === most)!;
  // What is to come is no time without people.
  const known = Math.max(Date.now(), app.state.newest.value ?? 0);
  const past = use.spans.filter((each) => Date.parse(each.since) <= known);
  const past_s = past.reduce((sum, each) => sum + lengthOf(each), 0);
  const mean = past.reduce((sum, each) => sum + each.mean * lengthOf(each), 0) / past_s;
  return (
    <>
      <Bars app={app} use={use} most={most} length={length} />
      <Facts
        facts={[
          [t("Most"), <PeakLink app={app} most={most} at={peak.peak_at!} />],
          [t("On average"), fixed(mean, mean < 10 ? 2 : 0)],
          [t("People"), String(use.tracks)],
          [
            t("Stays"),
            t(
              "{0}, half of them up to {1}, the longest {2}",
              use.stays,
              durationText(S * use.median_s!),
              durationText(S * use.longest_s!),
            ),
          ],
        ]}
      />
      <section aria-label={t("Who was in it")}>
        <h4>{t("Who was in it longest")}</h4>
        <Roving class="list" isOrdered>
          {use.visitors.map((each) => (
            <li key={each.track_id}>
              <TrackLink app={app} id={each.track_id} name={each.name} />
              <span class="soft number">
                {durationText(S * each.total_s)}
                {each.stays > 1 && t(", {0} times", each.stays)}
              </span>
            </li>
          ))}
        </Roving>
      </section>
      <div class="row">
        <button onClick={() => save(use)}>{t("Save as CSV")}</button>
      </div>
    </>
  );
}

function PeakLink({ app, most, at }: { app: App; most: number; at: string }) {
  return <>{say("{0} from {1}", most, <Moment app={app} stamp={at} />)}</>;
}

/** A bar for each hour or day: the average is filled, the most is a line above it. A click shows when there were most. */
function Bars({
  app,
  use,
  most,
  length,
}: {
  app: App;
  use: OccupancyDocument;
  most: number;
  length: Length;
}) {
  const { spans } = use;
  const show = (event: MouseEvent): void => {
    const box = (event.currentTarget as HTMLElement).getBoundingClientRect();
    const part = (event.clientX - box.left) / box.width;
    const each = spans[Math.min(spans.length - 1, Math.floor(part * spans.length))]!;
    app.moveTo(Date.parse(each.peak_at ?? each.since));
  };
  return (
    <div class="bars">
      <div class="columns" onClick={show} aria-hidden="true">
        {spans.map((each) => (
          <span key={each.since} title={textOf(each, length)}>
            <i class="most" style={{ height: `${(100 * each.peak) / most}%` }} />
            <i class="mean" style={{ height: `${(100 * each.mean) / most}%` }} />
          </span>
        ))}
      </div>
      <div class="ends soft number" aria-hidden="true">
        <span>{whenText(spans[0]!, length)}</span>
        <span>{whenText(spans.at(-1)!, length)}</span>
      </div>
      <details>
        <summary>{length === "day" ? t("Hour by hour") : t("Day by day")}</summary>
        <table class="plain">
          <thead>
            <tr>
              <th>{length === "day" ? t("From") : t("Day")}</th>
              <th>{t("Average")}</th>
              <th>{t("Most")}</th>
              <th>{t("People")}</th>
            </tr>
          </thead>
          <tbody>
            {spans
              .filter((each) => each.peak > 0)
              .map((each) => (
                <tr key={each.since}>
                  <td>{whenText(each, length)}</td>
                  <td class="number">{fixed(each.mean, 2)}</td>
                  <td class="number">{each.peak}</td>
                  <td class="number">{each.tracks}</td>
                </tr>
              ))}
          </tbody>
        </table>
      </details>
    </div>
  );
}

type OccupancySpan = OccupancyDocument["spans"][number];

function whenText(span: OccupancySpan, length: Length): string {
  const since = Date.parse(span.since);
  return length === "day" ? timeText(since, 60 * S) : dateText(since);
}

function textOf(span: OccupancySpan, length: Length): string {
  const when = whenText(span, length);
  if (span.peak === 0) return t("{0}: nobody", when);
  return t(
    "{0}: {1} on average, at most {2}, {3} different",
    when,
    fixed(span.mean, 2),
    span.peak,
    span.tracks,
  );
}

function lengthOf(span: OccupancySpan): number {
  return (Date.parse(span.until) - Date.parse(span.since)) / S;
}

/** Stamps by the clock of the page. */
function save(use: OccupancyDocument): void {
  const rows = use.spans.map((each) => [
    stampText(Date.parse(each.since)),
    stampText(Date.parse(each.until)),
    each.mean.toFixed(4),
    each.peak,
    each.peak_at ? stampText(Date.parse(each.peak_at)) : "",
    each.tracks,
  ]);
  const head = ["since", "until", "mean", "peak", "peak_at", "tracks"];
  saveCsv(`${use.name}_${dayText(Date.parse(use.spans[0]!.since))}`, csvOf(head, rows));
}
