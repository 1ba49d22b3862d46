/** Which change Ctrl-Z takes back: read off the history of the map, so that it outlives the page. */

import type { ChangeSummary } from "../documents";
import { isBy } from "./author";

export interface Steps {
  /** The newest change of this author that holds. */
  undo: ChangeSummary | null;
  /** What to take back in order to have again what was undone last: a change that undoes. */
  redo: ChangeSummary | null;
}

/**
 * A change that undoes an ordinary one takes it away; one that undoes such a change gives it back. What can be
 * done again ends where its author changes something else.
 *
 * changes  the newest first
 */
export function stepsOf(changes: readonly ChangeSummary[], author: string): Steps {
  const byId = new Map(changes.map((change) => [change.id, change]));
  const undone = new Set<number>();
  let undo: ChangeSummary | null = null;
  let redo: ChangeSummary | null = null;
  let redoEnded = false;
  for (const change of changes) {
    const holds = !undone.has(change.id);
    if (change.undoes !== null && holds) undone.add(change.undoes);
    if (!isBy(change.author, author) || !holds) continue;
    if (isTakingAway(change, byId)) {
      if (redo === null && !redoEnded) redo = change;
    } else {
      if (change.undoes === null) redoEnded = true;
      if (undo === null) undo = change;
    }
  }
  return { undo, redo };
}

/** Whether a change took away what an ordinary change did, rather than giving it back. */
function isTakingAway(change: ChangeSummary, byId: ReadonlyMap<number, ChangeSummary>): boolean {
  let depth = 0;
  for (let each: ChangeSummary | undefined = change; each?.undoes != null; each = byId.get(each.undoes))
    depth += 1;
  return depth % 2 === 1;
}
