/** Something that a panel reads from the service: being read, there, or not to be had. */

import { useCallback, useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";

import type { Problem } from "../documents";
import { contact } from "../unanswered";
import { problemOf } from "./problem";

export interface Resource<T> {
  /** The last that was read; it stays while it is read again. */
  value: T | null;
  isLoading: boolean;
  problem: Problem | null;
  reload(): void;
}

/**
 * Reads at first, whenever one of `causes` changes, and when asked to; an older answer never overtakes.
 * While it is not wanted, nothing is read, and what was being read is given up at once.
 */
export function useResource<T>(
  read: (signal: AbortSignal) => Promise<T>,
  causes: readonly unknown[],
  isWanted = true,
): Resource<T> {
  const [found, setFound] = useState<Omit<Resource<T>, "reload">>({
    value: null,
    isLoading: true,
    problem: null,
  });
  const [round, setRound] = useState(0);
  const latest = useRef(read);
  latest.current = read;
  useLayoutEffect(() => setFound({ value: null, isLoading: true, problem: null }), causes);
  useLayoutEffect(() => {
    if (!isWanted) return;
    const stop = new AbortController();
    setFound((before) => ({ ...before, isLoading: true }));
    latest.current(stop.signal).then(
      (value) => {
        if (!stop.signal.aborted) setFound({ value, isLoading: false, problem: null });
      },
      (error: unknown) => {
        if (!stop.signal.aborted)
          setFound((before) => ({ ...before, isLoading: false, problem: problemOf(error) }));
      },
    );
    return () => stop.abort();
  }, [...causes, round, isWanted]);
  const reload = useCallback(() => setRound((before) => before + 1), []);
  const isMissing = found.problem !== null;
  const contacts = contact.value;
  // What could not be read while the service was away is read when it is back.
  useEffect(() => {
    if (isMissing) reload();
  }, [contacts]);
  return { ...found, reload };
}
