/** A list with many buttons is one stop of the tab key; arrow keys go from one to the next. */

import type { ComponentChildren } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";

interface RovingProps {
  class: string;
  label?: string;
  isOrdered?: boolean;
  id?: string;
  children: ComponentChildren;
}

export function Roving({ class: name, label, isOrdered = false, id, children }: RovingProps) {
  const list = useRef<HTMLElement>(null);
  const buttons = (): HTMLElement[] => [...(list.current?.querySelectorAll<HTMLElement>("button") ?? [])];
  const stopAt = (chosen: HTMLElement | undefined): void => {
    for (const each of buttons()) each.tabIndex = each === chosen ? 0 : -1;
  };
  useLayoutEffect(() => {
    const all = buttons();
    const stops = all.filter((each) => each.tabIndex === 0);
    stopAt(all.find((each) => each === document.activeElement) ?? (stops.length === 1 ? stops[0] : all[0]));
  });
  const go = (event: KeyboardEvent): void => {
    const all = buttons();
    const at = all.indexOf(event.target as HTMLElement);
    const to = { ArrowDown: at + 1, ArrowUp: at - 1, Home: 0, End: all.length - 1 }[event.key];
    if (at < 0 || to === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    all[Math.min(Math.max(to, 0), all.length - 1)]?.focus();
  };
  const List = isOrdered ? "ol" : "ul";
  return (
    <List
      ref={list as never}
      class={name}
      id={id}
      aria-label={label}
      onKeyDown={go}
      onFocusIn={(event: FocusEvent) => event.target instanceof HTMLButtonElement && stopAt(event.target)}
    >
      {children}
    </List>
  );
}
