/** What the page says for a moment, and what it tells screen readers of events. */

import { signal } from "@preact/signals";

const SHOWN_MS = 5000;

interface Notice {
  id: number;
  text: string;
  kind: "done" | "error";
}

const notices = signal<readonly Notice[]>([]);
const told = signal("");
let next = 0;

export function announce(text: string, kind: "done" | "error" = "done"): void {
  const notice = { id: next++, text, kind };
  notices.value = [...notices.value.slice(-2), notice];
  setTimeout(() => (notices.value = notices.value.filter((each) => each !== notice)), SHOWN_MS);
}

/** Says something to screen readers only. */
export function tell(text: string): void {
  told.value = text;
}

export function Notices() {
  return (
    <>
      <div role="status" aria-live="polite" class="notice-list">
        {notices.value.map(({ id, text, kind }) => (
          <div key={id} class={`notice ${kind}`}>
            {text}
          </div>
        ))}
      </div>
      <div class="visually-hidden" aria-live="polite" id="told">
        {told.value}
      </div>
    </>
  );
}
