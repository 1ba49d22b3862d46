/** The fields by which events are searched for. */

import { useSignal } from "@preact/signals";
import { useEffect, useState } from "preact/hooks";

import type { RuleDocument, TrackDocument } from "../documents";
import { allPages, path } from "../api";
import type { App } from "../app";
import { useReading } from "../details/reading";
import { titleOf } from "../words";
import type { EventFilter } from "./filter";
import { say, t } from "../language/catalogue";

/** What is typed is searched for when no more comes for so long. */
const TYPED_MS = 250;
const MOST_PEOPLE = 20;

export function FilterFields({ app }: { app: App }) {
  const filter = app.state.eventFilter;
  const wanted = filter.value;
  const set = (part: Partial<EventFilter>): void => void (filter.value = { ...filter.peek(), ...part });
  const narrowed = [wanted.type, wanted.track, wanted.instance, wanted.day].filter(
    (each) => each !== "",
  ).length;
  return (
    <form
      role="search"
      aria-label={t("Events")}
      class="event-filter"
      onSubmit={(event) => event.preventDefault()}
    >
      <TextField text={wanted.text} set={(text) => set({ text })} />
      <details>
        <summary>{say("Filter {0}", narrowed > 0 && <span class="chip">{narrowed}</span>)}</summary>
        <div class="pair">
          <TypeField app={app} type={wanted.type} set={(type) => set({ type })} />
          <label class="field">
            <span>{t("Day")}</span>
            <input
              type="date"
              value={wanted.day}
              onChange={(event) => set({ day: event.currentTarget.value })}
            />
          </label>
          <PersonField app={app} name={wanted.track} set={(track) => set({ track })} />
          <RoomField app={app} name={wanted.instance} set={(instance) => set({ instance })} />
        </div>
      </details>
    </form>
  );
}

function TextField({ text, set }: { text: string; set: (text: string) => void }) {
  const [typed, setTyped] = useState(text);
  useEffect(() => setTyped(text), [text]);
  useEffect(() => {
    if (typed.trim() === text) return;
    const timer = setTimeout(() => set(typed.trim()), TYPED_MS);
    return () => clearTimeout(timer);
  }, [typed]);
  return (
    <input
      type="search"
      id="event-text"
      aria-label={t("Find events")}
      placeholder={t("Find events: words of what happened")}
      maxLength={200}
      value={typed}
      onInput={(event) => setTyped(event.currentTarget.value)}
    />
  );
}

/** What rules of the map call their events, with what is known of others. */
function TypeField({ app, type, set }: { app: App; type: string; set: (type: string) => void }) {
  const types = useSignal<readonly string[]>([]);
  const map = app.state.mapName.value;
  useEffect(() => {
    const known = app.state.events.peek().map((each) => each.type);
    types.value = ordered(known);
    if (map === null) return;
    allPages<RuleDocument, "rules">(app.api, path`/rules?map=${map}`, "rules").then(
      (rules) => void (types.value = ordered([...known, ...rules.flatMap(typesOf)])),
      () => {},
    );
  }, [map]);
  const shown = type === "" || types.value.includes(type) ? types.value : [...types.value, type];
  return (
    <label class="field">
      <span>{t("What")}</span>
      <select value={type} onChange={(event) => set(event.currentTarget.value)}>
        <option value="">{t("all")}</option>
        {shown.map((each) => (
          <option key={each} value={each}>
            {titleOf(each)}
          </option>
        ))}
      </select>
    </label>
  );
}

function PersonField({ app, name, set }: { app: App; name: string; set: (name: string) => void }) {
  const [typed, setTyped] = useState(name);
  useEffect(() => setTyped(name), [name]);
  const query = new URLSearchParams({
    map: app.state.mapName.value ?? "",
    name_part: typed.trim(),
    limit: `${MOST_PEOPLE}`,
  });
  const reading = useReading<{ tracks: TrackDocument[] }>(
    app.api,
    typed.trim() === "" ? null : `/tracks?${query}`,
  );
  const people = reading.state === "there" ? reading.value.tracks : [];
  return (
    <label class="field">
      <span>{t("Who")}</span>
      <input
        type="search"
        list="event-people"
        placeholder={t("everybody")}
        maxLength={200}
        value={typed}
        onInput={(event) => setTyped(event.currentTarget.value)}
        onChange={(event) => set(event.currentTarget.value.trim())}
      />
      <datalist id="event-people">
        {people.map((each) => (
          <option key={each.id} value={each.name} />
        ))}
      </datalist>
    </label>
  );
}

function RoomField({ app, name, set }: { app: App; name: string; set: (name: string) => void }) {
  const things = app.state.map.value?.things ?? [];
  return (
    <label class="field">
      <span>{t("Where")}</span>
      <select value={name} onChange={(event) => set(event.currentTarget.value)}>
        <option value="">{t("everywhere")}</option>
        {things
          .filter((each) => each.kind === "room" || each.kind === "door" || each.name === name)
          .map((each) => (
            <option key={each.id} value={each.name}>
              {each.alias ?? each.name}
            </option>
          ))}
      </select>
    </label>
  );
}

/** `emit` of a declaration is a name, or names by what begins and ends. */
function typesOf({ declaration }: RuleDocument): string[] {
  const emit = declaration["emit"];
  const named = typeof emit === "object" && emit !== null ? Object.values(emit) : [emit];
  return named.filter((each): each is string => typeof each === "string");
}

function ordered(types: readonly string[]): readonly string[] {
  return [...new Set(types)].sort((a, b) => titleOf(a).localeCompare(titleOf(b)));
}
