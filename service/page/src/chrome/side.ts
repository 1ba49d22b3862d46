/** The panels: at the right where there is room for them, else a sheet at the lower edge that is pulled up. */

import { effect, signal } from "@preact/signals";

import type { State } from "../state";

/** As in layout.css. */
const small = matchMedia("(max-width: 1024px)");
const LEAST_DRAG_PX = 8;
const LEAST_OPEN_PX = 140;

export const isSheet = signal(small.matches);
export const isSideOpen = signal(!small.matches);
/** How much of the window the sheet takes; null: as the style says. */
const sheet_px = signal<number | null>(null);

/** Follows the window and what is selected: on a small one the map is seen first, and what is chosen then. */
export function startSide(state: State): void {
  small.addEventListener("change", () => {
    isSheet.value = small.matches;
    isSideOpen.value = !small.matches;
  });
  effect(() => {
    document.body.classList.toggle("side-closed", !isSideOpen.value);
    if (sheet_px.value === null) document.body.style.removeProperty("--sheet");
    else document.body.style.setProperty("--sheet", `${sheet_px.value}px`);
  });
  effect(() => {
    if (state.selection.value !== null && isSheet.peek()) isSideOpen.value = true;
  });
}

/** Pulls the sheet up and down by its tabs, which are clicked all the same. */
export function startPulling(bar: HTMLElement): void {
  let from: { y: number; height: number } | null = null;
  let isPulled = false;
  bar.addEventListener("pointerdown", (event) => {
    if (!isSheet.peek()) return;
    from = { y: event.clientY, height: bar.parentElement!.getBoundingClientRect().height };
    isPulled = false;
  });
  bar.addEventListener("pointermove", (event) => {
    if (from === null || event.buttons === 0) return;
    const up_px = from.y - event.clientY;
    if (!isPulled && Math.abs(up_px) < LEAST_DRAG_PX) return;
    if (!isPulled) bar.setPointerCapture(event.pointerId);
    isPulled = true;
    isSideOpen.value = true;
    sheet_px.value = Math.round(Math.min(Math.max(from.height + up_px, bar.clientHeight), 0.9 * innerHeight));
  });
  const end = (): void => {
    if (isPulled && (sheet_px.peek() ?? LEAST_OPEN_PX) < LEAST_OPEN_PX) {
      isSideOpen.value = false;
      sheet_px.value = null;
    }
    from = null;
  };
  bar.addEventListener("pointerup", end);
  bar.addEventListener("pointercancel", end);
  bar.addEventListener(
    "click",
    (event) => {
      if (isPulled) event.stopPropagation();
      isPulled = false;
    },
    { capture: true },
  );
}
