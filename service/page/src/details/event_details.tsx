/** An event: what happened, on what evidence, and why its rule fired. */

import type { EventDocument, ExplanationDocument } from "../documents";
import { allPages, path } from "../api";
import type { App } from "../app";
import { useEffect, useState } from "preact/hooks";
import { withClock } from "../timeline/clock";
import { problemOf } from "../unanswered";
import { Facts, Failed, InstanceLink, Moment, nameOf, TrackLink } from "./parts";
import { TellMe } from "../alerts/tell_me";
import { propertyOf, sentenceOf, titleOf } from "../words";
import type { Reading } from "./reading";
import { say, t } from "../language/catalogue";

export function EventDetails({ event, app }: { event: EventDocument; app: App }) {
  const entries = (values: Record<string, unknown>): (readonly [string, string])[] =>
    Object.entries(values).map(([name, value]) => propertyOf(name, value));
  return (
    <>
      <header>
        <h2 class="title">{sentenceOf(event, app.state.map.value)}</h2>
        <p class="soft">
          {say(
            "{0}, as the rule {1} found it (version {2})",
            titleOf(event.type),
            titleOf(event.rule),
            event.rule_version,
          )}
        </p>
      </header>
      {event.verdict === "retracted" && (
        <p class="note warn">{t("Looking back, this did not happen: the batch layer retracted it.")}</p>
      )}
      {event.verdict === "amended" && (
        <p class="note">{t("Looking back, it was a little different: the batch layer amended it.")}</p>
      )}
      <Facts
        facts={[
          [t("When"), <Moment app={app} stamp={event.stamp} />],
          [t("Who"), event.track && <TrackLink app={app} id={event.track.id} name={event.track.name} />],
          [
            t("Where"),
            event.instance && (
              <InstanceLink
                app={app}
                id={event.instance.id}
                name={nameOf(app, event.instance.id, event.instance.name)}
              />
            ),
          ],
          [t("Since"), event.since !== event.stamp && <Moment app={app} stamp={event.since} />],
          [t("Because"), event.cause && CAUSES[event.cause]],
          [t("How sure"), event.confidence !== null && `${Math.round(event.confidence * 100)} %`],
          [t("Verdict"), event.verdict && VERDICTS[event.verdict]],
          ...entries(event.key),
          ...entries(event.measures),
        ]}
      />
      <section>
        <h3>{t("Evidence")}</h3>
        <table class="plain">
          <tbody>
            {event.evidence.map((each) => (
              <tr key={each.uid}>
                <th scope="row">
                  {SOURCES[each.source] ?? titleOf(each.source)}
                  {each.variable && <span class="soft"> {say("({0} of the rule)", each.variable)}</span>}
                </th>
                <td>
                  <Moment app={app} stamp={each.stamp} />
                </td>
              </tr>
            ))}
          </tbody>
        </table>
      </section>
      <Why event={event} app={app} />
      <TellMe key={event.event_id} event={event} app={app} />
    </>
  );
}

const VERDICTS: Readonly<Record<string, string>> = {
  confirmed: t("confirmed"),
  amended: t("amended"),
  retracted: t("retracted"),
};
const CAUSES = {
  moved: t("it moved"),
  appeared: t("it was first seen"),
  disappeared: t("it was lost"),
  map: t("the map was edited"),
};
const SOURCES: Readonly<Record<string, string>> = {
  relation: t("Somebody came or went"),
  object_state: t("A door or another object changed its state"),
  map: t("The map was edited"),
  event: t("Another event"),
};

/** The explanation of the rule as it stands now, which is not asked for by itself: it runs the rule again. */
function Why({ event, app }: { event: EventDocument; app: App }) {
  const [reading, setReading] = useState<Reading<ExplanationDocument> | null>(null);
  useEffect(() => setReading(null), [event.event_id]);
  const ask = async (): Promise<void> => {
    setReading({ state: "loading" });
    try {
      const rules = await allPages<{ id: number; name: string }, "rules">(
        app.api,
        `/rules?map=${encodeURIComponent(event.map)}`,
        "rules",
      );
      const rule = rules.find((each) => each.name === event.rule);
      if (!rule) throw new Error(t("The rule {0} is no longer there.", event.rule));
      const keys = Object.entries(event.key).map(
        ([name, value]) => `&key=${encodeURIComponent(`${name}=${String(value)}`)}`,
      );
      const address = path`/rules/${rule.id}/explanation?at=${event.stamp}` + keys.join("");
      setReading({ state: "there", value: await app.api.get<ExplanationDocument>(address) });
    } catch (error) {
      setReading({ state: "failed", problem: problemOf(error) });
    }
  };
  return (
    <section class="stack">
      <div class="row">
        <button id="why" onClick={() => void ask()} disabled={reading?.state === "loading"}>
          {t("Why did it fire?")}
        </button>
        <button
          onClick={() => {
            app.state.wantedRule.value = event.rule;
            app.state.tab.value = "rules";
          }}
        >
          {t("The rule")}
        </button>
      </div>
      {reading?.state === "loading" && <p class="soft">{t("Running the rule over that time …")}</p>}
      {reading?.state === "failed" && <Failed problem={reading.problem} />}
      {reading?.state === "there" && (
        <pre class="why" tabIndex={0}>
          {withClock(reading.value.lines.join("\n"))}
        </pre>
      )}
    </section>
  );
}
