/** The storeys as pills on the map, the highest first, each with how many people are on it at the moment shown. */

import type { World } from "../live/world";
import type { MapModel } from "../map/model";
import type { Showing } from "../showing";
import type { State } from "../state";
import { t } from "../language/catalogue";

export function Storeys({ state, showing }: { state: State; showing: Showing }) {
  const map = state.map.value;
  if (map === null || map.storeys.length < 2) return null;
  void showing.beat.value;
  const heads = state.isKnown.value ? headsOf(state.isLive.value ? showing.now : showing.then, map) : null;
  const isAll = state.storey.value === null;
  const show = (storey: string | null): void => {
    if (storey === null) state.view.value = "space";
    state.storey.value = storey;
  };
  return (
    <div class="storeys" id="storeys" role="group" aria-label={t("Storey")}>
      <Pill name={t("All storeys")} heads={heads?.all} isShown={isAll} show={() => show(null)} />
      {isAll && (
        <button
          class="pill apart"
          aria-pressed={state.isApart.value}
          onClick={() => (state.isApart.value = !state.isApart.value)}
        >
          {t("Pull apart")}
        </button>
      )}
      {map.storeys.toReversed().map(({ name }) => (
        <Pill
          key={name}
          name={name}
          heads={heads && (heads.by.get(name) ?? 0)}
          isShown={state.storey.value === name}
          show={() => show(name)}
        />
      ))}
    </div>
  );
}

interface PillProps {
  name: string;
  /** Not known where there are none. */
  heads: number | null | undefined;
  isShown: boolean;
  show: () => void;
}

function Pill({ name, heads, isShown, show }: PillProps) {
  return (
    <button class="pill" aria-pressed={isShown} title={name} onClick={show}>
      <span>{name}</span>
      <i class="visually-hidden">{t("people:")}</i>
      <b class="number">{heads ?? "–"}</b>
    </button>
  );
}

/** Each is counted once on a storey, in however many of its rooms, and once in all. */
function headsOf(world: World, map: MapModel): { all: number; by: ReadonlyMap<string, number> } {
  const by = new Map<string, number>();
  let all = 0;
  for (const { state } of world.movers.values()) {
    const storeys = new Set(state.rooms.map((id) => map.byId.get(id)?.storey));
    for (const each of storeys) if (each) by.set(each, (by.get(each) ?? 0) + 1);
    if (storeys.size > 0) all++;
  }
  return { all, by };
}
