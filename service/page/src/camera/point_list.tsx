import { Metres } from "../edit/corners";
import type { Mark, Placing, Side } from "./placing";

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
      <ol class="points" aria-label="Points">
        {marks.map((mark, i) => (
          <PointRow key={i} placing={placing} mark={mark} index={i} />
        ))}
      </ol>
      {picture && (
        <p>
          <button type="button" onClick={add}>
            Add a point in the middle
          </button>
        </p>
      )}
    </>
  );
}

const SIDES: readonly [Side, string, string][] = [
  ["pixel", "in the picture", "px"],
  ["place", "on the plan", "m"],
];

function PointRow({ placing, mark, index }: { placing: Placing; mark: Mark; index: number }) {
  const off_px = placing.off_px.value[index] ?? null;
  return (
    <li>
      <strong>{index + 1}</strong>
      {SIDES.map(([side, title, unit]) => {
        const at = mark[side];
        if (at === null) return <span key={side} class={`pair ${side}-pair soft`}>{`not ${title} yet`}</span>;
        return (
          <span key={side} class={`pair ${side}-pair`}>
            {([0, 1] as const).map((axis) => (
              <Metres
                key={axis}
                label={`${"xy"[axis]} of point ${index + 1} ${title}`}
                value={at[axis]}
                set={(value) => placing.move(index, side, axis === 0 ? [value, at[1]] : [at[0], value])}
              />
            ))}
            {unit}
          </span>
        );
      })}
      <span class={off_px !== null && placing.isFar(off_px) ? "off far" : "off"}>
        {off_px !== null && (Number.isFinite(off_px) ? `${off_px.toFixed(1)} px off` : "behind the camera")}
      </span>
      <button
        type="button"
        class="plain icon"
        aria-label={`Remove point ${index + 1}`}
        onClick={() => placing.remove(index)}
      >
        ×
      </button>
    </li>
  );
}
