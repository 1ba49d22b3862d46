import { useEffect, useRef, useState } from "preact/hooks";

import type { Problem, RuleCheck, RuleTemplate, RuleWords, TemplateParameter } from "../documents";
import type { App } from "../app";
import { ProblemNote, problemOf } from "../panel/problem";
import { useResource } from "../panel/resource";
import { fillTemplate, listTemplates } from "./api";
import { durationOf, freeName, listed, partsOf, UNITS, type Unit } from "./phrase";
import { say, t } from "../language/catalogue";

type Values = Readonly<Record<string, string>>;

interface Chosen {
  template: string;
  values: Values;
}

interface SentenceProps {
  app: App;
  words: RuleWords | null;
  text: string;
  set: (text: string) => void;
  /** Of the text as it is; null while that is not known. */
  check: RuleCheck | null;
}

/** A rule as a sentence with gaps: what is chosen there is written as text, and what is written is said here. */
export function Sentence({ app, words, text, set, check }: SentenceProps) {
  const { value: templates, problem, reload } = useResource((signal) => listTemplates(app.api, signal), []);
  const [chosen, setChosen] = useState<Chosen | null>(null);
  const [refused, setRefused] = useState<Problem | null>(null);
  /** What the sentence wrote last, which need not be read back. */
  const written = useRef<{ text: string; chosen: Chosen } | null>(null);
  const writing = useRef<AbortController | null>(null);
  const like = check?.like ?? null;
  const giveUp = (): void => {
    writing.current?.abort();
    writing.current = null;
  };
  useEffect(() => giveUp, []);
  useEffect(() => {
    if (text === written.current?.text) return;
    giveUp();
    setRefused(null);
  }, [text]);
  useEffect(() => {
    if (writing.current !== null) return;
    if (text === written.current?.text) {
      // What came of an earlier text may have taken it away after it was chosen.
      setChosen(written.current.chosen);
      return;
    }
    // A sentence beside a text that is wrong would say something else than the text.
    if (text.trim() === "" || check?.fault) setChosen(null);
    if (like !== null) setChosen(like.values && { template: like.template, values: like.values });
  }, [text, check]);
  const write = async (template: string, values: Values): Promise<void> => {
    giveUp();
    const stop = (writing.current = new AbortController());
    setChosen({ template, values });
    setRefused(null);
    try {
      const filled = await fillTemplate(app.api, template, values, stop.signal);
      if (stop.signal.aborted) return;
      written.current = { text: filled, chosen: { template, values } };
      set(filled);
    } catch (error) {
      if (!stop.signal.aborted) setRefused(problemOf(error));
    } finally {
      if (writing.current === stop) writing.current = null;
    }
  };
  const begin = (name: string): void => {
    const template = templates?.find((each) => each.name === name);
    if (template) void write(name, firstValues(template, words));
  };
  if (problem) return <ProblemNote problem={problem} retry={reload} />;
  const template = templates?.find((each) => each.name === chosen?.template);
  return (
    <section class="stack" aria-label={t("The rule as a sentence")}>
      <label class="field">
        <span>{t("Tell me when …")}</span>
        <select value={chosen?.template ?? ""} onChange={(event) => begin(event.currentTarget.value)}>
          <option value="" disabled={chosen !== null}>
            {text.trim() === "" ? t("choose what it is about…") : t("no sentence: it is as the text says")}
          </option>
          {templates?.map((each) => (
            <option key={each.name} value={each.name}>
              {each.title}
            </option>
          ))}
        </select>
      </label>
      {chosen && template && (
        <Gaps
          app={app}
          template={template}
          values={chosen.values}
          words={words}
          set={(values) => void write(template.name, values)}
        />
      )}
      {refused && <ProblemNote problem={refused} />}
      {chosen === null && check?.fault && like === null && (
        <p class="soft">{t("It is a sentence again, where there is one, as soon as the text is right.")}</p>
      )}
      {chosen === null && like !== null && <Unsaid templates={templates} like={like} />}
    </section>
  );
}

/** Why there is no sentence for a rule. */
function Unsaid({
  templates,
  like,
}: {
  templates: RuleTemplate[] | null;
  like: NonNullable<RuleCheck["like"]>;
}) {
  const likest = templates?.find((each) => each.name === like.template);
  if (likest === undefined) return null;
  return (
    <p class="note" id="unsaid">
      {say(
        "No sentence says this rule: the likest, “{0}”, has another {1}. It stays as the text says.",
        likest.title,
        <strong>{listed(like.differs.map((each) => each.replaceAll("_", " ")))}</strong>,
      )}
    </p>
  );
}

function firstValues(template: RuleTemplate, words: RuleWords | null): Values {
  return Object.fromEntries(
    template.parameters.map(({ name, default: value }) => [
      name,
      name === "name" ? freeName(value, words?.rule ?? []) : value,
    ]),
  );
}

interface GapsProps {
  app: App;
  template: RuleTemplate;
  values: Values;
  words: RuleWords | null;
  set: (values: Values) => void;
}

function Gaps({ app, template, values, words, set }: GapsProps) {
  const of = new Map(template.parameters.map((each) => [each.name, each]));
  const inPhrase = partsOf(template.phrase).filter((_, i) => i % 2 === 1);
  const gap = (parameter: TemplateParameter) => (
    <Gap
      key={parameter.name}
      app={app}
      parameter={parameter}
      value={values[parameter.name] ?? parameter.default}
      words={words}
      set={(value) => set({ ...values, [parameter.name]: value })}
    />
  );
  return (
    <>
      <p class="phrase">
        {partsOf(template.phrase).map((part, i) => (i % 2 === 0 ? part : gap(of.get(part)!)))}
      </p>
      <details>
        <summary>{t("More about it")}</summary>
        <div class="stack">
          <p class="soft">{template.sentence}</p>
          {template.parameters
            .filter(({ name }) => !inPhrase.includes(name))
            .map((parameter) => (
              <label key={parameter.name} class="field">
                <span>{parameter.meaning[0]!.toUpperCase() + parameter.meaning.slice(1)}</span>
                {gap(parameter)}
              </label>
            ))}
        </div>
      </details>
    </>
  );
}

const ANY: Partial<Record<TemplateParameter["kind"], string>> = {
  room: t("any room"),
  person: "somebody",
  door: t("any door"),
};
const NAMED: Partial<Record<TemplateParameter["kind"], string>> = {
  room: t("Room"),
  person: t("Person"),
  door: t("Door"),
  duration: t("Duration"),
  count: t("How many"),
};
/** More names than this are found sooner by typing. */
const MOST_CHOICES = 200;

interface GapProps {
  app: App;
  parameter: TemplateParameter;
  value: string;
  words: RuleWords | null;
  set: (value: string) => void;
}

function Gap({ app, parameter: { name, kind, meaning }, value, words, set }: GapProps) {
  const label =
    name === "from" || name === "to"
      ? name === "from"
        ? t("Room from")
        : t("Room to")
      : (NAMED[kind] ?? meaning);
  if (kind === "duration") return <DurationGap label={label} value={value} set={set} />;
  if (kind === "room" || kind === "person" || kind === "door" || kind === "query") {
    const names = words?.[kind] ?? [];
    if (names.length > MOST_CHOICES)
      return <TypedGap kind={kind} label={label} names={names} value={value} set={set} />;
    const known = value === "" || names.includes(value) ? names : [value, ...names];
    const aliases = new Map(app.state.map.value?.things.map((each) => [each.name, each.alias]));
    return (
      <select aria-label={label} value={value} onChange={(event) => set(event.currentTarget.value)}>
        {kind in ANY && <option value="">{ANY[kind]}</option>}
        {known.map((each) => (
          <option key={each} value={each}>
            {aliases.get(each) ?? each}
          </option>
        ))}
      </select>
    );
  }
  const isNumber = kind === "count" || kind === "distance_m";
  return (
    <input
      aria-label={label}
      value={value}
      class={isNumber ? "short" : ""}
      inputMode={isNumber ? "decimal" : "text"}
      spellcheck={false}
      onInput={(event) => set(event.currentTarget.value)}
    />
  );
}

function TypedGap({
  kind,
  label,
  names,
  value,
  set,
}: {
  kind: TemplateParameter["kind"];
  label: string;
  names: readonly string[];
  value: string;
  set: (value: string) => void;
}) {
  const id = `names-${label.replaceAll(" ", "-")}`;
  return (
    <>
      <input
        aria-label={label}
        list={id}
        value={value}
        placeholder={ANY[kind]}
        onInput={(event) => set(event.currentTarget.value)}
      />
      <datalist id={id}>
        {names.map((each) => (
          <option key={each} value={each} />
        ))}
      </datalist>
    </>
  );
}

function DurationGap({ label, value, set }: { label: string; value: string; set: (value: string) => void }) {
  const { count, unit } = durationOf(value);
  return (
    <span class="nowrap">
      <input
        aria-label={label}
        class="short"
        inputMode="decimal"
        value={count}
        onInput={(event) => set(`${event.currentTarget.value} ${unit}`)}
      />
      <select
        aria-label={t("Unit of {0}", label.toLowerCase())}
        value={unit}
        onChange={(event) => set(`${count} ${event.currentTarget.value as Unit}`)}
      >
        {Object.entries(UNITS).map(([each, name]) => (
          <option key={each} value={each}>
            {name}
          </option>
        ))}
      </select>
    </span>
  );
}
