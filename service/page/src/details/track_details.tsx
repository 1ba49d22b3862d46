/** A track: where it is, since when, how sure that is. */

import type { RelationList, TrackDocument, TrackState, TrackStateDocument } from "../documents";
import { path } from "../api";
import type { App } from "../app";
import { ellipse95 } from "../scene/ellipse";
import type { Showing } from "../showing";
import { DayOf } from "./day";
import { Facts, Failed, InstanceLink, Moment, nameOf, Unread } from "./parts";
import { useReading } from "./reading";
import { fixed, say, t } from "../language/catalogue";

export function TrackDetails({ id, app, showing }: { id: number; app: App; showing: Showing }) {
  void showing.beat.value;
  // Told at once with another moment.
  void app.state.occupancy.value;
  const isLive = app.state.isLive.value;
  const reading = useReading<TrackDocument>(app.api, path`/tracks/${id}`, [isLive]);
  const present = (isLive ? showing.now : showing.then).movers.get(id)?.state;
  const known = present ?? (reading.state === "there" ? reading.value : null);
  const seen = present ?? (reading.state === "there" ? reading.value.state : null);
  if (known === null)
    return reading.state === "failed" ? (
      <Failed problem={reading.problem} />
    ) : (
      <p class="soft">{t("Reading who that is …")}</p>
    );
  return (
    <>
      <header>
        <h2 class="title">{known.name}</h2>
        {!present && <Gone app={app} />}
      </header>
      {present ? <Present id={id} app={app} state={present} /> : seen && <LastSeen app={app} state={seen} />}
      {seen && (
        <DayOf
          id={id}
          name={known.name}
          seen={Date.parse(seen.stamp)}
          app={app}
          because={isLive ? [present?.rooms.join()] : []}
        />
      )}
    </>
  );
}

/** Of who has left, or has not come yet at the moment that is shown. */
function Gone({ app }: { app: App }) {
  const { isLive, isKnown } = app.state;
  if (!isKnown.value) return <Unread app={app} />;
  return <p class="soft">{isLive.value ? t("Has left the map.") : t("Not on the map at this moment.")}</p>;
}

function LastSeen({ app, state }: { app: App; state: Pick<TrackStateDocument, "stamp" | "x_m" | "y_m"> }) {
  return (
    <Facts
      facts={[
        [t("Last seen"), <Moment app={app} stamp={state.stamp} />],
        [t("At"), <Place state={state} />],
      ]}
    />
  );
}

function Place({ state: { x_m, y_m } }: { state: { x_m: number; y_m: number } }) {
  return <span class="number">{`x ${fixed(x_m, 2)} m, y ${fixed(y_m, 2)} m`}</span>;
}

function Present({ id, app, state }: { id: number; app: App; state: TrackState }) {
  const isLive = app.state.isLive.value;
  const reading = useReading<RelationList>(app.api, isLive ? path`/tracks/${id}/rooms` : null, [
    state.rooms.join(),
  ]);
  const ellipse = { a_m: 0, b_m: 0, angle_rad: 0 };
  const isKnown = ellipse95(state.cov_xx_m2, state.cov_xy_m2, state.cov_yy_m2, ellipse);
  return (
    <>
      <Facts
        facts={[
          [t("Seen"), <Moment app={app} stamp={state.stamp} />],
          [t("At"), <Place state={state} />],
          [
            t("Accuracy"),
            isKnown && (
              <span class="number">
                {t("within {0} m × {1} m, 95 % sure", fixed(ellipse.a_m, 2), fixed(ellipse.b_m, 2))}
              </span>
            ),
          ],
          [
            t("Speed"),
            state.speed_mps !== null && <span class="number">{`${fixed(state.speed_mps, 2)} m/s`}</span>,
          ],
          [
            t("Heading"),
            state.heading_rad !== null && (
              <span class="number">{`${fixed((state.heading_rad * 180) / Math.PI, 0)}°`}</span>
            ),
          ],
          [
            t("Extent"),
            state.length_m !== null &&
              state.width_m !== null &&
              `${fixed(state.length_m, 2)} m × ${fixed(state.width_m, 2)} m`,
          ],
        ]}
      />
      <section>
        <h3>{t("Is in")}</h3>
        {reading.state === "failed" && isLive && <Failed problem={reading.problem} />}
        <table class="plain">
          <tbody>
            {isLive && reading.state === "there"
              ? reading.value.relations.map(
                  ({ query, since, instance_id: room, instance }) =>
                    room !== null && (
                      <tr key={`${query} ${room}`}>
                        <td>
                          <InstanceLink app={app} id={room} name={nameOf(app, room, instance)} />
                        </td>
                        <td>{say("since {0}", <Moment app={app} stamp={since} />)}</td>
                      </tr>
                    ),
                )
              : state.rooms.map((room) => (
                  <tr key={room}>
                    <td>
                      <InstanceLink app={app} id={room} name={nameOf(app, room, `${room}`)} />
                    </td>
                  </tr>
                ))}
          </tbody>
        </table>
      </section>
    </>
  );
}
