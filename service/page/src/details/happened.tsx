/** The newest events that are found by words, and the way to all of them. */

import type { EventPage } from "../documents";
import { path } from "../api";
import type { App } from "../app";
import { EVERYTHING } from "../events/filter";
import { openEvent } from "../events/open";
import { Roving } from "../panel/roving";
import { momentText } from "../timeline/clock";
import { sentenceOf } from "../words";
import { Failed } from "./parts";
import { useReading } from "./reading";
import { t } from "../language/catalogue";

const MOST = 5;

export function Happened({ app, wanted }: { app: App; wanted: string }) {
  const map = app.state.mapName.value!;
  const query = new URLSearchParams({ text: wanted, limit: `${MOST}` });
  const reading = useReading<EventPage>(app.api, path`/maps/${map}/events` + `?${query}`);
  if (reading.state === "loading") return null;
  if (reading.state === "failed") return <Failed problem={reading.problem} />;
  const { events, next } = reading.value;
  if (events.length === 0) return null;
  const showAll = (): void => {
    app.state.eventFilter.value = { ...EVERYTHING, text: wanted };
    app.state.tab.value = "events";
  };
  return (
    <section>
      <h3>{t("What happened")}</h3>
      <Roving class="list" isOrdered>
        {events.map((each) => (
          <li key={each.event_id}>
            <button class="link" onClick={() => openEvent(app, each)}>
              {sentenceOf(each, app.state.map.value)}
            </button>
            <span class="soft number">{momentText(Date.parse(each.stamp))}</span>
          </li>
        ))}
      </Roving>
      {next !== null && <button onClick={showAll}>{t("All of these events")}</button>}
    </section>
  );
}
