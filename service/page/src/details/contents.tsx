/** All that is on the map, to be found by name and chosen by keyboard. */

import type { App } from "../app";
import type { Thing } from "../map/model";
import { Roving } from "../panel/roving";
import type { Showing } from "../showing";
import { Gone } from "./gone";
import { Happened } from "./happened";
import { nameOf, TrackLink, Unread } from "./parts";
import { say, t } from "../language/catalogue";

const MOST = 200;

export function Contents({ app, showing }: { app: App; showing: Showing }) {
  void showing.beat.value;
  const wanted = app.state.find.value;
  const { map, storey, occupancy, isLive, selection } = app.state;
  const isKnown = app.state.isKnown.value;
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
        <Roving class="list">
          {found.slice(0, MOST).map((each) => (
            <li key={each.id}>
              <button class="link" onClick={() => (selection.value = { kind: "instance", id: each.id })}>
                {each.alias ?? each.name}
              </button>
              <span class="soft number">{note(each)}</span>
            </li>
          ))}
        </Roving>
        {found.length > MOST && (
          <p class="soft">{say("and {0} more; type a part of a name", found.length - MOST)}</p>
        )}
      </section>
    );
  return (
    <div class="stack">
      <label class="field">
        <span>{t("Find on the map")}</span>
        <input
          type="search"
          value={wanted}
          onInput={(event) => (app.state.find.value = event.currentTarget.value)}
          placeholder={t("room, door, person or concept")}
        />
      </label>
      {!isKnown && <Unread app={app} />}
      {tracks.length > 0 && (
        <section>
          <h3>{say("Who is here {0}", <span class="soft">{tracks.length}</span>)}</h3>
          <Roving class="list">
            {tracks.slice(0, MOST).map((each) => (
              <li key={each.track_id}>
                <TrackLink app={app} id={each.track_id} name={each.name} />
                <span class="soft">{each.rooms.map((id) => nameOf(app, id, "")).join(", ")}</span>
              </li>
            ))}
          </Roving>
        </section>
      )}
      <Gone app={app} wanted={wanted.trim()} present={new Set(tracks.map((each) => each.track_id))} />
      {wanted.trim() !== "" && <Happened app={app} wanted={wanted.trim()} />}
      {section(
        t("Rooms"),
        things.filter((each) => each.kind === "room"),
        (each) => (isKnown ? (occupancy.value.get(each.id) ?? 0) : ""),
      )}
      {section(
        t("Doors"),
        things.filter((each) => each.kind === "door"),
        (each) => world.doors.get(each.id)?.state ?? "",
      )}
      {section(
        t("Things"),
        things.filter((each) => each.kind === "thing"),
        (each) => each.concept,
      )}
    </div>
  );
}
