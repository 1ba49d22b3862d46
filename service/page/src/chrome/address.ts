/** What is shown in the page's address, so that it can be kept and sent, and is shown again by who opens it. */

import { batch, effect, signal } from "@preact/signals";

import type { TimelineDocument } from "../documents";
import { path } from "../api";
import type { App } from "../app";
import { hasCopied } from "../panel/taking";
import type { Stage } from "../scene/stage";
import type { Showing } from "../showing";
import { everyStorey, shownIn, storeyOf, textOf, type Chosen, type Shown } from "./address_text";
import { isSheet, isSideOpen } from "./side";
import { t } from "../language/catalogue";

/** Browsers refuse to change the address more than a hundred times in half a minute. */
const MOST_AT_ONCE = 30;
const LEAST_BETWEEN_MS = 500;

/** The map that the address names. */
export function wantedMap(): string | undefined {
  return inAddress().map ?? undefined;
}

export class Address {
  private readonly app: App;
  private readonly showing: Showing;
  private readonly stage: Stage;
  /** What is to be shown as soon as its map is there. */
  private readonly wanted = signal<Shown | null>(null);
  private timer = 0;
  private asked_ms = 0;
  /** How often the address may be changed at once. */
  private left = MOST_AT_ONCE;

  constructor(app: App, showing: Showing, stage: Stage) {
    this.app = app;
    this.showing = showing;
    this.stage = stage;
  }

  /** Follows what is shown from now on, and an address that is put in its place. */
  start(): void {
    if (location.hash.length > 1) this.want(inAddress());
    addEventListener("hashchange", () => {
      const shown = inAddress();
      if (shown.map === null) return;
      this.want(shown);
      if (shown.map !== this.app.state.mapName.peek()) void this.showing.reloadMaps(shown.map);
    });
    effect(() => {
      const wanted = this.wanted.value;
      const map = this.app.state.map.value;
      if (wanted === null || map === null) return;
      // After all that follows the map has seen it: what opens the panels for a selection comes before what closes them.
      queueMicrotask(() => {
        if (wanted.map === null || wanted.map === map.name) this.show(wanted);
        if (this.wanted.peek() === wanted) this.wanted.value = null;
      });
    });
    effect(() => {
      const text = textOf(this.shown());
      if (this.app.state.map.value === null || this.wanted.value !== null) return;
      clearTimeout(this.timer);
      this.left = Math.min(MOST_AT_ONCE, this.left + (performance.now() - this.asked_ms) / LEAST_BETWEEN_MS);
      this.asked_ms = performance.now();
      if (this.left >= 1) this.write(text);
      else this.timer = window.setTimeout(() => this.write(text), LEAST_BETWEEN_MS);
    });
  }

  /** Puts the address of what is shown onto the clipboard. */
  async copy(): Promise<void> {
    clearTimeout(this.timer);
    this.write(textOf(this.shown()));
    if (await hasCopied(location.href)) this.app.announce(t("The link to what is shown is copied."));
    else
      this.app.announce(
        t("The browser does not let the page copy: take the link from the address bar."),
        "error",
      );
  }

  /** What needs no map is shown at once: what somebody chooses before the map is there is not undone by it. */
  private want(shown: Shown): void {
    const { state } = this.app;
    batch(() => {
      state.view.value = shown.view;
      state.tab.value = shown.tab;
      state.heat.value = shown.heat;
      state.isApart.value = shown.isApart;
      state.find.value = shown.find;
      state.eventFilter.value = shown.events;
      this.wanted.value = shown;
    });
  }

  private write(text: string): void {
    if (location.hash === `#${text}`) return;
    this.left = Math.max(0, this.left - 1);
    history.replaceState(null, "", `#${text}`);
  }

  private shown(): Shown {
    const { state } = this.app;
    void this.stage.viewed.value;
    const selection = state.selection.value;
    // On a small window they open for what is selected.
    const isUsual = isSideOpen.value === (!isSheet.value || selection !== null);
    const hasStoreys = (state.map.value?.storeys.length ?? 0) > 1;
    return {
      map: state.mapName.value,
      view: state.view.value,
      storey: hasStoreys ? everyStorey(state.storey.value) : null,
      isApart: hasStoreys && state.storey.value === null && state.isApart.value,
      at: state.at.value,
      chosen:
        selection?.kind === "event"
          ? { kind: "event", id: selection.event.event_id, stamp: selection.event.stamp }
          : selection,
      heat: state.heat.value,
      tab: state.tab.value,
      find: state.find.value,
      events: state.eventFilter.value,
      span: this.showing.follows.value ? null : state.span.value,
      eye: this.stage.eye,
      isSideOpen: isUsual ? null : isSideOpen.value,
    };
  }

  private show(shown: Shown): void {
    const { state } = this.app;
    const storey = storeyOf(shown.storey, state.map.peek()?.storeys ?? []);
    batch(() => {
      if (storey !== undefined) state.storey.value = storey;
      state.selection.value = shown.chosen?.kind === "event" ? null : shown.chosen;
      this.app.moveTo(shown.at);
      if (shown.span) this.app.timeline.show(shown.span.from, shown.span.to);
    });
    this.stage.eye = shown.eye;
    if (shown.isSideOpen !== null) isSideOpen.value = shown.isSideOpen;
    if (shown.chosen?.kind === "event") void this.chooseEvent(state.map.peek()!.name, shown.chosen);
  }

  private async chooseEvent(map: string, { id, stamp }: Chosen & { kind: "event" }): Promise<void> {
    const { state } = this.app;
    const query = new URLSearchParams({ from: stamp, to: stamp });
    try {
      const found = await this.app.api.get<TimelineDocument>(path`/maps/${map}/timeline` + `?${query}`);
      const event = found.events.find((each) => each.event_id === id);
      if (state.map.peek()?.name !== map || state.selection.peek() !== null) return;
      if (event) state.selection.value = { kind: "event", event };
      else this.app.announce(t("The event of this link is no longer there."), "error");
    } catch {
      this.app.announce(t("The event of this link could not be read: open the link again."), "error");
    }
  }
}

function inAddress(): Shown {
  return shownIn(location.hash.slice(1));
}
