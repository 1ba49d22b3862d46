/** The line between the map and the timeline, which is dragged, or moved by arrow keys. */

import { useState } from "preact/hooks";
import { t } from "../language/catalogue";

const LEAST_PX = 120;
const STEP_PX = 24;

export function Divider() {
  const [height_px, setHeight] = useState<number | null>(null);
  const resize = (to_px: number): void => {
    const next = Math.round(Math.min(Math.max(to_px, LEAST_PX), innerHeight * 0.7));
    document.body.style.setProperty("--time", `${next}px`);
    setHeight(next);
  };
  const current = (): number => document.getElementById("time")!.clientHeight;
  return (
    <div
      class="divider"
      role="separator"
      tabIndex={0}
      aria-label={t("Height of the timeline")}
      aria-orientation="horizontal"
      aria-valuemin={LEAST_PX}
      aria-valuenow={height_px ?? current()}
      onPointerDown={(event) => event.currentTarget.setPointerCapture(event.pointerId)}
      onPointerMove={(event) =>
        event.currentTarget.hasPointerCapture(event.pointerId) && resize(innerHeight - event.clientY)
      }
      onKeyDown={(event) => {
        const by = { ArrowUp: STEP_PX, ArrowDown: -STEP_PX }[event.key];
        if (by === undefined) return;
        event.preventDefault();
        resize(current() + by);
      }}
    />
  );
}
