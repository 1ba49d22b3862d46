/** Something that a panel reads from the service, again whenever what it depends on changes. */

import { useEffect, useState } from "preact/hooks";

import type { Problem } from "../documents";
import type { Api } from "../api";
import { problemOf } from "../showing";

export type Reading<T> =
  { state: "loading" } | { state: "there"; value: T } | { state: "failed"; problem: Problem };

/** Reads `path`, and again when one of `because` changed; null: nothing. What was read stays until there is newer. */
export function useReading<T>(api: Api, path: string | null, because: readonly unknown[] = []): Reading<T> {
  const [reading, setReading] = useState<Reading<T>>({ state: "loading" });
  useEffect(() => {
    if (path === null) return;
    const aborter = new AbortController();
    api.get<T>(path, aborter.signal).then(
      (value) => setReading({ state: "there", value }),
      (error: unknown) => {
        if (!aborter.signal.aborted) setReading({ state: "failed", problem: problemOf(error) });
      },
    );
    return () => aborter.abort();
  }, [path, ...because]);
  return reading;
}
