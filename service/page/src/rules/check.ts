/** Checks a rule while it is written: by the service, a moment after the last key. */

import { useEffect, useState } from "preact/hooks";

import type { Problem, RuleCheck } from "../documents";
import type { App } from "../app";
import { problemOf } from "../panel/problem";
import { checkRule } from "./api";

const PAUSE_MS = 250;

export interface Checked {
  /** Of the text as it is; null while that is not known. */
  check: RuleCheck | null;
  /** Why it could not be checked. */
  problem: Problem | null;
}

export function useCheck(app: App, map: string, text: string, replaces: number | null): Checked {
  const [checked, setChecked] = useState<Checked & { of: string }>({ of: "", check: null, problem: null });
  const [round, setRound] = useState(0);
  useEffect(() => {
    const stop = new AbortController();
    const send = async (): Promise<void> => {
      try {
        const check = await checkRule(app.api, map, text, replaces, stop.signal);
        if (!stop.signal.aborted) setChecked({ of: text, check, problem: null });
      } catch (error) {
        if (!stop.signal.aborted) setChecked({ of: text, check: null, problem: problemOf(error) });
      }
    };
    const timer = setTimeout(() => void send(), PAUSE_MS);
    return () => {
      clearTimeout(timer);
      stop.abort();
    };
  }, [map, text, replaces, round]);
  const isLive = app.state.connection.value.state === "live";
  // What could not be asked while the service was away is asked when it is back.
  useEffect(() => {
    if (isLive && checked.problem !== null) setRound((before) => before + 1);
  }, [isLive]);
  return checked.of === text ? checked : { check: null, problem: null };
}
