/** What went wrong with a request, and whether asking again may help. */

import { signal } from "@preact/signals";

import type { Problem } from "./documents";
import { ApiError } from "./api";
import { t } from "./language/catalogue";

/** No answer, or one of something between: the service may be back in a moment. */
export const UNANSWERED: ReadonlySet<number> = new Set([0, 502, 503, 504]);

/** Rises when the service answers again after it did not: what could not be read is read again. */
export const contact = signal(0);

export function askAgain(): void {
  contact.value = contact.peek() + 1;
}

const UNREACHED: Problem = {
  type: "about:blank",
  title: t("Failed"),
  status: -1,
  detail: t("Something on the page went wrong."),
  instance: "",
  remedy: t("Load the page again."),
  errors: [],
};

export function problemOf(error: unknown): Problem {
  if (error instanceof ApiError) return error.problem;
  return { ...UNREACHED, detail: error instanceof Error ? error.message : UNREACHED.detail };
}
