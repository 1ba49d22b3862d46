import { useState } from "preact/hooks";

import { ProblemNote } from "../panel/problem";
import { Roving } from "../panel/roving";
import { momentText } from "../timeline/clock";
import { isBy, renameAuthor } from "./author";
import { nameOf, type Log } from "./log";
import { say, t } from "../language/catalogue";

const SHOWN = 12;

/** Who changed the map and when; each change can be taken back. */
export function ChangesList({ log }: { log: Log }) {
  const changes = log.changes.value;
  const [isAll, setAll] = useState(false);
  if (changes === null)
    return log.problem.value ? (
      <ProblemNote problem={log.problem.value} />
    ) : (
      <p class="soft">{t("Loading…")}</p>
    );
  const undone = new Set(changes.map((change) => change.undoes));
  const shown = isAll ? changes : changes.slice(0, SHOWN);
  return (
    <>
      {log.problem.value && <ProblemNote problem={log.problem.value} />}
      {changes.length === 0 && <p class="soft">{t("Nobody has changed this map yet.")}</p>}
      <Roving class="changes" isOrdered>
        {shown.map((change) => (
          <li key={change.id} class={undone.has(change.id) ? "undone" : ""}>
            <span class="what">{nameOf(change)}</span>
            <span class="soft">
              {isBy(change.author, log.author.value) ? t("you") : change.author},{" "}
              <time dateTime={change.made_at}>{momentText(Date.parse(change.made_at))}</time>
            </span>
            {!undone.has(change.id) && (
              <button
                type="button"
                class="plain"
                aria-label={t("Take back: {0}", nameOf(change))}
                disabled={log.isUndoing.value}
                onClick={() => void log.takeBack(change)}
              >
                {t("Take back")}
              </button>
            )}
          </li>
        ))}
      </Roving>
      {changes.length > shown.length && (
        <button type="button" onClick={() => setAll(true)}>
          {say("Show all {0}", changes.length)}
        </button>
      )}
      <label class="field">
        <span>{t("You are in this history as")}</span>
        <input
          value={log.author.value}
          maxLength={100}
          onChange={(event) => {
            log.author.value = renameAuthor(event.currentTarget.value);
          }}
        />
      </label>
    </>
  );
}
