import { signal } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";

import type { InstanceDocument, Problem } from "../documents";
import type { Answer } from "../api";
import type { App } from "../app";
import type { Storey, Thing } from "../map/model";
import { ask } from "../panel/ask";
import { ProblemNote, problemOf } from "../panel/problem";
import { useResource } from "../panel/resource";
import type { ConceptChoice } from "./concepts";
import { isConflict, type Drawing } from "./drawing";
import { changesOf, faultsIn, fieldsOf, LABELS, overtaken, type Edits, type Fields } from "./fields";
import { changeInstance, deleteInstance, readInstance, type Carried } from "./writes";
import { say, t } from "../language/catalogue";

interface InstanceFormProps {
  app: App;
  drawing: Drawing;
  id: number;
  concepts: readonly ConceptChoice[];
  isUndoing: boolean;
}

const isDeleting = signal(false);

export function InstanceForm({ app, drawing, id, concepts, isUndoing }: InstanceFormProps) {
  const map = app.state.map.value;
  const thing = map?.byId.get(id) ?? null;
  const isGone = map !== null && thing === null;
  // What is being taken away here would be read in vain, which the browser tells as an error.
  const isWanted = !isGone && !isUndoing && !isDeleting.value;
  const { value, problem, reload } = useResource(
    (signal) => readInstance(app.api, id, signal),
    [id],
    isWanted,
  );
  if (isGone) return <p class="soft">{t("It is no longer on the map.")}</p>;
  if (value === null) {
    return problem ? <ProblemNote problem={problem} retry={reload} /> : <p class="soft">{t("Loading…")}</p>;
  }
  return (
    <Loaded
      key={id}
      app={app}
      drawing={drawing}
      read={value}
      thing={thing}
      storeys={map?.storeys ?? []}
      concepts={concepts}
      reload={reload}
    />
  );
}

interface LoadedProps {
  app: App;
  drawing: Drawing;
  read: Answer<InstanceDocument>;
  thing: Thing | null;
  storeys: readonly Storey[];
  concepts: readonly ConceptChoice[];
  reload: () => void;
}

function Loaded({ app, drawing, read, thing, storeys, concepts, reload }: LoadedProps) {
  const [edits, setEdits] = useState<Edits>({});
  const [refused, setRefused] = useState<Edits | null>(null);
  const [problem, setProblem] = useState<Problem | null>(null);
  const [isSending, setSending] = useState(false);
  const map = app.state.map.value;
  // What others changed is seen at once, and not only when a change is refused.
  useEffect(() => {
    if (thing !== null) reload();
  }, [map]);

  const instance = read.body;
  const seen = useRef(instance);
  useEffect(() => {
    if (overtaken(edits, seen.current, instance)) {
      setRefused(edits);
      setEdits({});
    }
    seen.current = instance;
  }, [read.etag]);
  const fields: Fields = { ...fieldsOf(instance), ...edits };
  const faults = faultsIn(edits);
  const changes = changesOf(instance, edits);
  const hasChanges = Object.keys(changes).length > 0;
  const set = (key: keyof Fields, value: string): void => setEdits((before) => ({ ...before, [key]: value }));

  const send = async (): Promise<void> => {
    if (!hasChanges || Object.keys(faults).length > 0) return;
    setSending(true);
    setProblem(null);
    try {
      const message = `change ${instance.name}: ${Object.keys(changes).join(", ")}`;
      await changeInstance(app.api, instance.id, changes, read.etag, message);
      setEdits({});
      setRefused(null);
      app.announce(t("{0} is changed.", fields.name.trim()));
      await app.reloadMap();
    } catch (error) {
      if (isConflict(error)) {
        setRefused(edits);
        setEdits({});
        await app.reloadMap();
      } else setProblem(problemOf(error));
    } finally {
      setSending(false);
    }
    reload();
  };

  return (
    <form
      class="stack"
      aria-label={t("Edit {0}", instance.name)}
      onSubmit={(event) => {
        event.preventDefault();
        void send();
      }}
    >
      {refused && (
        <Conflict
          refused={refused}
          now={fieldsOf(instance)}
          again={() => {
            setEdits(refused);
            setRefused(null);
          }}
          leave={() => setRefused(null)}
        />
      )}
      <Text name="name" fields={fields} faults={faults} set={set} />
      <Text name="alias" fields={fields} faults={faults} set={set} />
      <label class="field">
        <span>{LABELS.concept}</span>
        <ConceptSelect value={fields.concept} concepts={concepts} set={(value) => set("concept", value)} />
      </label>
      {storeys.length > 0 && (
        <label class="field">
          <span>{LABELS.storey}</span>
          <select value={fields.storey} onChange={(event) => set("storey", event.currentTarget.value)}>
            <option value="">{t("none")}</option>
            {storeys.map(({ name }) => (
              <option key={name} value={name}>
                {name}
              </option>
            ))}
          </select>
        </label>
      )}
      {instance.footprint && (
        <div class="pair">
          <Text name="elevation_m" fields={fields} faults={faults} set={set} />
          <Text name="height_m" fields={fields} faults={faults} set={set} />
        </div>
      )}
      {thing?.kind === "door" && <DoorFields fields={fields} faults={faults} set={set} />}
      {problem && <ProblemNote problem={problem} />}
      <div class="row">
        <button
          type="submit"
          class="primary"
          disabled={!hasChanges || isSending || Object.keys(faults).length > 0}
        >
          {t("Save")}
        </button>
        {hasChanges && (
          <button type="button" onClick={() => setEdits({})}>
            {t("Discard")}
          </button>
        )}
        <span class="grow" />
        {thing && (
          <button
            type="button"
            title="M"
            onClick={() => drawing.change(thing).catch((error: unknown) => setProblem(problemOf(error)))}
          >
            {t("Move or reshape")}
          </button>
        )}
        <button type="button" class="danger" onClick={() => void remove(app, read, setProblem)}>
          {t("Delete")}
        </button>
      </div>
    </form>
  );
}

interface TextProps {
  name: keyof Fields;
  fields: Fields;
  faults: Partial<Record<keyof Fields, string>>;
  set: (key: keyof Fields, value: string) => void;
  hint?: string;
}

function Text({ name, fields, faults, set, hint }: TextProps) {
  const fault = faults[name];
  const isNumber = name.endsWith("_m");
  return (
    <label class="field">
      <span>{LABELS[name]}</span>
      <input
        value={fields[name]}
        maxLength={name === "joins" ? 10_000 : 200}
        {...(isNumber && { inputMode: "decimal" as const })}
        {...(fault !== undefined && { "aria-invalid": true })}
        onInput={(event) => set(name, event.currentTarget.value)}
      />
      {(fault ?? hint) && <small class={fault ? "fault" : "soft"}>{fault ?? hint}</small>}
    </label>
  );
}

function DoorFields({ fields, faults, set }: Omit<TextProps, "name">) {
  return (
    <>
      <Text
        name="joins"
        fields={fields}
        faults={faults}
        set={set}
        hint={t("Their names, with commas between.")}
      />
      <LeafSelect value={fields.leaf} set={(value) => set("leaf", value)} />
    </>
  );
}

/** Which side of a door's leaf has the hinge, or that it has no leaf. */
export function LeafSelect({ value, set }: { value: string; set: (value: string) => void }) {
  return (
    <label class="field">
      <span>{LABELS.leaf}</span>
      <select value={value} onChange={(event) => set(event.currentTarget.value)}>
        <option value="">{t("none: an opening")}</option>
        <option value="left">{t("hinge on the left")}</option>
        <option value="right">{t("hinge on the right")}</option>
      </select>
    </label>
  );
}

interface ConceptSelectProps {
  value: string;
  concepts: readonly ConceptChoice[];
  set: (value: string) => void;
}

export function ConceptSelect({ value, concepts, set }: ConceptSelectProps) {
  return (
    <select value={value} onChange={(event) => set(event.currentTarget.value)}>
      {!concepts.some((each) => each.name === value) && <option value={value}>{value}</option>}
      {concepts.map(({ name, depth }) => (
        <option key={name} value={name}>
          {"\u2003".repeat(depth)}
          {name}
        </option>
      ))}
    </select>
  );
}

interface ConflictProps {
  refused: Edits;
  now: Fields;
  again: () => void;
  leave: () => void;
}

/** Somebody else was faster: the newest is in the form, and one's own is offered again. */
function Conflict({ refused, now, again, leave }: ConflictProps) {
  const keys = Object.keys(refused) as (keyof Fields)[];
  return (
    <div class="note warn stack" role="alert">
      <p>
        {say(
          "{0} The form shows what it is now; yours was not saved:",
          <strong>{t("Somebody else changed it meanwhile.")}</strong>,
        )}
      </p>
      <ul>
        {keys.map((key) => (
          <li key={key}>{say("{0}: yours “{1}”, now “{2}”", LABELS[key], refused[key], now[key])}</li>
        ))}
      </ul>
      <p class="row">
        <button type="button" onClick={again}>
          {t("Put mine in again")}
        </button>
        <button type="button" class="plain" onClick={leave}>
          {t("Leave it")}
        </button>
      </p>
    </div>
  );
}

/** Asks first, and again where other things stand on it. */
export async function remove(
  app: App,
  read: Answer<InstanceDocument>,
  tell: (problem: Problem) => void,
): Promise<void> {
  const { name } = read.body;
  const chosen = await ask({
    title: t("Delete {0}?", name),
    text: t("Who is in it counts as having left. You can undo this."),
    choices: [{ value: "refuse" as Carried, label: t("Delete"), isDanger: true }],
  });
  if (chosen !== null) await removeWith(app, read, chosen, tell);
}

async function removeWith(
  app: App,
  read: Answer<InstanceDocument>,
  carried: Carried,
  tell: (problem: Problem) => void,
) {
  isDeleting.value = true;
  try {
    await deleteInstance(app.api, read.body, read.etag, carried);
    app.state.selection.value = null;
    app.announce(t("{0} is deleted.", read.body.name));
    await app.reloadMap();
  } catch (error) {
    isDeleting.value = false;
    const problem = problemOf(error);
    if (problem.status !== 409 || carried !== "refuse") {
      if (isConflict(error)) await app.reloadMap();
      return tell(problem);
    }
    const chosen = await ask<Carried>({
      title: t("Things stand on {0}", read.body.name),
      text: problem.detail,
      choices: [
        { value: "keep", label: t("Keep them in their place") },
        { value: "delete", label: t("Delete them too"), isDanger: true },
      ],
    });
    if (chosen !== null) await removeWith(app, read, chosen, tell);
  } finally {
    isDeleting.value = false;
  }
}
