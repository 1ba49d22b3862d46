/** The icons of buttons, drawn in the colour of their text. */

const PATHS = {
  before: "M5 4v12M16 4 8 10l8 6z",
  after: "M15 4v12M4 4l8 6-8 6z",
  earlier: "M12 4 6 10l6 6",
  later: "M8 4l6 6-6 6",
  play: "M5 3.5 16 10 5 16.5z",
  pause: "M6.5 4v12M13.5 4v12",
  plus: "M10 4v12M4 10h12",
  minus: "M4 10h12",
  all: "M4 8V4h4M12 4h4v4M16 12v4h-4M8 16H4v-4",
  link: "M8.5 11.5a3.5 3.5 0 0 0 5 0l3-3a3.5 3.5 0 0 0-5-5l-1 1M11.5 8.5a3.5 3.5 0 0 0-5 0l-3 3a3.5 3.5 0 0 0 5 5l1-1",
  sun: "M10 6.5a3.5 3.5 0 1 0 0 7 3.5 3.5 0 0 0 0-7zM10 1.5v2M10 16.5v2M1.5 10h2M16.5 10h2M4 4l1.4 1.4M14.6 14.6 16 16M4 16l1.4-1.4M14.6 5.4 16 4",
  moon: "M16.5 11.8A7 7 0 1 1 8.2 3.5a5.6 5.6 0 0 0 8.3 8.3z",
  help: "M7 7.2a3 3 0 1 1 4.4 2.7c-.9.5-1.4 1-1.4 2.1M10 15.2v.1",
  close: "M3 4h14v12H3zM12 4v12M6 8l2 2-2 2",
  open: "M3 4h14v12H3zM12 4v12M8 8l-2 2 2 2",
} as const;

const FILLED = new Set(["play", "before", "after"]);
/** They point to a side, which is the other one where one reads from right to left. */
const SIDED = new Set(["earlier", "later", "close", "open"]);

export function Icon({ name }: { name: keyof typeof PATHS }) {
  return (
    <svg
      class={`icon-picture${FILLED.has(name) ? " filled" : ""}${SIDED.has(name) ? " sided" : ""}`}
      width="18"
      height="18"
      viewBox="0 0 20 20"
      aria-hidden="true"
    >
      <path d={PATHS[name]} />
    </svg>
  );
}
