import { useLayoutEffect, useRef, useState } from "preact/hooks";

import type { RuleCheck } from "../documents";
import { CIRCLE, layOut, LINE, PAD, type Arrow, type Box } from "./layout";
import { t } from "../language/catalogue";

const USUAL_PX = 340;

/** What the rule does, drawn from the top down and in one sentence. */
export function Diagram({ check }: { check: RuleCheck }) {
  const place = useRef<HTMLElement>(null);
  const [width, setWidth] = useState(USUAL_PX);
  const isThere = check.diagram !== null;
  useLayoutEffect(() => {
    if (!place.current) return;
    const watch = new ResizeObserver(([entry]) =>
      setWidth(Math.max(Math.floor(entry!.contentRect.width), 200)),
    );
    watch.observe(place.current);
    return () => watch.disconnect();
  }, [isThere]);
  if (check.diagram === null) return null;
  const drawn = layOut(check.diagram, Math.min(width, 520));
  return (
    <figure class="diagram" ref={place}>
      <svg
        role="img"
        aria-label={t("The pattern: {0}", check.sentence ?? "")}
        width={drawn.width}
        height={drawn.height}
        viewBox={`0 0 ${drawn.width} ${drawn.height}`}
      >
        {drawn.arrows.map((arrow, i) => (
          <ArrowDown key={i} {...arrow} />
        ))}
        {drawn.boxes.map((box, i) => (
          <OneBox key={i} {...box} />
        ))}
      </svg>
      <figcaption class="soft">{check.sentence}</figcaption>
    </figure>
  );
}

function OneBox({ kind, x, y, width, height, label, lines }: Box) {
  const isGroup = kind === "group";
  const left = isGroup ? x + PAD : x + 2 * PAD + 2 * CIRCLE;
  const middle = y + height / 2;
  const top = isGroup ? y + PAD + LINE - 4 : middle - ((lines.length - 1) * LINE) / 2 + 4;
  return (
    <g class={kind}>
      <rect x={x} y={y} width={width} height={height} rx={isGroup ? 8 : 6} />
      {!isGroup && <circle cx={x + PAD + CIRCLE} cy={middle} r={CIRCLE} />}
      {!isGroup && (
        <text class="sign" x={x + PAD + CIRCLE} y={middle + 4} text-anchor="middle">
          {kind === "event" ? "!" : kind === "never" ? "✕" : label.slice(0, 2) || "•"}
        </text>
      )}
      <text x={left} y={top}>
        {lines.map((line, i) => (
          <tspan key={i} x={left} dy={i === 0 ? 0 : LINE}>
            {line}
          </tspan>
        ))}
      </text>
    </g>
  );
}

function ArrowDown({ x, from, to, lines, isDirect }: Arrow) {
  const isArrow = to > from;
  return (
    <g class="arrow">
      {isArrow && (
        <line x1={x} y1={from} x2={x} y2={to - 5} stroke-dasharray={isDirect ? undefined : "3 3"} />
      )}
      {isArrow && <path d={`M${x - 4} ${to - 7} L${x} ${to - 1} L${x + 4} ${to - 7} Z`} />}
      <text y={from + 17} text-anchor={isArrow ? "start" : "middle"}>
        {lines.map((line, i) => (
          <tspan key={i} x={isArrow ? x + 12 : x} dy={i === 0 ? 0 : LINE}>
            {line}
          </tspan>
        ))}
      </text>
    </g>
  );
}
