/** A track: where it is, since when, how sure that is. */

import type { RelationList } from "../documents";
import { path } from "../api";
import type { App } from "../app";
import { ellipse95 } from "../scene/ellipse";
import type { Showing } from "../showing";
import { Facts, Failed, InstanceLink, Moment } from "./parts";
import { useReading } from "./reading";

export function TrackDetails({ id, app, showing }: { id: number; app: App; showing: Showing }) {
  void showing.beat.value;
  const isLive = app.state.isLive.value;
  const state = (isLive ? showing.now : showing.then).movers.get(id)?.state;
  const reading = useReading<RelationList>(app.api, isLive ? path`/tracks/${id}/rooms` : null, [
    state?.rooms.join(),
  ]);
  if (!state) return <p class="soft">It is not on the map {isLive ? "now" : "at this moment"}.</p>;
  const ellipse = { a_m: 0, b_m: 0, angle_rad: 0 };
  const isKnown = ellipse95(state.cov_xx_m2, state.cov_xy_m2, state.cov_yy_m2, ellipse);
  return (
    <>
      <header>
        <h2 class="title">{state.name}</h2>
        <p class="soft">track {id}</p>
      </header>
      <Facts
        facts={[
          ["Seen", <Moment app={app} stamp={state.stamp} />],
          ["At", <span class="number">{`x ${state.x_m.toFixed(2)} m, y ${state.y_m.toFixed(2)} m`}</span>],
          [
            "Known to",
            isKnown && (
              <span class="number">{`${ellipse.a_m.toFixed(2)} m × ${ellipse.b_m.toFixed(2)} m (95 %)`}</span>
            ),
          ],
          [
            "Speed",
            state.speed_mps !== null && <span class="number">{`${state.speed_mps.toFixed(2)} m/s`}</span>,
          ],
          [
            "Heading",
            state.heading_rad !== null && (
              <span class="number">{`${((state.heading_rad * 180) / Math.PI).toFixed(0)}°`}</span>
            ),
          ],
          [
            "Extent",
            state.length_m !== null &&
              state.width_m !== null &&
              `${state.length_m.toFixed(2)} m × ${state.width_m.toFixed(2)} m`,
          ],
        ]}
      />
      <section>
        <h3>Is in</h3>
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
                        <td>
                          since <Moment app={app} stamp={since} />
                        </td>
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

function nameOf(app: App, id: number, otherwise: string | null): string {
  const thing = app.state.map.value?.byId.get(id);
  return thing ? (thing.alias ?? thing.name) : (otherwise ?? "");
}
