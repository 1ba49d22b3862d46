/** The tabs of the panels; each panel is an element of the document, which is shown or hidden. */

import { useLayoutEffect } from "preact/hooks";

import type { State, Tab } from "../state";
import { SideButton } from "./head";
import { isSheet, isSideOpen } from "./side";
import { t } from "../language/catalogue";

const TABS: readonly [Tab, string][] = [
  ["details", t("Details")],
  ["events", t("Events")],
  ["edit", t("Edit")],
  ["rules", t("Rules")],
  ["queries", t("Queries")],
  ["import", t("Import")],
];

export function Tabs({ state }: { state: State }) {
  const chosen = state.tab.value;
  useLayoutEffect(() => {
    for (const [tab] of TABS) document.getElementById(`panel-${tab}`)!.hidden = tab !== chosen;
  }, [chosen]);
  const choose = (at: number): void => {
    const [tab] = TABS[(at + TABS.length) % TABS.length]!;
    state.tab.value = tab;
    document.getElementById(`tab-${tab}`)?.focus();
  };
  return (
    <>
      <div role="tablist" aria-label={t("Panels")}>
        {TABS.map(([tab, label], i) => (
          <button
            key={tab}
            role="tab"
            id={`tab-${tab}`}
            aria-controls={`panel-${tab}`}
            aria-selected={tab === chosen}
            tabIndex={tab === chosen ? 0 : -1}
            onClick={() => {
              state.tab.value = tab;
              isSideOpen.value = true;
            }}
            onKeyDown={(event) => {
              const to = { ArrowLeft: i - 1, ArrowRight: i + 1, Home: 0, End: TABS.length - 1 }[event.key];
              if (to === undefined) return;
              event.preventDefault();
              choose(to);
            }}
          >
            {label}
          </button>
        ))}
      </div>
      {isSheet.value && <SideButton />}
    </>
  );
}
