/** Which day is shown: the one before, the one after, or any by its date. The moment shown goes along. */

import type { App } from "../app";
import { Icon } from "../chrome/icons";
import { dayText, timeText } from "../timeline/clock";
import { momentFrom } from "../timeline/day";
import { t } from "../language/catalogue";

/** shown  the moment on whose day it is */
export function DayChoice({ app, shown }: { app: App; shown: number }) {
  const date = dayText(shown);
  /** The same time of another day; months and years carry over. */
  const show = (day: string, by = 0): void => {
    const moment = momentFrom(day, timeText(shown, 1000));
    if (moment === null) return;
    const noon = momentFrom(day, "12:00")! + by * 86_400_000;
    app.moveTo(by === 0 ? moment : momentFrom(dayText(noon), timeText(shown, 1000)));
  };
  return (
    <div class="day-choice">
      <button class="icon" aria-label={t("The day before")} onClick={() => show(date, -1)}>
        <Icon name="earlier" />
      </button>
      <input
        type="date"
        aria-label={t("Day")}
        value={date}
        onChange={(event) => show(event.currentTarget.value)}
      />
      <button class="icon" aria-label={t("The day after")} onClick={() => show(date, 1)}>
        <Icon name="later" />
      </button>
    </div>
  );
}
