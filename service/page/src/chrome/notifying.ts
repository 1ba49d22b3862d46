/** Notifications of the browser, of the types of events that were asked for here; kept in this browser alone. */

import { effect, signal } from "@preact/signals";

import { concerns, isSame, type Alert } from "../alerts/alert";
import type { App } from "../app";
import type { EventDocument } from "../documents";
import { openEvent } from "../events/open";
import { momentText } from "../timeline/clock";
import { sentenceOf } from "../words";
import { t } from "../language/catalogue";

const KEPT = "semap.notify";
const KEPT_ALERTS = "semap.alerts";

/** The types of events, by map. */
export const wanted = signal<Readonly<Record<string, readonly string[]>>>(kept(KEPT, {}));
/** What was made of events: of somebody and somewhere, or not. */
export const alerts = signal<readonly Alert[]>(kept(KEPT_ALERTS, []));

export function isWanted(map: string, types: readonly string[]): boolean {
  return types.length > 0 && types.every((type) => wanted.value[map]?.includes(type));
}

/** Why the browser would show nothing; null: it shows, or may be asked. */
export function obstacle(): string | null {
  if (!window.isSecureContext)
    return t("A browser notifies only of pages under https, or of this machine itself.");
  if (!("Notification" in window)) return t("This browser shows no notifications.");
  if (Notification.permission === "denied")
    return t(
      "This browser was told to show no notifications of this page. Allow them in the settings of the site.",
    );
  return null;
}

/** Notifies of these types, or no longer; the user must just have asked for it. Resolves with why not, or null. */
export async function notifyOf(map: string, types: readonly string[], isOn: boolean): Promise<string | null> {
  const why = isOn ? await obstacleAsked() : null;
  if (why === null) {
    const others = (wanted.value[map] ?? []).filter((each) => !types.includes(each));
    wanted.value = { ...wanted.value, [map]: isOn ? [...others, ...types] : others };
    localStorage.setItem(KEPT, JSON.stringify(wanted.value));
  }
  return why;
}

/** The same of what an alert says. */
export async function alertOf(alert: Alert, isOn: boolean): Promise<string | null> {
  const why = isOn ? await obstacleAsked() : null;
  if (why === null) {
    const others = alerts.value.filter((each) => !isSame(each, alert));
    alerts.value = isOn ? [...others, alert] : others;
    localStorage.setItem(KEPT_ALERTS, JSON.stringify(alerts.value));
  }
  return why;
}

/** Asks for leave where that was not done yet. */
async function obstacleAsked(): Promise<string | null> {
  if (obstacle() === null && Notification.permission === "default") await Notification.requestPermission();
  return obstacle() ?? (Notification.permission === "granted" ? null : t("It was not allowed."));
}

/** Notifies of what happens from now on; what happened before the page was opened is not told. */
export function startNotifying(app: App): void {
  const { state } = app;
  let told = 0;
  effect(() => {
    const events = state.events.value;
    const map = state.mapName.peek();
    const before = Math.max(told, state.eventsSince.value ?? Infinity);
    if (events.length === 0 || map === null || before === Infinity) return;
    told = Math.max(before, events[0]!.seq);
    if (obstacle() !== null || Notification.permission !== "granted") return;
    const isTold = (event: EventDocument): boolean =>
      (wanted.peek()[map]?.includes(event.type) ?? false) ||
      alerts.peek().some((each) => concerns(each, map, event));
    for (const event of events.filter((each) => each.seq > before && isTold(each))) {
      const options = { body: `${map}, ${momentText(Date.parse(event.stamp))}`, tag: event.event_id };
      try {
        const shown = new Notification(sentenceOf(event, state.map.peek()), options);
        shown.onclick = () => {
          window.focus();
          openEvent(app, event);
        };
      } catch {
        // On phones only service workers may; then the page itself says it.
        app.announce(sentenceOf(event, state.map.peek()));
      }
    }
  });
}

function kept<T>(name: string, otherwise: T): T {
  try {
    return (JSON.parse(localStorage.getItem(name) ?? "null") as T | null) ?? otherwise;
  } catch {
    return otherwise;
  }
}
