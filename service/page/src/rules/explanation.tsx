import { useState } from "preact/hooks";

import type { Problem, RuleDocument } from "../documents";
import type { App } from "../app";
import { ProblemNote, problemOf } from "../panel/problem";
import { stampText, withClock } from "../timeline/clock";
import { explain } from "./api";
import { keyOf } from "./text";
import { t } from "../language/catalogue";

/** Why a rule found something around a moment, or how far it came and which condition failed. */
export function Explanation({ app, rule, close }: { app: App; rule: RuleDocument; close: () => void }) {
  const names = keyOf(rule.declaration);
  const selection = app.state.selection.value;
  const event = selection?.kind === "event" && selection.event.rule === rule.name ? selection.event : null;
  const [at, setAt] = useState(() => stampText(momentOf(app, event?.stamp)));
  const [key, setKey] = useState<Record<string, string>>(() =>
    Object.fromEntries(
      names.map((name) => [name, event?.key[name] === undefined ? "" : String(event.key[name])]),
    ),
  );
  const [found, setFound] = useState<{ found: boolean; lines: string[] } | null>(null);
  const [problem, setProblem] = useState<Problem | null>(null);
  const moment = Date.parse(at);
  const isReady = Number.isFinite(moment) && names.every((name) => key[name]?.trim());
  const run = async (): Promise<void> => {
    setProblem(null);
    try {
      setFound(
        await explain(
          app.api,
          rule.id,
          moment,
          names.map((name) => `${name}=${key[name]?.trim() ?? ""}`),
        ),
      );
    } catch (error) {
      setFound(null);
      setProblem(problemOf(error));
    }
  };
  return (
    <form
      class="stack"
      aria-label={t("Explain {0}", rule.name)}
      onSubmit={(submitted) => {
        submitted.preventDefault();
        if (isReady) void run();
      }}
    >
      <label class="field">
        <span>{t("Around the moment")}</span>
        <input
          value={at}
          aria-invalid={!Number.isFinite(moment)}
          onInput={(typed) => setAt(typed.currentTarget.value)}
        />
      </label>
      {names.map((name) => (
        <label key={name} class="field">
          <span>{name}</span>
          <input
            value={key[name]}
            list={name === "room" ? "rooms-of-map" : undefined}
            onInput={(typed) => setKey({ ...key, [name]: typed.currentTarget.value })}
          />
        </label>
      ))}
      <datalist id="rooms-of-map">
        {app.state.map.value?.things
          .filter((thing) => thing.kind === "room")
          .map((thing) => (
            <option key={thing.id} value={thing.name} />
          ))}
      </datalist>
      {problem && <ProblemNote problem={problem} />}
      {found && (
        <pre class={found.found ? "note good lines" : "note warn lines"}>
          {withClock(found.lines.join("\n"))}
        </pre>
      )}
      <div class="row">
        <button type="submit" class="primary" disabled={!isReady}>
          {t("Explain")}
        </button>
        <button type="button" onClick={close}>
          {t("Close")}
        </button>
      </div>
    </form>
  );
}

function momentOf(app: App, stamp: string | undefined): number {
  return stamp === undefined
    ? (app.state.at.value ?? app.state.newest.value ?? Date.now())
    : Date.parse(stamp);
}
