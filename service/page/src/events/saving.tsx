/** Saves all events that are wanted, also those that were not read yet. */

import { useSignal } from "@preact/signals";

import type { EventDocument } from "../documents";
import type { App } from "../app";
import { csvOf, saveCsv } from "../panel/csv";
import { stampText } from "../timeline/clock";
import { problemOf } from "../unanswered";
import { sentenceOf } from "../words";
import type { EventSearch } from "./search";
import { say, t } from "../language/catalogue";

const HEAD = [
  "stamp",
  "what",
  "type",
  "person",
  "place",
  "rule",
  "confidence",
  "verdict",
  "measures",
  "event_id",
];

export function Saving({ app, search }: { app: App; search: EventSearch }) {
  const saving = useSignal<{ count: number; stop: AbortController } | null>(null);
  const save = async (): Promise<void> => {
    const stop = new AbortController();
    saving.value = { count: 0, stop };
    try {
      const found = await search.all((count) => (saving.value = { count, stop }), stop.signal);
      saveCsv(
        `${app.state.mapName.peek()}_events`,
        csvOf(
          HEAD,
          found.map((each) => rowOf(each, app)),
        ),
      );
    } catch (error) {
      if (!stop.signal.aborted) {
        const { detail, remedy } = problemOf(error);
        app.announce(`${detail} ${remedy}`, "error");
      }
    } finally {
      saving.value = null;
    }
  };
  if (saving.value === null) return <button onClick={() => void save()}>{t("Save as CSV")}</button>;
  const { count, stop } = saving.value;
  return (
    <>
      <span class="soft" role="status">
        {say("{0} read …", count)}
      </span>
      <button onClick={() => stop.abort()}>{t("Stop")}</button>
    </>
  );
}

function rowOf(event: EventDocument, app: App): unknown[] {
  return [
    stampText(Date.parse(event.stamp)),
    sentenceOf(event, app.state.map.peek()),
    event.type,
    event.track?.name,
    event.instance?.name,
    event.rule,
    event.confidence,
    event.verdict,
    JSON.stringify(event.measures),
    event.event_id,
  ];
}
