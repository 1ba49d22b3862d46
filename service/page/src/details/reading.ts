/** Something that a panel reads from the service, again whenever what it depends on changes. */

import { useEffect, useState } from "preact/hooks";

import type { Problem } from "../documents";
import type { Api } from "../api";
import { contact, problemOf } from "../unanswered";

export type Reading<T> =
  { state: "loading" } | { state: "there"; value: T; path?: string } | { state: "failed"; problem: Problem };

/** Reads `path`, and again when one of `because` changed or the service is back; null: nothing. What was read stays until there is newer. */
export function useReading<T>(api: Api, path: string | null, because: readonly unknown[] = []): Reading<T> {
  const [reading, setReading] = useState<Reading<T>>({ state: "loading" });
  const round = contact.value;
  useEffect(() => {
    if (path === null) return;
    // What is shown next shall not have the answer to what was shown before.
    setReading((before) =>
      before.state === "there" && before.path === path ? before : { state: "loading" },
    );
    const aborter = new AbortController();
    api.get<T>(path, aborter.signal).then(
      (value) => setReading({ state: "there", value, path }),
      (error: unknown) => {
        if (!aborter.signal.aborted) setReading({ state: "failed", problem: problemOf(error) });
      },
    );
    return () => aborter.abort();
  }, [path, round, ...because]);
  return reading;
}
