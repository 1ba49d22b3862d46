/** A day as a strip: in which room when, and which moment is shown. A click shows another. */

import type { App } from "../app";
import type { Span } from "../state";
import { timeText } from "../timeline/clock";
import { nameOf } from "./parts";
import { spanOf, type Day } from "./whereabouts";

const H_MS = 3_600_000;
/** A name that is wider than its stay is left out. */
const LEAST_NAMED = 0.12;

/** seen  as far as the strip reaches, widened to whole hours */
export function Strip({ app, day, seen }: { app: App; day: Day; seen: Span }) {
  const at = app.state.at.value;
  const [from, to] = [Math.floor(seen.from / H_MS) * H_MS, Math.ceil((seen.to + 1) / H_MS) * H_MS];
  const part = (moment: number): number => Math.min(1, Math.max(0, (moment - from) / (to - from)));
  const placed = (span: Span): { left: string; width: string } => ({
    left: `${100 * part(span.from)}%`,
    width: `${100 * (part(span.to) - part(span.from))}%`,
  });
  const show = (event: MouseEvent): void => {
    const box = (event.currentTarget as HTMLElement).getBoundingClientRect();
    app.moveTo(Math.round(from + ((event.clientX - box.left) / box.width) * (to - from)));
  };
  return (
    <div class="day-strip">
      <div class="bar" onClick={show} aria-hidden="true">
        {day.parts.map((each) => (
          <i key={spanOf(each).from} class="seen" style={placed(spanOf(each))} />
        ))}
        {day.stays.map((each) => (
          <span
            key={`${each.room} ${each.from}`}
            class="stay"
            style={placed(each)}
            title={nameOf(app, each.room, each.name)}
          >
            {part(each.to) - part(each.from) >= LEAST_NAMED && nameOf(app, each.room, each.name)}
          </span>
        ))}
        {at !== null && at >= from && at <= to && <b class="shown" style={{ left: `${100 * part(at)}%` }} />}
      </div>
      <div class="ends soft number" aria-hidden="true">
        <span>{timeText(from, 60_000)}</span>
        <span>{timeText(to, 60_000)}</span>
      </div>
    </div>
  );
}
