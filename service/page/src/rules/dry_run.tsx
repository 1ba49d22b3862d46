import { useEffect, useState } from "preact/hooks";

import type { DryRunAnswer, Problem } from "../documents";
import type { App } from "../app";
import { ProblemNote, problemOf } from "../panel/problem";
import type { Span } from "../state";
import { clockText, momentText } from "../timeline/clock";
import { sentenceOf } from "../words";
import { dryRun, type Declaration } from "./api";
import { lossOf } from "./text";
import { say, t } from "../language/catalogue";

const HOUR_MS = 3_600_000;
const LEAST_BESIDE_MS = 10_000;
/** What is shown of a dry run in the panel; the timeline shows all of it. */
const SHOWN = 30;

/** Not every key is worth a run; the check, which comes before, has waited as well. */
const PAUSE_MS = 250;

const SPANS = {
  hour: t("the hour shown"),
  day: t("the day shown"),
  shown: t("all that the timeline shows"),
} as const;
type SpanName = keyof typeof SPANS;

interface DryRunProps {
  app: App;
  map: string;
  name: string;
  /** null while the text is wrong. */
  declaration: Declaration | null;
}

/** What a run found, or why it did not run; null of both: nothing was asked, or it is running. */
interface Run {
  found: DryRunAnswer | null;
  problem: Problem | null;
  over: Span | null;
}

const NOTHING: Run = { found: null, problem: null, over: null };

/**
 * Runs a rule over what is stored while it is written, and draws on the timeline what it would have found;
 * nothing is written. A newer text, or another time that is shown, ends the run of the one before.
 */
export function DryRun({ app, map, name, declaration }: DryRunProps) {
  const [span, setSpan] = useState<SpanName>("hour");
  const [run, setRun] = useState<Run>(NOTHING);
  const [round, setRound] = useState(0);
  const asText = JSON.stringify(declaration);
  useEffect(() => {
    // What another text found would be mistaken for what this one finds.
    app.timeline.overlay([]);
    setRun(NOTHING);
    if (declaration === null) return;
    const stop = new AbortController();
    const send = async (): Promise<void> => {
      const over = spanOf(app, span);
      try {
        const found = await dryRun(app.api, map, name, declaration, over, stop.signal);
        if (stop.signal.aborted) return;
        app.timeline.overlay(found.events, name);
        setRun({ found, problem: null, over });
      } catch (error) {
        if (!stop.signal.aborted) setRun({ found: null, problem: problemOf(error), over });
      }
    };
    const timer = setTimeout(() => void send(), PAUSE_MS);
    return () => {
      clearTimeout(timer);
      stop.abort();
    };
  }, [asText, map, name, span, round]);
  useEffect(() => () => app.timeline.overlay([]), []);
  const again = (): void => setRound((before) => before + 1);
  const shown = app.state.span.value;
  const isElsewhere = run.over !== null && !isNear(spanOf(app, span), run.over);
  // Somebody looks at another time, and rests there.
  useEffect(() => {
    if (!isElsewhere) return;
    const timer = setTimeout(again, PAUSE_MS);
    return () => clearTimeout(timer);
  }, [isElsewhere, shown]);
  const isRunning = declaration !== null && run.found === null && run.problem === null;
  return (
    <section class="stack" aria-label={t("Dry run")}>
      <label class="inline">
        {say(
          "{0} over{1}",
          <strong>{t("Dry run")}</strong>,
          <select value={span} onChange={(event) => setSpan(event.currentTarget.value as SpanName)}>
            {Object.entries(SPANS).map(([key, label]) => (
              <option key={key} value={key}>
                {label}
              </option>
            ))}
          </select>,
        )}
      </label>
      {declaration === null && (
        <p class="soft">{t("What it would have found is shown here as soon as it is right.")}</p>
      )}
      {isRunning && (
        <p class="soft" role="status">
          {t("Running…")}
        </p>
      )}
      {run.problem && <ProblemNote problem={run.problem} retry={again} />}
      {run.found && <Result app={app} found={run.found} over={run.over!} />}
    </section>
  );
}

function Result({ app, found, over }: { app: App; found: DryRunAnswer; over: Span }) {
  const show = (): void => {
    const seen = around(found.events, over);
    app.timeline.show(seen.from, seen.to);
  };
  return (
    <div class="note stack">
      <p class="row line">
        <strong role="status">{told(found.count)}</strong>
        <span class="grow" />
        <button type="button" class="plain" onClick={show}>
          {t("Show on the timeline")}
        </button>
      </p>
      <p class="soft">{say("{0} to {1}", momentText(over.from), momentText(over.to))}</p>
      {found.given_up && <p class="note warn">{lossOf(found.given_up)}</p>}
      <ol class="found">
        {found.events.slice(0, SHOWN).map((event) => (
          <li key={event.event_id}>
            <button type="button" class="plain" onClick={() => app.moveTo(Date.parse(event.stamp))}>
              <time dateTime={event.stamp}>{clockText(Date.parse(event.stamp), 1000)}</time>{" "}
              {sentenceOf(event, app.state.map.value)}
            </button>
          </li>
        ))}
      </ol>
      {found.events.length > SHOWN && <p class="soft">{t("The timeline shows the others.")}</p>}
      {found.count > found.events.length && (
        <p class="soft">{say("Only the first {0} are shown.", found.events.length)}</p>
      )}
    </div>
  );
}

function told(count: number): string {
  return count === 0
    ? t("It would have made no event.")
    : count === 1
      ? t("It would have made 1 event.")
      : t("It would have made {0} events.", count);
}

/** All that was found with some time beside it; where nothing was, all that was searched. */
function around(events: DryRunAnswer["events"], searched: Span): Span {
  const stamps = events.map((event) => Date.parse(event.stamp));
  if (stamps.length === 0) return searched;
  const [from, to] = [Math.min(...stamps), Math.max(...stamps)];
  const beside = Math.max((to - from) * 0.1, LEAST_BESIDE_MS);
  return { from: from - beside, to: to + beside };
}

/** The hour or day that ends with what the timeline shows; of the future nothing is known yet. */
function spanOf(app: App, name: SpanName): Span {
  const shown = app.state.span.peek();
  if (name === "shown") return shown;
  const known = (app.state.newest.peek() ?? Date.now()) + 1000;
  const to = shown.from < known ? Math.min(shown.to, known) : shown.to;
  return { from: to - (name === "hour" ? HOUR_MS : 24 * HOUR_MS), to };
}

/** Whether a run over one of them says as much as one over the other: live, they shift by and by. */
function isNear(one: Span, other: Span): boolean {
  const slack = (other.to - other.from) / 4;
  return Math.abs(one.from - other.from) <= slack && Math.abs(one.to - other.to) <= slack;
}
