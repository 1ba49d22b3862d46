import { render } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";

import type { Problem, RuleDocument } from "../documents";
import type { App } from "../app";
import { ask } from "../panel/ask";
import "../panel/panel.css";
import { ProblemNote, problemOf } from "../panel/problem";
import { useResource } from "../panel/resource";
import { changeRule, deleteRule, listRules, readRule } from "./api";
import { Explanation } from "./explanation";
import "./rules.css";
import { Notify } from "./notify";
import { lossOf, madeBy, readBy } from "./text";
import { titleOf } from "../words";
import { mayLeave, Writing, type Subject } from "./writing";
import { say, t } from "../language/catalogue";

/** Puts the panel for rules into its element. */
export function mount(element: HTMLElement, app: App): void {
  render(<Panel app={app} />, element);
}

function Panel({ app }: { app: App }) {
  const map = app.state.mapName.value;
  if (map === null) return <p class="soft">{t("There is no map yet. Bring one in under Import.")}</p>;
  return <Rules key={map} app={app} map={map} />;
}

function Rules({ app, map }: { app: App; map: string }) {
  const [subject, setSubject] = useState<Subject | null>(null);
  const { value, isLoading, problem, reload } = useResource(
    (signal) => listRules(app.api, map, signal),
    [map],
  );
  // Rules are edited elsewhere, too: the list is read again whenever somebody looks at it.
  const isShown = app.state.tab.value === "rules";
  const [wasShown, setWasShown] = useState(isShown);
  if (isShown !== wasShown) {
    setWasShown(isShown);
    if (isShown) reload();
  }
  const isDirty = useRef(false);
  const wanted = app.state.wantedRule.value;
  useEffect(() => {
    if (wanted === null || value === null || isLoading) return;
    app.state.wantedRule.value = null;
    void openWanted(wanted);
  }, [wanted, value, isLoading]);
  const openWanted = async (name: string): Promise<void> => {
    const rule = value?.find((each) => each.name === name);
    if (rule === undefined) return app.announce(t("The rule {0} is no longer there.", name), "error");
    if (subject?.rule?.id === rule.id || (isDirty.current && !(await mayLeave()))) return;
    try {
      setSubject(await readRule(app.api, rule.id));
    } catch (error) {
      app.announce(problemOf(error).detail, "error");
    }
  };
  if (subject !== null) {
    const close = (): void => {
      setSubject(null);
      reload();
    };
    const key = subject.rule?.id ?? "new";
    return <Writing key={key} app={app} map={map} subject={subject} isDirty={isDirty} close={close} />;
  }
  return (
    <div class="stack">
      <div class="row">
        <h2>{t("Rules")}</h2>
        <span class="grow" />
        <button type="button" class="primary" onClick={() => setSubject({ rule: null })}>
          {t("Write a rule")}
        </button>
      </div>
      {problem && <ProblemNote problem={problem} retry={reload} />}
      {value === null && isLoading && <p class="soft">{t("Loading…")}</p>}
      {value?.length === 0 && (
        <p class="empty">{t("No rules on this map. Without one nothing becomes an event.")}</p>
      )}
      <ul class="cards" aria-label={t("Rules")}>
        {value?.map((rule) => (
          <RuleCard key={rule.id} app={app} rule={rule} changed={reload} edit={setSubject} />
        ))}
      </ul>
    </div>
  );
}

interface RuleCardProps {
  app: App;
  rule: RuleDocument;
  changed: () => void;
  edit: (subject: Subject) => void;
}

function RuleCard({ app, rule, changed, edit }: RuleCardProps) {
  const [problem, setProblem] = useState<Problem | null>(null);
  const [isSending, setSending] = useState(false);
  const [isExplaining, setExplaining] = useState(false);
  const send = async (action: () => Promise<unknown>, then: () => void): Promise<void> => {
    setSending(true);
    setProblem(null);
    try {
      await action();
      then();
    } catch (error) {
      setProblem(problemOf(error));
    } finally {
      setSending(false);
    }
  };
  const open = (): Promise<void> =>
    send(
      async () => edit(await readRule(app.api, rule.id)),
      () => {},
    );
  const remove = async (): Promise<void> => {
    const chosen = await ask({
      title: t("Delete the rule {0}?", rule.name),
      text: t("It makes no more events; those that it made stay."),
      choices: [{ value: "delete", label: t("Delete"), isDanger: true }],
    });
    if (chosen !== null) await send(() => deleteRule(app.api, rule.id), changed);
  };
  return (
    <li class="card">
      <header>
        <h3>{rule.name}</h3>
        <span class="soft">{say("version {0}", rule.version)}</span>
        <span class={rule.enabled ? "chip good" : "chip off"}>{rule.enabled ? t("on") : t("off")}</span>
      </header>
      <p class="soft">
        {say(
          "It makes {0} of {1}.",
          <strong>{madeBy(rule.declaration).map(titleOf).join("; ")}</strong>,
          readBy(rule.declaration).map(titleOf).join("; "),
        )}
      </p>
      {rule.given_up && <p class="note warn">{lossOf(rule.given_up)}</p>}
      {problem && <ProblemNote problem={problem} />}
      <div class="row">
        <button
          type="button"
          disabled={isSending}
          aria-label={t("Edit {0}", rule.name)}
          onClick={() => void open()}
        >
          {t("Edit")}
        </button>
        <button
          type="button"
          disabled={isSending}
          aria-label={rule.enabled ? t("Turn off {0}", rule.name) : t("Turn on {0}", rule.name)}
          onClick={() =>
            void send(() => changeRule(app.api, rule.id, { enabled: !rule.enabled }, null), changed)
          }
        >
          {rule.enabled ? t("Turn off") : t("Turn on")}
        </button>
        <button
          type="button"
          aria-expanded={isExplaining}
          aria-label={t("Explain {0}", rule.name)}
          onClick={() => setExplaining(!isExplaining)}
        >
          {t("Explain…")}
        </button>
        <Notify map={rule.map} types={madeBy(rule.declaration)} name={rule.name} />
        <button
          type="button"
          class="danger"
          disabled={isSending}
          aria-label={t("Delete {0}", rule.name)}
          onClick={() => void remove()}
        >
          {t("Delete")}
        </button>
      </div>
      {isExplaining && <Explanation app={app} rule={rule} close={() => setExplaining(false)} />}
    </li>
  );
}
