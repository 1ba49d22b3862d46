/** "Tell me when this happens again": made of an event, told by this browser or to an address. */

import { useState } from "preact/hooks";

import { alerts, alertOf } from "../chrome/notifying";
import type { EventDocument, Problem, WebhookList, WebhookWithSecret } from "../documents";
import { path } from "../api";
import type { App } from "../app";
import { useReading } from "../details/reading";
import { t } from "../language/catalogue";
import { Guarded } from "../panel/guarded";
import { ProblemNote } from "../panel/problem";
import { problemOf } from "../unanswered";
import { nameIn, titleOf } from "../words";
import "./alerts.css";
import { isSame, webhookOf, type Alert } from "./alert";

export function TellMe({ app, event }: { app: App; event: EventDocument }) {
  const [who, setWho] = useState<string | null>(event.track?.name ?? null);
  const [where, setWhere] = useState<string | null>(event.instance?.name ?? null);
  const alert: Alert = { map: event.map, type: event.type, who, where };
  const place = event.instance && nameIn(app.state.map.value, event.instance.id, event.instance.name);
  return (
    <details class="tell-me">
      <summary>{t("Tell me when this happens again")}</summary>
      <div class="row">
        {event.track && (
          <Narrowed
            label={t("Who")}
            any={t("whoever it is")}
            name={event.track.name}
            value={who}
            set={setWho}
          />
        )}
        {event.instance && (
          <Narrowed
            label={t("Where")}
            any={t("wherever it is")}
            name={event.instance.name}
            title={place ?? event.instance.name}
            value={where}
            set={setWhere}
          />
        )}
      </div>
      <InBrowser alert={alert} />
      <AtAddress app={app} alert={alert} />
      <Kept map={event.map} />
    </details>
  );
}

interface NarrowedProps {
  label: string;
  any: string;
  name: string;
  title?: string;
  value: string | null;
  set: (value: string | null) => void;
}

function Narrowed({ label, any, name, title = name, value, set }: NarrowedProps) {
  return (
    <label class="field">
      <span>{label}</span>
      <select
        value={value === null ? "any" : "only"}
        onChange={(event) => set(event.currentTarget.value === "any" ? null : name)}
      >
        <option value="only">{t("only {0}", title)}</option>
        <option value="any">{any}</option>
      </select>
    </label>
  );
}

function InBrowser({ alert }: { alert: Alert }) {
  const [why, setWhy] = useState<string | null>(null);
  const isOn = alerts.value.some((each) => isSame(each, alert));
  return (
    <>
      <button type="button" aria-pressed={isOn} onClick={() => void alertOf(alert, !isOn).then(setWhy)}>
        {t("In this browser, while the page is open")}
      </button>
      {why && (
        <p class="note warn" role="alert">
          {why}
        </p>
      )}
    </>
  );
}

function AtAddress({ app, alert }: { app: App; alert: Alert }) {
  const [url, setUrl] = useState("");
  const [made, setMade] = useState<WebhookWithSecret | null>(null);
  const [problem, setProblem] = useState<Problem | null>(null);
  const [round, setRound] = useState(0);
  const send = async (): Promise<void> => {
    setProblem(null);
    try {
      const body = webhookOf(alert, url.trim());
      setMade((await app.api.send<WebhookWithSecret>("POST", "/webhooks", { body })).body);
      setUrl("");
      setRound(round + 1);
    } catch (error) {
      setProblem(problemOf(error));
    }
  };
  return (
    <Guarded app={app} what={t("Making webhooks")} scope="admin">
      <form
        class="stack"
        onSubmit={(event) => {
          event.preventDefault();
          void send();
        }}
      >
        <label class="field">
          <span>{t("At an address, which is called for each event (webhook)")}</span>
          <input
            type="url"
            required
            placeholder="https://"
            value={url}
            onInput={(event) => setUrl(event.currentTarget.value)}
          />
        </label>
        <button type="submit" disabled={url.trim() === ""}>
          {t("Make the webhook")}
        </button>
      </form>
      {problem && <ProblemNote problem={problem} />}
      {made && (
        <p class="note" role="status">
          {t("The webhook is made. Its secret, which is shown only now:")} <code>{made.secret}</code>
        </p>
      )}
      <Webhooks app={app} map={alert.map} round={round} />
    </Guarded>
  );
}

/** Those that are of this map alone. */
function Webhooks({ app, map, round }: { app: App; map: string; round: number }) {
  const [gone, setGone] = useState<readonly number[]>([]);
  const mayRead = app.state.caller.value?.scopes.includes("admin") ?? false;
  const reading = useReading<WebhookList>(app.api, mayRead ? "/webhooks?limit=1000" : null, [round]);
  if (reading.state !== "there") return null;
  const remove = async (id: number): Promise<void> => {
    try {
      await app.api.send("DELETE", path`/webhooks/${id}`);
      setGone([...gone, id]);
    } catch (error) {
      app.announce(problemOf(error).detail, "error");
    }
  };
  const own = reading.value.webhooks.filter((each) => each.maps?.includes(map) && !gone.includes(each.id));
  if (own.length === 0) return null;
  return (
    <ul class="cards" aria-label={t("Webhooks")}>
      {own.map((each) => (
        <li key={each.id} class="row">
          <span class="grow" dir="ltr">
            {[each.type, each.filter, each.url].filter(Boolean).join(", ")}
          </span>
          <button type="button" class="plain" onClick={() => void remove(each.id)}>
            {t("Delete {0}", each.url)}
          </button>
        </li>
      ))}
    </ul>
  );
}

/** What this browser tells of on this map. */
function Kept({ map }: { map: string }) {
  const own = alerts.value.filter((each) => each.map === map);
  if (own.length === 0) return null;
  return (
    <ul class="cards" aria-label={t("Alerts")}>
      {own.map((each) => {
        const text = [titleOf(each.type), each.who, each.where].filter(Boolean).join(", ");
        return (
          <li key={text} class="row">
            <span class="grow" dir="auto">
              {text}
            </span>
            <button
              type="button"
              class="plain"
              aria-label={t("Remove the alert {0}", text)}
              onClick={() => void alertOf(each, false)}
            >
              {t("Remove")}
            </button>
          </li>
        );
      })}
    </ul>
  );
}
