import { effect, signal } from "@preact/signals";
import { render } from "preact";
import { useRef, useState } from "preact/hooks";

import type { FindingDocument, ImportDocument } from "../documents";
import type { App } from "../app";
import "../panel/panel.css";
import { Guarded } from "../panel/guarded";
import { ProblemNote } from "../panel/problem";
import { listenForDrops } from "./drop";
import { hasEnded, Imports, refusalOf, SUFFIXES, type Import } from "./imports";
import "./importing.css";
import { say, t } from "../language/catalogue";

/** Buildings go into the map that is shown, instead of one of their own. */
const intoShown = signal(false);
const isOver = signal(false);

/** Puts the panel for imports into its element, and takes files that are dropped anywhere on the page. */
export function mount(element: HTMLElement, app: App): void {
  const imports = new Imports(app);
  effect(() => {
    // Whoever may see the maps is signed in, where that is needed.
    if (app.state.maps.value !== null) void imports.find();
  });
  const take = (files: readonly File[]): void => {
    app.state.tab.value = "import";
    for (const file of files) {
      const refusal = refusalOf(file.name);
      if (refusal === null) void imports.bringIn(file, intoShown.value ? app.state.mapName.value : null);
      else app.announce(refusal, "error");
    }
  };
  listenForDrops({ over: (over) => (isOver.value = over), drop: take });
  const cover = document.body.appendChild(document.createElement("div"));
  cover.className = "drop-place";
  render(<Cover />, cover);
  render(<Panel app={app} imports={imports} take={take} />, element);
}

function Cover() {
  return isOver.value ? (
    <div class="drop-cover">
      <p>{say("Drop a map or a building: {0}", SUFFIXES.join(", "))}</p>
    </div>
  ) : null;
}

function Panel({
  app,
  imports,
  take,
}: {
  app: App;
  imports: Imports;
  take: (files: readonly File[]) => void;
}) {
  const chosen = useRef<HTMLInputElement>(null);
  const map = app.state.mapName.value;
  return (
    <div class="stack">
      <Guarded app={app} what={t("Importing")} isShared={!intoShown.value}>
        <div class="empty stack">
          <p>
            {say(
              "Drop a file anywhere on this page: a building ({0}) or a whole map (.yaml, or the .zip of an export).",
              SUFFIXES.slice(0, 4).join(", "),
            )}
          </p>
          <p>
            <button type="button" class="primary" onClick={() => chosen.current?.click()}>
              {t("Choose files…")}
            </button>
            <input
              ref={chosen}
              type="file"
              hidden
              multiple
              accept={SUFFIXES.join(",")}
              aria-label={t("Files to import")}
              onChange={(event) => {
                take([...(event.currentTarget.files ?? [])]);
                event.currentTarget.value = "";
              }}
            />
          </p>
        </div>
      </Guarded>
      {map !== null && (
        <label class="field">
          <span>{t("A building goes into")}</span>
          <select
            value={intoShown.value ? "shown" : "own"}
            onChange={(event) => (intoShown.value = event.currentTarget.value === "shown")}
          >
            <option value="own">{t("a map named as the file")}</option>
            <option value="shown">{say("the map {0}", map)}</option>
          </select>
        </label>
      )}
      <ul class="cards" aria-label={t("Imports")} aria-live="polite">
        {imports.list.value.map((each) => (
          <ImportCard key={each.key} found={each} imports={imports} />
        ))}
      </ul>
    </div>
  );
}

function ImportCard({ found, imports }: { found: Import; imports: Imports }) {
  const { job } = found;
  const ended = hasEnded(found);
  return (
    <li class="card">
      <header>
        <h3>{found.file}</h3>
        <button
          type="button"
          class="plain"
          onClick={() => (ended ? imports.forget(found.key) : void imports.cancel(found.key))}
          aria-label={ended ? t("Put away {0}", found.file) : t("Cancel the import of {0}", found.file)}
        >
          {ended ? t("Put away") : t("Cancel")}
        </button>
      </header>
      {!ended && (
        <>
          <progress
            aria-label={t("Import of {0}", found.file)}
            {...(job?.state === "running" && { value: job.progress })}
          />
          <p class="soft">
            {job === null
              ? t("Sending…")
              : job.state === "waiting"
                ? t("Waiting for its turn…")
                : job.message}
          </p>
        </>
      )}
      {found.isCancelled && <p>{t("Cancelled; nothing was brought in.")}</p>}
      {found.problem && <ProblemNote problem={found.problem} />}
      {job?.result && <Brought result={job.result} />}
    </li>
  );
}

function Brought({ result }: { result: ImportDocument }) {
  const counts = Object.entries(result.concepts).map(([concept, count]) => `${count} ${concept}`);
  return (
    <>
      <p>
        <strong>{result.map}</strong>: {counts.join(", ") || t("nothing")}
      </p>
      {result.findings.length > 0 && <Findings findings={result.findings} />}
    </>
  );
}

const FEW = 20;

function Findings({ findings }: { findings: readonly FindingDocument[] }) {
  const [isAll, setAll] = useState(false);
  return (
    <details open={findings.length <= FEW}>
      <summary>{findings.length === 1 ? t("1 finding") : t("{0} findings", findings.length)}</summary>
      <ul class="findings">
        {(isAll ? findings : findings.slice(0, FEW)).map((finding, i) => (
          <li key={i}>
            <span class="chip">{finding.action}</span> <strong>{finding.subject}</strong>: {finding.reason}
          </li>
        ))}
      </ul>
      {!isAll && findings.length > FEW && (
        <button type="button" onClick={() => setAll(true)}>
          {say("Show all {0}", findings.length)}
        </button>
      )}
    </details>
  );
}
