/** The map and the view in the page's address, so that it can be kept and sent: #map=office&view=space */

import { effect } from "@preact/signals";

import type { State } from "../state";

/** Follows the state with the address from now on. */
export function startAddress(state: State): void {
  const wanted = new URLSearchParams(location.hash.slice(1));
  if (wanted.get("view") === "space") state.view.value = "space";
  effect(() => {
    const map = state.mapName.value;
    const isSpace = state.view.value === "space";
    if (map === null) return;
    const kept = new URLSearchParams({ map, ...(isSpace ? { view: "space" } : {}) });
    history.replaceState(null, "", `#${kept}`);
  });
}

/** The map that the address names. */
startAddress.wanted = (): string | undefined =>
  new URLSearchParams(location.hash.slice(1)).get("map") ?? undefined;
