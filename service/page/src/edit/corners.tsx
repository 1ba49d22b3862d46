import { useState } from "preact/hooks";

import type { Point } from "../map/model";
import type { Editing } from "./editing";
import { metres } from "./outline";
import { t } from "../language/catalogue";

/** The corners of what is drawn, as numbers: for exactness, and for those who do not use the pointer. */
export function Corners({ editing }: { editing: Editing }) {
  const draft = editing.draft.value;
  const rings = draft?.kind === "room" ? [draft.corners] : draft?.kind === "shape" ? draft.rings : [];
  return (
    <details class="corners">
      <summary>{t("Corners in metres")}</summary>
      {rings.map((corners, ring) => (
        <table
          key={ring}
          class="corners"
          aria-label={ring === 0 ? t("Corners") : t("Corners of hole {0}", ring)}
        >
          <thead>
            <tr>
              <th scope="col">x</th>
              <th scope="col">y</th>
              <th scope="col">
                <span class="visually-hidden">{t("Remove")}</span>
              </th>
            </tr>
          </thead>
          <tbody>
            {corners.map((corner, i) => (
              <Corner key={i} editing={editing} ring={ring} corners={corners} index={i} corner={corner} />
            ))}
          </tbody>
        </table>
      ))}
      {draft?.kind === "room" && (
        <button
          type="button"
          onClick={() => editing.setRing(0, [...draft.corners, draft.corners.at(-1) ?? [0, 0]])}
        >
          {t("Add a corner")}
        </button>
      )}
    </details>
  );
}

interface CornerProps {
  editing: Editing;
  ring: number;
  corners: readonly Point[];
  index: number;
  corner: Point;
}

function Corner({ editing, ring, corners, index, corner }: CornerProps) {
  const set = (axis: 0 | 1, value: number): void => {
    const moved: Point = axis === 0 ? [value, corner[1]] : [corner[0], value];
    editing.setRing(
      ring,
      corners.map((each, i) => (i === index ? moved : each)),
    );
  };
  return (
    <tr>
      {([0, 1] as const).map((axis) => (
        <td key={axis}>
          <Metres
            label={t("{0} of corner {1}", axis === 0 ? "x" : "y", index + 1)}
            value={corner[axis]}
            set={(value) => set(axis, value)}
          />
        </td>
      ))}
      <td>
        <button
          type="button"
          class="plain icon"
          aria-label={t("Remove corner {0}", index + 1)}
          onClick={() => editing.removeCorner(ring, index)}
        >
          ×
        </button>
      </td>
    </tr>
  );
}

interface MetresProps {
  label: string;
  value: number;
  set: (value: number) => void;
  min?: number;
}

/** A number of metres; what is no number yet is kept as it is typed and changes nothing. */
export function Metres({ label, value, set, min }: MetresProps) {
  const [typed, setTyped] = useState<string | null>(null);
  return (
    <input
      type="number"
      step="0.01"
      aria-label={label}
      {...(min !== undefined && { min })}
      value={typed ?? String(metres(value))}
      onInput={(event) => {
        const text = event.currentTarget.value;
        setTyped(text);
        const number = event.currentTarget.valueAsNumber;
        if (Number.isFinite(number) && (min === undefined || number >= min)) set(number);
      }}
      onBlur={() => setTyped(null)}
    />
  );
}
