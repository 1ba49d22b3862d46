import { useState } from "preact/hooks";

import { ProblemNote } from "../panel/problem";
import { Roving } from "../panel/roving";
import { momentText } from "../timeline/clock";
import { isBy, renameAuthor } from "./author";
import { nameOf, type Log } from "./log";

const SHOWN = 12;

/** Who changed the map and when; each change can be taken back. */
export function ChangesList({ log }: { log: Log }) {
  const changes = log.changes.value;
  const [isAll, setAll] = useState(false);
  if (changes === null)
    return log.problem.value ? <ProblemNote problem={log.problem.value} /> : <p class="soft">Loading…</p>;
  const undone = new Set(changes.map((change) => change.undoes));
  const shown = isAll ? changes : changes.slice(0, SHOWN);
  return (
    <>
      {log.problem.value && <ProblemNote problem={log.problem.value} />}
      {changes.length === 0 && <p class="soft">Nobody has changed this map yet.</p>}
      <Roving class="changes" isOrdered>
        {shown.map((change) => (
          <li key={change.id} class={undone.has(change.id) ? "undone" : ""}>
            <span class="what">{nameOf(change)}</span>
            <span class="soft">
              {isBy(change.author, log.author.value) ? "you" : change.author},{" "}
              <time dateTime={change.made_at}>{momentText(Date.parse(change.made_at))}</time>
            </span>
            {!undone.has(change.id) && (
              <button
                type="button"
                class="plain"
                aria-label={`Take back: ${nameOf(change)}`}
                disabled={log.isUndoing.value}
                onClick={() => void log.takeBack(change)}
              >
                Take back
              </button>
            )}
          </li>
        ))}
      </Roving>
      {changes.length > shown.length && (
        <button type="button" onClick={() => setAll(true)}>
          Show all {changes.length}
        </button>
      )}
      <label class="field">
        <span>You are in this history as</span>
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
