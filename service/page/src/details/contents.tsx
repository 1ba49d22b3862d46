/** All that is on the map, to be found by name and chosen by keyboard. */

import { useState } from "preact/hooks";

import type { App } from "../app";
import type { Thing } from "../map/model";
import type { Showing } from "../showing";
import { TrackLink } from "./parts";

const MOST = 200;

export function Contents({ app, showing }: { app: App; showing: Showing }) {
  const [wanted, setWanted] = useState("");
  void showing.beat.value;
  const { map, storey, occupancy, isLive, selection } = app.state;
  const world = isLive.value ? showing.now : showing.then;
  const isWanted = (...names: (string | null)[]): boolean =>
    names.some((name) => name?.toLowerCase().includes(wanted.trim().toLowerCase()));
  const things = (map.value?.things ?? []).filter(
    (each) =>
      (storey.value === null || each.storey === null || each.storey === storey.value) &&
      isWanted(each.name, each.alias, each.concept),
  );
  const tracks = [...world.movers.values()].map((each) => each.state).filter((each) => isWanted(each.name));
  const section = (title: string, found: readonly Thing[], note: (thing: Thing) => string | number) =>
    found.length > 0 && (
      <section>
        <h3>
          {title} <span class="soft">{found.length}</span>
        </h3>
        <ul class="list">
          {found.slice(0, MOST).map((each) => (
            <li key={each.id}>
              <button class="link" onClick={() => (selection.value = { kind: "instance", id: each.id })}>
                {each.alias ?? each.name}
              </button>
              <span class="soft number">{note(each)}</span>
            </li>
          ))}
        </ul>
        {found.length > MOST && <p class="soft">and {found.length - MOST} more; type a part of a name</p>}
      </section>
    );
  return (
    <div class="stack">
      <label class="field">
        <span>Find on the map</span>
        <input
          type="search"
          value={wanted}
          onInput={(event) => setWanted(event.currentTarget.value)}
          placeholder="name or concept"
        />
      </label>
      {tracks.length > 0 && (
        <section>
          <h3>
            Who is here <span class="soft">{tracks.length}</span>
          </h3>
          <ul class="list">
            {tracks.slice(0, MOST).map((each) => (
              <li key={each.track_id}>
                <TrackLink app={app} id={each.track_id} name={each.name} />
                <span class="soft">{each.rooms.map((id) => nameOf(map.value?.byId.get(id))).join(", ")}</span>
              </li>
            ))}
          </ul>
        </section>
      )}
      {section(
        "Rooms",
        things.filter((each) => each.kind === "room"),
        (each) => occupancy.value.get(each.id) ?? 0,
      )}
      {section(
        "Doors",
        things.filter((each) => each.kind === "door"),
        (each) => world.doors.get(each.id)?.state ?? "",
      )}
      {section(
        "Things",
        things.filter((each) => each.kind === "thing"),
        (each) => each.concept,
      )}
    </div>
  );
}

function nameOf(thing: Thing | undefined): string {
  return thing ? (thing.alias ?? thing.name) : "";
}
