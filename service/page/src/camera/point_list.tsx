import { Metres } from "../edit/corners";
import type { Mark, Placing, Side } from "./placing";
import { fixed, t } from "../language/catalogue";

/** The points as numbers: for exactness, and for those who do not use the pointer. */
export function PointList({ placing }: { placing: Placing }) {
  const picture = placing.picture.value;
  const marks = placing.marks.value;
  const add = (): void => {
    const { xMin_m, xMax_m, yMin_m, yMax_m } = placing.bounds();
    if (picture) placing.put("pixel", [picture.size[0] / 2, picture.size[1] / 2]);
    placing.put("place", [(xMin_m + xMax_m) / 2, (yMin_m + yMax_m) / 2]);
  };
  return (
    <>
      <ol class="points" aria-label={t("Points")}>
        {marks.map((mark, i) => (
          <PointRow key={i} placing={placing} mark={mark} index={i} />
        ))}
      </ol>
      {picture && (
        <p>
          <button type="button" onClick={add}>
            {t("Add a point in the middle")}
          </button>
        </p>
      )}
    </>
  );
}

const SIDES: readonly [Side, string, string][] = [
  ["pixel", t("in the picture"), "px"],
  ["place", t("on the plan"), "m"],
];

function PointRow({ placing, mark, index }: { placing: Placing; mark: Mark; index: number }) {
  const off_px = placing.off_px.value[index] ?? null;
  return (
    <li>
      <strong>{index + 1}</strong>
      {SIDES.map(([side, title, unit]) => {
        const at = mark[side];
        if (at === null)
          return (
            <span key={side} class={`pair ${side}-pair soft`}>
              {t("not {0} yet", title)}
            </span>
          );
        return (
          <span key={side} class={`pair ${side}-pair`}>
            {([0, 1] as const).map((axis) => (
              <Metres
                key={axis}
                label={t("{0} of point {1} {2}", "xy"[axis], index + 1, title)}
                value={at[axis]}
                set={(value) => placing.move(index, side, axis === 0 ? [value, at[1]] : [at[0], value])}
              />
            ))}
            {unit}
          </span>
        );
      })}
      <span class={off_px !== null && placing.isFar(off_px) ? "off far" : "off"}>
        {off_px !== null &&
          (Number.isFinite(off_px) ? t("{0} px off", fixed(off_px, 1)) : t("behind the camera"))}
      </span>
      <button
        type="button"
        class="plain icon"
        aria-label={t("Remove point {0}", index + 1)}
        onClick={() => placing.remove(index)}
      >
        ×
      </button>
    </li>
  );
}
