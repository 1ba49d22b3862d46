/** A picture or a plan with points on it, that are put by a click and moved by dragging or with arrow keys. */

import type { ComponentChildren } from "preact";
import { useRef, useState } from "preact/hooks";

import { clamp } from "../edit/plane";
import type { Point } from "../map/model";
import { t } from "../language/catalogue";

/** Right and down, each from 0 to 1. */
export type Fraction = Point;

interface PaneProps {
  title: string;
  /** Which side of a point is here, as in "Point 1 in the picture". */
  where: string;
  /** Width by height. */
  ratio: number;
  marks: readonly (Fraction | null)[];
  put(at: Fraction, reach: Fraction): void;
  move(index: number, at: Fraction, reach: Fraction): void;
  /** By steps of arrow keys, right and down. */
  step(index: number, steps: Point): void;
  remove(index: number): void;
  children: ComponentChildren;
}

const ARROWS: Readonly<Record<string, Point>> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, -1],
  ArrowDown: [0, 1],
};
const FAR = 10;
const ZOOMS = [1, 2, 4, 8];
const REACH_PX = 10;

export function Pane({ title, where, ratio, marks, put, move, step, remove, children }: PaneProps) {
  const sheet = useRef<HTMLDivElement>(null);
  const [zoom, setZoom] = useState(0);
  /** Where the pointer is, and how much of the pane is near it. */
  const fractions = (event: MouseEvent): [Fraction, Fraction] => {
    const { left, top, width, height } = sheet.current!.getBoundingClientRect();
    return [
      [clamp((event.clientX - left) / width, 0, 1), clamp((event.clientY - top) / height, 0, 1)],
      [REACH_PX / width, REACH_PX / height],
    ];
  };
  const press = (event: KeyboardEvent, index: number): void => {
    const arrow = ARROWS[event.key];
    if (arrow) step(index, event.shiftKey ? [FAR * arrow[0], FAR * arrow[1]] : arrow);
    else if (event.key === "Delete" || event.key === "Backspace") remove(index);
    else return;
    event.preventDefault();
    event.stopPropagation();
  };
  return (
    <section class="pane" aria-label={title}>
      <header class="row">
        <h3>{title}</h3>
        <span class="grow" />
        {([-1, 1] as const).map((by) => (
          <button
            key={by}
            type="button"
            class="icon"
            aria-label={`${title}: ${by < 0 ? t("smaller") : t("larger")}`}
            disabled={ZOOMS[zoom + by] === undefined}
            onClick={() => setZoom(zoom + by)}
          >
            {by < 0 ? "−" : "+"}
          </button>
        ))}
      </header>
      <div class="frame">
        <div
          ref={sheet}
          class="sheet"
          style={{ width: `${100 * ZOOMS[zoom]!}%`, aspectRatio: ratio }}
          onClick={(event) => put(...fractions(event))}
        >
          {children}
          {marks.map(
            (mark, i) =>
              mark && (
                <button
                  key={i}
                  type="button"
                  class="mark"
                  style={{ left: `${100 * mark[0]}%`, top: `${100 * mark[1]}%` }}
                  aria-label={t("Point {0} {1}", i + 1, where)}
                  onClick={(event) => event.stopPropagation()}
                  onKeyDown={(event) => press(event, i)}
                  onPointerDown={(event) => event.currentTarget.setPointerCapture(event.pointerId)}
                  onPointerMove={(event) => event.buttons > 0 && move(i, ...fractions(event))}
                >
                  <span>{i + 1}</span>
                </button>
              ),
          )}
        </div>
      </div>
    </section>
  );
}
