import { render } from "preact";
import { useState } from "preact/hooks";

import type { Concept, Problem, QueryDocument } from "../documents";
import { allPages, path, type Api } from "../api";
import type { App } from "../app";
import { choicesOf } from "../edit/concepts";
import { ConceptSelect } from "../edit/instance_form";
import { ask } from "../panel/ask";
import "../panel/panel.css";
import { Guarded } from "../panel/guarded";
import { ProblemNote, problemOf } from "../panel/problem";
import { useResource } from "../panel/resource";
import { say, t } from "../language/catalogue";

/** Puts the panel for continuous queries into its element. */
export function mount(element: HTMLElement, app: App): void {
  render(<Panel app={app} />, element);
}

function listQueries(api: Api, map: string, signal: AbortSignal): Promise<QueryDocument[]> {
  return allPages<QueryDocument, "queries">(
    api,
    `/queries?map=${encodeURIComponent(map)}`,
    "queries",
    signal,
  );
}

function Panel({ app }: { app: App }) {
  const map = app.state.mapName.value;
  if (map === null) return <p class="soft">{t("There is no map yet. Bring one in under Import.")}</p>;
  return <Queries key={map} app={app} map={map} />;
}

function Queries({ app, map }: { app: App; map: string }) {
  // Rules and queries are edited elsewhere, too: what is shown is read again whenever somebody looks at it.
  const isShown = app.state.tab.value === "queries";
  const { value, isLoading, problem, reload } = useResource(
    (signal) => listQueries(app.api, map, signal),
    [map],
  );
  const [wasShown, setWasShown] = useState(isShown);
  if (isShown !== wasShown) {
    setWasShown(isShown);
    if (isShown) reload();
  }
  return (
    <div class="stack">
      <p class="soft">
        {t(
          "A query keeps up to date which tracks are in which things of a concept. Rules make events of that.",
        )}
      </p>
      {problem && <ProblemNote problem={problem} retry={reload} />}
      {value === null && isLoading && <p class="soft">{t("Loading…")}</p>}
      {value?.length === 0 && (
        <p class="empty">{t("No queries on this map. Without one nobody is known to be anywhere.")}</p>
      )}
      <Guarded app={app} what={t("Changing queries")}>
        <ul class="cards" aria-label={t("Queries")}>
          {value?.map((query) => (
            <QueryCard key={query.id} app={app} query={query} changed={reload} />
          ))}
        </ul>
        <NewQuery app={app} map={map} made={reload} />
      </Guarded>
    </div>
  );
}

function QueryCard({ app, query, changed }: { app: App; query: QueryDocument; changed: () => void }) {
  const [problem, setProblem] = useState<Problem | null>(null);
  const [isSending, setSending] = useState(false);
  const send = async (action: () => Promise<unknown>): Promise<void> => {
    setSending(true);
    setProblem(null);
    try {
      await action();
    } catch (error) {
      setProblem(problemOf(error));
    } finally {
      setSending(false);
      changed();
    }
  };
  const where = path`/queries/${query.id}`;
  const remove = async (): Promise<void> => {
    const chosen = await ask({
      title: t("Delete the query {0}?", query.name),
      text: t("The relations that it keeps end. A query that a rule reads stays."),
      choices: [{ value: "delete", label: t("Delete"), isDanger: true }],
    });
    if (chosen !== null) await send(() => app.api.send("DELETE", where));
  };
  return (
    <li class="card">
      <header>
        <h3>{query.name}</h3>
        <span class={query.enabled ? "chip good" : "chip off"}>{query.enabled ? t("on") : t("off")}</span>
      </header>
      <p class="soft">{say("tracks that are in a {0}", <strong>{query.concept}</strong>)}</p>
      {problem && <ProblemNote problem={problem} />}
      <div class="row">
        <button
          type="button"
          disabled={isSending}
          aria-label={query.enabled ? t("Turn off {0}", query.name) : t("Turn on {0}", query.name)}
          onClick={() => void send(() => app.api.send("PATCH", where, { body: { enabled: !query.enabled } }))}
        >
          {query.enabled ? t("Turn off") : t("Turn on")}
        </button>
        <button
          type="button"
          class="danger"
          disabled={isSending}
          aria-label={t("Delete {0}", query.name)}
          onClick={() => void remove()}
        >
          {t("Delete")}
        </button>
      </div>
    </li>
  );
}

function NewQuery({ app, map, made }: { app: App; map: string; made: () => void }) {
  const taxonomy = useResource((signal) => app.api.get<{ concepts: Concept[] }>("/concepts", signal), []);
  const [name, setName] = useState("");
  const [concept, setConcept] = useState("Room");
  const [problem, setProblem] = useState<Problem | null>(null);
  const add = async (): Promise<void> => {
    setProblem(null);
    try {
      await app.api.send("POST", "/queries", { body: { map, name: name.trim(), concept } });
      setName("");
      app.announce(t("The query {0} works.", name.trim()));
      made();
    } catch (error) {
      setProblem(problemOf(error));
    }
  };
  return (
    <details>
      <summary>{t("Add a query")}</summary>
      <form
        class="stack"
        aria-label={t("Add a query")}
        onSubmit={(event) => {
          event.preventDefault();
          void add();
        }}
      >
        <label class="field">
          <span>{t("Name")}</span>
          <input
            value={name}
            maxLength={200}
            placeholder={`track_in_${concept.toLowerCase()}`}
            onInput={(event) => setName(event.currentTarget.value)}
          />
        </label>
        <label class="field">
          <span>{t("Concept")}</span>
          <ConceptSelect
            value={concept}
            concepts={choicesOf(taxonomy.value?.concepts ?? [])}
            set={setConcept}
          />
        </label>
        {problem && <ProblemNote problem={problem} />}
        <button type="submit" class="primary" disabled={name.trim() === ""}>
          {t("Add")}
        </button>
      </form>
    </details>
  );
}
