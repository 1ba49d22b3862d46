import { useEffect, useState } from "preact/hooks";

import type { DryRunAnswer, Problem } from "../documents";
import type { App } from "../app";
import { ProblemNote, problemOf } from "../panel/problem";
import type { Span } from "../state";
import { timeText } from "../timeline/scale";
import { dryRun, type Declaration } from "./api";
import { lossOf } from "./text";

const HOUR_MS = 3_600_000;
const LEAST_BESIDE_MS = 10_000;
/** What is shown of a dry run in the panel; the timeline shows all of it. */
const SHOWN = 30;

const SPANS = {
  hour: "the last hour",
  day: "the last day",
  shown: "what the timeline shows",
} as const;
type SpanName = keyof typeof SPANS;

interface DryRunProps {
  app: App;
  map: string;
  name: string;
  /** null while the text is wrong. */
  declaration: Declaration | null;
}

/** Runs a rule over what is stored, and draws on the timeline what it would have found; nothing is written. */
export function DryRun({ app, map, name, declaration }: DryRunProps) {
  const [span, setSpan] = useState<SpanName>("hour");
  const [found, setFound] = useState<DryRunAnswer | null>(null);
  const [problem, setProblem] = useState<Problem | null>(null);
  const [isRunning, setRunning] = useState(false);
  const asText = JSON.stringify(declaration);
  const clear = (): void => {
    app.timeline.overlay([]);
    setFound(null);
  };
  // What another text found would be mistaken for what this one finds.
  useEffect(() => clear(), [asText]);
  useEffect(() => () => app.timeline.overlay([]), []);
  const run = async (): Promise<void> => {
    if (declaration === null) return;
    setRunning(true);
    setProblem(null);
    try {
      const over = spanOf(app, span);
      const made = await dryRun(app.api, map, name, declaration, over);
      setFound(made);
      const seen = around(made.events, over);
      app.timeline.show(seen.from, seen.to);
      app.timeline.overlay(made.events, name);
      app.announce(told(made.count));
    } catch (error) {
      setProblem(problemOf(error));
    } finally {
      setRunning(false);
    }
  };
  return (
    <section class="stack" aria-label="Dry run">
      <div class="row line">
        <button type="button" disabled={declaration === null || isRunning} onClick={() => void run()}>
          {isRunning ? "Running…" : "Dry run"}
        </button>
        <label class="inline">
          over{" "}
          <select value={span} onChange={(event) => setSpan(event.currentTarget.value as SpanName)}>
            {Object.entries(SPANS).map(([key, label]) => (
              <option key={key} value={key}>
                {label}
              </option>
            ))}
          </select>
        </label>
      </div>
      {problem && <ProblemNote problem={problem} retry={() => void run()} />}
      {found && <Result app={app} found={found} clear={clear} />}
    </section>
  );
}

function Result({ app, found, clear }: { app: App; found: DryRunAnswer; clear: () => void }) {
  return (
    <div class="note stack">
      <p class="row line">
        <strong>{told(found.count)}</strong>
        <span class="grow" />
        <button type="button" class="plain" onClick={clear}>
          Clear
        </button>
      </p>
      {found.given_up && <p class="note warn">{lossOf(found.given_up)}</p>}
      <ol class="found">
        {found.events.slice(0, SHOWN).map((event) => (
          <li key={event.event_id}>
            <button type="button" class="plain" onClick={() => app.moveTo(Date.parse(event.stamp))}>
              <time dateTime={event.stamp}>{timeText(Date.parse(event.stamp), 1000)}</time> {event.type}{" "}
              {[event.track?.name, event.instance?.name].filter(Boolean).join(", ")}
            </button>
          </li>
        ))}
      </ol>
      {found.events.length > SHOWN && <p class="soft">The timeline shows the others.</p>}
      {found.count > found.events.length && (
        <p class="soft">Only the first {found.events.length} are shown.</p>
      )}
    </div>
  );
}

function told(count: number): string {
  return count === 0
    ? "It would have made no event."
    : `It would have made ${count} ${count === 1 ? "event" : "events"}.`;
}

/** All that was found with some time beside it; where nothing was, all that was searched. */
function around(events: DryRunAnswer["events"], searched: Span): Span {
  const stamps = events.map((event) => Date.parse(event.stamp));
  if (stamps.length === 0) return searched;
  const [from, to] = [Math.min(...stamps), Math.max(...stamps)];
  const beside = Math.max((to - from) * 0.1, LEAST_BESIDE_MS);
  return { from: from - beside, to: to + beside };
}

/** Event time may be far from this machine's clock: the last hour ends where event time has come to. */
function spanOf(app: App, name: SpanName): Span {
  const to = (app.state.newest.value ?? Date.now()) + 1000;
  if (name === "shown") return app.state.span.value;
  return { from: to - (name === "hour" ? HOUR_MS : 24 * HOUR_MS), to };
}
