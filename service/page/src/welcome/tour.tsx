/** A tour of the page in five steps, which can be left at any of them. */

import "./welcome.css";

import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";

import type { App } from "../app";
import { isSideOpen } from "../chrome/side";
import type { Tab } from "../state";
import { say, t } from "../language/catalogue";

interface Step {
  title: string;
  text: string;
  /** What it is about. */
  of: string;
  tab?: Tab;
}

const STEPS: readonly Step[] = [
  {
    title: t("The map"),
    text: t(
      "Rooms are coloured by how many are in them. Drag to move it, turn the wheel to come nearer; click on anything to see what is known of it.",
    ),
    of: "#scene",
  },
  {
    title: t("The timeline"),
    text: t(
      "Who was in which room, how doors stood, and what happened. Click on any moment to see it on the map; Live brings you back.",
    ),
    of: "#time",
  },
  {
    title: t("What happened"),
    text: t(
      "Events as rules find them. Find any by words, or by person, room and day; a click shows the moment and why it happened.",
    ),
    of: "#side",
    tab: "events",
  },
  {
    title: t("Rules"),
    text: t(
      "What shall be told: a rule is made from a sentence or a template, and a dry run shows what it would have found.",
    ),
    of: "#side",
    tab: "rules",
  },
  {
    title: t("Your building"),
    text: t(
      "Draw rooms and doors here, or drop a file of a building anywhere on the page. Every change can be undone.",
    ),
    of: "#side",
    tab: "edit",
  },
];

/** The step that is shown; null: none. */
export const tourAt = signal<number | null>(null);

export function Tour({ app }: { app: App }) {
  const at = tourAt.value;
  const heading = useRef<HTMLHeadingElement>(null);
  useEffect(() => {
    if (at === null) return;
    const step = STEPS[at]!;
    if (step.tab) {
      isSideOpen.value = true;
      app.state.tab.value = step.tab;
    }
    const shown = document.querySelector(step.of);
    shown?.classList.add("toured");
    heading.current?.focus();
    return () => shown?.classList.remove("toured");
  }, [at]);
  if (at === null) return null;
  const { title, text } = STEPS[at]!;
  const isLast = at === STEPS.length - 1;
  return (
    <section class="tour" role="dialog" aria-label={t("Tour")}>
      <h2 ref={heading} tabIndex={-1}>
        {title}
      </h2>
      <p>{text}</p>
      <div class="row">
        <span class="soft number">{say("{0} of {1}", at + 1, STEPS.length)}</span>
        <span class="grow" />
        {!isLast && <button onClick={() => (tourAt.value = null)}>{t("Leave")}</button>}
        {at > 0 && <button onClick={() => (tourAt.value = at - 1)}>{t("Back")}</button>}
        <button class="primary" onClick={() => (tourAt.value = isLast ? null : at + 1)}>
          {isLast ? t("Done") : t("Next")}
        </button>
      </div>
    </section>
  );
}
