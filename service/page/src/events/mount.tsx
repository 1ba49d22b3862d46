/** What has happened on the map: as it comes and as far back as one looks, all of it or what is searched for. */

import "./events.css";

import { render } from "preact";

import type { EventDocument } from "../documents";
import type { App } from "../app";
import { Failed } from "../details/parts";
import { VirtualList } from "../panel/virtual_list";
import { trackColourName } from "../scene/colours";
import { clockText, dateText, momentText } from "../timeline/clock";
import { sentenceOf } from "../words";
import { EVERYTHING, isEverything } from "./filter";
import { FilterFields } from "./filter_fields";
import { openEvent } from "./open";
import { Saving } from "./saving";
import { EventSearch } from "./search";
import { say, t } from "../language/catalogue";

export function mount(element: HTMLElement, app: App): void {
  const search = new EventSearch(app.api, app.state);
  render(<Events app={app} search={search} />, element);
  search.start();
}

function Events({ app, search }: { app: App; search: EventSearch }) {
  if (app.state.map.value === null) return <p class="soft">{t("No map is shown.")}</p>;
  const events = search.found.value;
  const filter = app.state.eventFilter;
  return (
    <div class="event-panel">
      <FilterFields app={app} />
      <div class="row">
        {!isEverything(filter.value) && (
          <button onClick={() => (filter.value = EVERYTHING)}>{t("Show all events")}</button>
        )}
        {events.length > 0 && <Saving app={app} search={search} />}
      </div>
      {search.problem.value !== null && <Failed problem={search.problem.value} />}
      {events.length === 0 && <None app={app} search={search} />}
      {events.length > 0 && (
        <VirtualList
          items={events}
          keyOf={(each) => each.event_id}
          row={(event, before) => <EventButton app={app} event={event} before={before} />}
          label={t("Newest events first")}
          id="event-list"
          hasMore={search.hasMore}
          more={() => void search.more()}
        />
      )}
      {events.length > 0 && <End search={search} />}
    </div>
  );
}

function None({ app, search }: { app: App; search: EventSearch }) {
  if (search.isReading.value) return <p class="soft">{t("Being read …")}</p>;
  if (search.isInVain.value) return <End search={search} />;
  if (search.problem.value !== null) return null;
  if (!isEverything(app.state.eventFilter.value))
    return <p class="soft">{t("Nothing like that has happened.")}</p>;
  if (app.state.connection.value.state !== "live") return <p class="note unread">{t("Not read yet.")}</p>;
  return (
    <p class="soft">
      {t("Nothing has happened yet. Events come here, and onto the timeline, as rules find them.")}
    </p>
  );
}

/** How far back it was looked, where nothing was found for long. */
function End({ search }: { search: EventSearch }) {
  if (!search.isInVain.value) return null;
  return (
    <p class="row">
      <span class="soft">{say("Looked back to {0}.", momentText(search.reached.value!))}</span>
      <button onClick={() => void search.more(true)}>{t("Look further")}</button>
    </p>
  );
}

function EventButton({
  app,
  event,
  before,
}: {
  app: App;
  event: EventDocument;
  before: EventDocument | undefined;
}) {
  const selection = app.state.selection.value;
  const at = Date.parse(event.stamp);
  const isNewDay = before === undefined || dateText(Date.parse(before.stamp)) !== dateText(at);
  return (
    <button
      aria-pressed={selection?.kind === "event" && selection.event.event_id === event.event_id}
      onClick={() => openEvent(app, event)}
    >
      <span class="when number">
        <time dateTime={event.stamp} title={momentText(at)}>
          {clockText(at, 100)}
        </time>
        {isNewDay && <span class="soft">{dateText(at)}</span>}
      </span>
      <span class="what">
        {event.track && <i class="dot" style={{ background: trackColourName(event.track.id) }} />}
        <span class={event.cause === null ? "complex" : ""}>{sentenceOf(event, app.state.map.value)}</span>
      </span>
      {event.verdict === "retracted" && <span class="chip">{t("retracted")}</span>}
    </button>
  );
}
