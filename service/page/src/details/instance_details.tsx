/** An instance: what it is, who is in it, what it joins. */

import type { OccupantList } from "../documents";
import { path } from "../api";
import type { App } from "../app";
import { areaOf } from "../map/shape";
import type { Showing } from "../showing";
import { Facts, Failed, InstanceLink, Moment, TrackLink, Unread } from "./parts";
import { doorState, propertyOf } from "../words";
import { useReading } from "./reading";
import { RoomUse } from "./room_use";
import { fixed, say, t } from "../language/catalogue";

export function InstanceDetails({ id, app, showing }: { id: number; app: App; showing: Showing }) {
  const map = app.state.map.value;
  const thing = map?.byId.get(id);
  if (!map || !thing) return <p class="soft">{t("It is no longer on the map.")}</p>;
  const world = app.state.isLive.value ? showing.now : showing.then;
  void showing.beat.value;
  const door = world.doors.get(id);
  const area = thing.outlines.reduce((sum, outline) => sum + areaOf(outline), 0);
  const joined =
    thing.kind === "door"
      ? map.things.filter((each) => thing.joins.includes(each.name))
      : map.things.filter((each) => each.joins.includes(thing.name));
  return (
    <>
      <header>
        <h2 class="title">{thing.alias ?? thing.name}</h2>
        <p class="soft">
          {thing.concept}
          {thing.alias && ` · ${thing.name}`}
          {thing.storey && ` · ${thing.storey}`}
        </p>
      </header>
      {door && (
        <Facts
          facts={[
            [t("State"), <b class={`door-state ${door.state}`}>{doorState(door.state)}</b>],
            [t("Since"), door.since && <Moment app={app} stamp={door.since} />],
          ]}
        />
      )}
      {thing.kind === "room" && <InRoom id={id} app={app} showing={showing} />}
      {thing.kind === "room" && <RoomUse id={id} app={app} />}
      <Facts
        facts={[
          [t("Area"), area > 0 && `${fixed(area, 1)} m²`],
          [
            t("Heights"),
            thing.zMax_m !== null && t("{0} m to {1} m", fixed(thing.zMin_m, 2), fixed(thing.zMax_m, 2)),
          ],
          [
            thing.kind === "door" ? t("Joins") : t("Doors"),
            joined.length > 0 &&
              joined.map((each) => (
                <InstanceLink key={each.id} app={app} id={each.id} name={each.alias ?? each.name} />
              )),
          ],
        ]}
      />
      {Object.keys(thing.attributes).length > 0 && (
        <section>
          <h3>{t("Attributes")}</h3>
          <Facts facts={Object.entries(thing.attributes).map(([name, value]) => propertyOf(name, value))} />
        </section>
      )}
      <div class="row">
        <button onClick={() => (app.state.tab.value = "edit")}>{t("Edit")}</button>
      </div>
    </>
  );
}

function InRoom({ id, app, showing }: { id: number; app: App; showing: Showing }) {
  const count = app.state.occupancy.value.get(id) ?? 0;
  const isLive = app.state.isLive.value;
  const reading = useReading<OccupantList>(app.api, isLive ? path`/rooms/${id}/occupants` : null, [count]);
  const then = [...showing.then.movers.values()]
    .filter((each) => each.state.rooms.includes(id))
    .map((each) => each.state);
  if (!app.state.isKnown.value)
    return (
      <section>
        <h3>{isLive ? t("In it now") : t("In it then")}</h3>
        <Unread app={app} />
      </section>
    );
  return (
    <section>
      <h3>
        {isLive
          ? t("{0} in it now", count === 0 ? t("Nobody") : count === 1 ? t("One") : count)
          : t("{0} in it then", count === 0 ? t("Nobody") : count === 1 ? t("One") : count)}
      </h3>
      {isLive && reading.state === "failed" && <Failed problem={reading.problem} />}
      <table class="plain">
        <tbody>
          {isLive && reading.state === "there" && count > 0
            ? reading.value.occupants.map(({ track_id, name, since }) => (
                <tr key={track_id}>
                  <td>
                    <TrackLink app={app} id={track_id} name={name} />
                  </td>
                  <td>{say("since {0}", <Moment app={app} stamp={since} />)}</td>
                </tr>
              ))
            : !isLive &&
              then.map(({ track_id, name }) => (
                <tr key={track_id}>
                  <td>
                    <TrackLink app={app} id={track_id} name={name} />
                  </td>
                </tr>
              ))}
        </tbody>
      </table>
    </section>
  );
}
