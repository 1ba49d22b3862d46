/** A long list of rows of one height: only those in sight are in the document. One stop of the tab key; arrow keys. */

import type { ComponentChildren } from "preact";
import { useLayoutEffect, useRef, useState } from "preact/hooks";

/** Rows beyond the edges that are there all the same, for keys and for quick scrolling. */
const BEYOND = 10;
const ROW_REM = 3.25;

interface VirtualListProps<T> {
  items: readonly T[];
  keyOf: (item: T) => string;
  /** A button. */
  row: (item: T, before: T | undefined) => ComponentChildren;
  label: string;
  id: string;
  /** Whether there are more than those that are here. */
  hasMore: boolean;
  /** The end is near. */
  more: () => void;
}

export function VirtualList<T>({ items, keyOf, row, label, id, hasMore, more }: VirtualListProps<T>) {
  const place = useRef<HTMLDivElement>(null);
  const [sight, setSight] = useState({ top: 0, height: 0 });
  const [stop, setStop] = useState("");
  const wanted = useRef<number | null>(null);
  const row_px = ROW_REM * parseFloat(getComputedStyle(document.documentElement).fontSize);
  const first = Math.max(0, Math.min(items.length, Math.floor(sight.top / row_px)) - BEYOND);
  const last = Math.min(items.length, Math.ceil((sight.top + sight.height) / row_px) + BEYOND);
  const look = (): void => {
    const { scrollTop: top, clientHeight: height } = place.current!;
    setSight((was) => (was.top === top && was.height === height ? was : { top, height }));
  };
  useLayoutEffect(() => {
    const observer = new ResizeObserver(look);
    observer.observe(place.current!);
    look();
    return () => observer.disconnect();
  }, []);
  useKeptInSight(place, items.map(keyOf), row_px);
  useLayoutEffect(() => {
    if (hasMore && last >= items.length - BEYOND) more();
  });
  useLayoutEffect(() => {
    const button = wanted.current === null ? null : buttonAt(place.current!, wanted.current);
    if (button === null) return;
    wanted.current = null;
    button.focus();
  });
  const go = (event: KeyboardEvent): void => {
    const at = Number((event.target as HTMLElement).closest("li")?.dataset["at"] ?? NaN);
    const page = Math.max(1, Math.floor(sight.height / row_px) - 1);
    const by = { ArrowDown: 1, ArrowUp: -1, PageDown: page, PageUp: -page, Home: -at, End: items.length }[
      event.key
    ];
    if (Number.isNaN(at) || by === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    const to = Math.min(Math.max(at + by, 0), items.length - 1);
    const { scrollTop, clientHeight } = place.current!;
    place.current!.scrollTop = Math.min(Math.max(scrollTop, (to + 1) * row_px - clientHeight), to * row_px);
    wanted.current = to;
    setStop(keyOf(items[to]!));
    look();
  };
  const shown = items.slice(first, last);
  const stopKey = shown.some((each) => keyOf(each) === stop) ? stop : shown.length > 0 && keyOf(shown[0]!);
  return (
    <div class="virtual" ref={place} onScroll={look}>
      <ol
        id={id}
        aria-label={label}
        style={{
          height: `${items.length * row_px}px`,
          paddingTop: `${first * row_px}px`,
          "--row": `${row_px}px`,
        }}
        onKeyDown={go}
        onFocusIn={(event: FocusEvent) => {
          const at = (event.target as HTMLElement).closest("li")?.dataset["at"];
          if (at !== undefined && items[Number(at)]) setStop(keyOf(items[Number(at)]!));
        }}
      >
        {shown.map((each, i) => (
          <li
            key={keyOf(each)}
            data-at={first + i}
            data-stop={keyOf(each) === stopKey}
            aria-setsize={hasMore ? -1 : items.length}
            aria-posinset={first + i + 1}
            ref={(element) => {
              const button = element?.querySelector("button");
              if (button) button.tabIndex = keyOf(each) === stopKey ? 0 : -1;
            }}
          >
            {row(each, items[first + i - 1])}
          </li>
        ))}
      </ol>
    </div>
  );
}

/** What is in sight stays there when there is more before it; at its beginning the list shows what is new. */
function useKeptInSight(
  place: { current: HTMLDivElement | null },
  keys: readonly string[],
  row_px: number,
): void {
  const before = useRef<readonly string[]>([]);
  useLayoutEffect(() => {
    const was = before.current;
    before.current = keys;
    const top = place.current!.scrollTop;
    if (top === 0 || was === keys || was[0] === keys[0]) return;
    const at = Math.floor(top / row_px);
    const now = keys.indexOf(was[at] ?? "");
    if (now >= 0) place.current!.scrollTop = top + (now - at) * row_px;
  });
}

function buttonAt(place: HTMLElement, at: number): HTMLElement | null {
  return place.querySelector<HTMLElement>(`li[data-at="${at}"] button`);
}
