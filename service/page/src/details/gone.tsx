/** Who is no longer on the map, found by a part of the name. */

import type { TrackDocument } from "../documents";
import type { App } from "../app";
import { Roving } from "../panel/roving";
import { momentText } from "../timeline/clock";
import { Failed, TrackLink } from "./parts";
import { useReading } from "./reading";
import { say } from "../language/catalogue";

const MOST = 50;

/** present  who is listed elsewhere */
export function Gone({ app, wanted, present }: { app: App; wanted: string; present: ReadonlySet<number> }) {
  const map = app.state.mapName.value;
  const query = new URLSearchParams({ map: map ?? "", name_part: wanted, limit: `${MOST}` });
  const isAsked = map !== null && wanted !== "";
  const reading = useReading<{ tracks: TrackDocument[] }>(app.api, isAsked ? `/tracks?${query}` : null);
  if (!isAsked || reading.state === "loading") return null;
  if (reading.state === "failed") return <Failed problem={reading.problem} />;
  const gone = reading.value.tracks.filter((each) => each.state !== null && !present.has(each.id));
  if (gone.length === 0) return null;
  return (
    <section>
      <h3>{say("Who was here {0}", <span class="soft">{gone.length}</span>)}</h3>
      <Roving class="list">
        {gone.map((each) => (
          <li key={each.id}>
            <TrackLink app={app} id={each.id} name={each.name} />
            <span class="soft number">{say("last seen {0}", momentText(Date.parse(each.state!.stamp)))}</span>
          </li>
        ))}
      </Roving>
    </section>
  );
}
