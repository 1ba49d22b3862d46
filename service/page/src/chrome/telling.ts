/** Tells screen readers of events: the newest, and how many more there were, every few seconds at most. */

import { effect } from "@preact/signals";

import type { State } from "../state";
import { sentenceOf } from "../words";
import { tell } from "./notices";
import { t } from "../language/catalogue";

const EVERY_MS = 4000;

export function startTellingEvents(state: State): void {
  let told: number | null = null;
  let timer = 0;
  const say = (): void => {
    timer = 0;
    const [newest] = state.events.peek();
    if (!newest || told === null || newest.seq <= told) return;
    const more = state.events.peek().filter((each) => each.seq > told!).length - 1;
    told = newest.seq;
    tell(`${sentenceOf(newest, state.map.peek())}${more > 0 ? t(", and {0} more events", more) : ""}`);
  };
  effect(() => {
    const [newest] = state.events.value;
    // What happened before the page was opened is not told.
    if (!newest) told = state.connection.peek().state === "live" ? (told ?? 0) : null;
    else if (told === null) told = newest.seq;
    else if (newest.seq > told && timer === 0) timer = window.setTimeout(say, EVERY_MS);
  });
}
