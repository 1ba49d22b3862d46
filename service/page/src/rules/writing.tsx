import { useEffect, useRef, useState } from "preact/hooks";

import type { Problem, RuleCheck, RuleDocument } from "../documents";
import type { App } from "../app";
import { ask } from "../panel/ask";
import { ProblemNote, problemOf } from "../panel/problem";
import { useResource } from "../panel/resource";
import { momentText } from "../timeline/clock";
import { addRule, changeRule, listVersions, readRule, readText, readWords } from "./api";
import { useCheck, type Checked } from "./check";
import { Diagram } from "./diagram";
import { DryRun } from "./dry_run";
import { Editor, FaultLine } from "./editor";
import { Notify } from "./notify";
import { Sentence } from "./sentence";
import { madeBy } from "./text";
import { say, t } from "../language/catalogue";

/** What is written: a new rule, or a rule as it was read. */
export type Subject = { rule: null } | { rule: RuleDocument; etag: string | null; text: string };

interface WritingProps {
  app: App;
  map: string;
  subject: Subject;
  /** Says whether something is written that was not saved. */
  isDirty: { current: boolean };
  /** It is done, or was given up. */
  close: () => void;
}

export function Writing({ app, map, subject, isDirty, close }: WritingProps) {
  const { rule } = subject;
  const [text, setText] = useState(rule === null ? "" : subject.text);
  const checked = useCheck(app, map, text, rule?.id ?? null);
  const { value: words } = useResource((signal) => readWords(app.api, map, signal), [map]);
  // While a text is being checked, what is drawn of the one before stays.
  const last = useRef<RuleCheck | null>(null);
  if (checked.check !== null || checked.problem !== null || text.trim() === "") last.current = checked.check;
  const settled = last.current;
  isDirty.current = text.trim() !== (rule === null ? "" : subject.text.trim());
  useEffect(() => () => void (isDirty.current = false), []);
  const leave = async (): Promise<void> => {
    if (!isDirty.current || (await mayLeave())) close();
  };
  return (
    <div class="stack">
      <div class="row">
        <h2>{rule === null ? t("A new rule") : rule.name}</h2>
        <span class="grow" />
        <button type="button" onClick={() => void leave()}>
          {t("Back")}
        </button>
      </div>
      {rule !== null && <Versions app={app} rule={rule} use={setText} />}
      <Sentence app={app} words={words} text={text} set={setText} check={checked.check} />
      <h3>{t("As text (YAML)")}</h3>
      <Editor
        text={text}
        set={setText}
        fault={checked.check?.fault ?? null}
        describedBy="rule-verdict"
        words={words}
      />
      <Verdict text={text} checked={checked} />
      {settled && <Diagram check={settled} />}
      <DryRun
        app={app}
        map={map}
        name={settled?.name ?? "dry_run"}
        declaration={settled?.declaration ?? null}
      />
      <Saving app={app} map={map} subject={subject} checked={checked} setText={setText} done={close} />
    </div>
  );
}

/** Asks whether what is written may be lost. */
export async function mayLeave(): Promise<boolean> {
  const chosen = await ask({
    title: t("Leave without saving?"),
    text: t("What you have written is lost."),
    choices: [{ value: "leave", label: t("Leave"), isDanger: true }],
  });
  return chosen !== null;
}

function Verdict({ text, checked: { check, problem } }: { text: string; checked: Checked }) {
  if (problem) return <ProblemNote problem={problem} />;
  if (text.trim() === "")
    return (
      <p id="rule-verdict" class="soft">
        {t("Choose a sentence, or write.")}
      </p>
    );
  const fault = check?.fault ?? null;
  return (
    <div
      id="rule-verdict"
      class={check === null ? "note" : fault === null ? "note good" : "note bad"}
      role="status"
    >
      {check === null && <p>{t("Checking…")}</p>}
      {check !== null && fault === null && (
        <p>{say("Right. It makes {0}.", madeBy(check.declaration ?? {}).join(", "))}</p>
      )}
      {fault && <FaultLine fault={fault} text={text} />}
    </div>
  );
}

function Versions({ app, rule, use }: { app: App; rule: RuleDocument; use: (text: string) => void }) {
  const { value } = useResource((signal) => listVersions(app.api, rule.id, signal), [rule.id]);
  const load = async (version: number): Promise<void> => {
    try {
      use(await readText(app.api, rule.id, version));
    } catch (error) {
      app.announce(problemOf(error).detail, "error");
    }
  };
  if (value === null || value.length < 2) return null;
  return (
    <label class="field">
      <span>{t("Versions")}</span>
      <select defaultValue={rule.version} onChange={(event) => void load(Number(event.currentTarget.value))}>
        {[...value].reverse().map(({ version, declared_at }) => (
          <option key={version} value={version}>
            {version}: {momentText(Date.parse(declared_at))}
            {version === rule.version ? t(" (in force)") : ""}
          </option>
        ))}
      </select>
    </label>
  );
}

interface SavingProps {
  app: App;
  map: string;
  subject: Subject;
  checked: Checked;
  setText: (text: string) => void;
  done: () => void;
}

function Saving({ app, map, subject, checked, setText, done }: SavingProps) {
  const [backfill, setBackfill] = useState("");
  const [problem, setProblem] = useState<Problem | null>(null);
  const [isSending, setSending] = useState(false);
  const [overtaken, setOvertaken] = useState<Subject | null>(null);
  const [etag, setEtag] = useState(subject.rule === null ? null : subject.etag);
  const { rule } = subject;
  const right = checked.check?.fault === null ? checked.check : null;
  const save = async (): Promise<void> => {
    if (right?.name == null || right.declaration === null) return;
    const from = backfill === "" ? null : backfill;
    setSending(true);
    setProblem(null);
    try {
      if (rule === null) await addRule(app.api, map, right.name, right.declaration, from);
      else {
        const declaration = { name: right.name, ...right.declaration };
        await changeRule(app.api, rule.id, { enabled: true, declaration, backfill_from: from }, etag);
      }
      app.announce(t("The rule {0} is on.", right.name));
      done();
    } catch (error) {
      const told = problemOf(error);
      if (told.status === 412 && rule !== null) setOvertaken(await readRule(app.api, rule.id));
      else setProblem(told);
    } finally {
      setSending(false);
    }
  };
  return (
    <>
      {overtaken?.rule && (
        <div class="note warn stack" role="alert">
          <p>{say("{0} Now it is:", <strong>{t("Somebody else changed this rule meanwhile.")}</strong>)}</p>
          <pre class="lines">{overtaken.text}</pre>
          <p class="row">
            <button
              type="button"
              onClick={() => {
                setText(overtaken.text);
                setEtag(overtaken.etag);
                setOvertaken(null);
              }}
            >
              {t("Go on with that")}
            </button>
            <button
              type="button"
              onClick={() => {
                setEtag(overtaken.etag);
                setOvertaken(null);
              }}
            >
              {t("Keep mine")}
            </button>
          </p>
        </div>
      )}
      <label class="field">
        <span>{t("It makes events of")}</span>
        <select value={backfill} onChange={(event) => setBackfill(event.currentTarget.value)}>
          <option value="">{t("what happens from now on")}</option>
          <option value="all">{t("all that is stored, and what happens from now on")}</option>
        </select>
      </label>
      {problem && <ProblemNote problem={problem} />}
      <div class="row">
        <Notify map={map} types={madeBy(right?.declaration ?? {})} />
        <button
          type="button"
          class="primary"
          disabled={right === null || isSending || overtaken !== null}
          onClick={() => void save()}
        >
          {rule === null ? t("Add and turn on") : t("Replace and turn on")}
        </button>
      </div>
    </>
  );
}
