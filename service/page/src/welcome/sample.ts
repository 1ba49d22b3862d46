/** Plays the sample as if it happened now: a building is imported, and its people and doors are told as they move. */

import { signal } from "@preact/signals";

import type { App } from "../app";
import { path } from "../api";
import { problemOf } from "../unanswered";
import { t } from "../language/catalogue";

export const SAMPLE = "sample";

const TOLD_EACH_MS = 300;
const SOURCE = { people: "sample people", doors: "sample doors" } as const;

/** Whether it is being played by this page. */
export const isPlaying = signal(false);

let stop = new AbortController();

export function stopSample(): void {
  stop.abort();
}

/** Ends when all is told or it is stopped; everybody has left then. */
export async function playSample(app: App): Promise<void> {
  if (isPlaying.peek()) return;
  isPlaying.value = true;
  stop = new AbortController();
  try {
    const data = await import("./sample_data");
    if (!app.state.maps.peek()?.some((each) => each.name === SAMPLE)) {
      const body = new FormData();
      body.set("file", new File([data.office], "office.geojson"));
      await app.api.send("POST", `/maps/import?name=${SAMPLE}`, { body, message: "the sample" });
    }
    await app.reloadMaps(SAMPLE);
    app.moveTo(null);
    await tell(app, rowsOf(data.walk), rowsOf(data.doors));
    app.announce(t("The sample is over: everybody has left."));
  } catch (error) {
    const { detail, remedy } = problemOf(error);
    app.announce(t("The sample could not be played. {0} {1}", detail, remedy), "error");
  } finally {
    isPlaying.value = false;
  }
}

export type Row = Readonly<Record<string, string>>;

async function tell(app: App, walk: readonly Row[], doors: readonly Row[]): Promise<void> {
  const begun = Date.now();
  const first = Date.parse(walk[0]!["stamp"]!);
  const nowOf = (row: Row): number => begun + Date.parse(row["stamp"]!) - first;
  const last = new Map<string, Row>();
  let [people, states] = [0, 0];
  while (people < walk.length && !stop.signal.aborted) {
    const now = Date.now();
    const moved = walk.slice(people).filter((row) => nowOf(row) <= now);
    const turned = doors.slice(states).filter((row) => nowOf(row) <= now);
    people += moved.length;
    states += turned.length;
    for (const row of moved) last.set(row["track"]!, row);
    if (turned.length > 0)
      await app.api.send("POST", "/object-states", {
        body: {
          map: SAMPLE,
          source: SOURCE.doors,
          states: turned.map((row) => ({ ...row, stamp: new Date(nowOf(row)).toISOString() })),
        },
      });
    if (moved.length > 0)
      await send(
        app,
        moved.map((row) => stateOf(row, nowOf(row))),
        now,
      );
    await new Promise((resolve) => setTimeout(resolve, TOLD_EACH_MS));
  }
  const now = Date.now();
  await send(
    app,
    [...last.values()].map((row) => ({ ...stateOf(row, now), is_last: true })),
    now,
  );
}

async function send(app: App, states: readonly object[], until: number): Promise<void> {
  const body = { source: SOURCE.people, watermark: new Date(until).toISOString(), states };
  await app.api.send("POST", path`/maps/${SAMPLE}/states`, { body });
}

function stateOf(row: Row, stamp: number): object {
  const { track, x_m, y_m, std_m } = row;
  return {
    track,
    stamp: new Date(stamp).toISOString(),
    x_m: Number(x_m),
    y_m: Number(y_m),
    std_m: Number(std_m),
  };
}

/** Of CSV without quotes. */
export function rowsOf(csv: string): Row[] {
  const [head = "", ...lines] = csv.trim().split(/\r?\n/);
  const names = head.split(",");
  return lines.map((line) => Object.fromEntries(line.split(",").map((cell, i) => [names[i]!, cell])));
}
