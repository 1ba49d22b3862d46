import { useLayoutEffect, useRef } from "preact/hooks";

import type { Fault } from "../documents";
import { offsetOf, withNewLine } from "./text";

interface EditorProps {
  text: string;
  set: (text: string) => void;
  fault: Fault | null;
  /** The id of the element that says what is wrong. */
  describedBy: string;
}

/** Text with numbered lines, and a mark at what is wrong. Tab leaves it, as it leaves every field. */
export function Editor({ text, set, fault, describedBy }: EditorProps) {
  const area = useRef<HTMLTextAreaElement>(null);
  const marks = useRef<HTMLDivElement>(null);
  const caret = useRef<number | null>(null);
  const lines = text.split("\n").length;
  useLayoutEffect(() => {
    if (caret.current === null) return;
    area.current?.setSelectionRange(caret.current, caret.current);
    caret.current = null;
  });
  const breakLine = (event: KeyboardEvent): void => {
    const { current } = area;
    if (event.key !== "Enter" || event.ctrlKey || event.isComposing || current === null) return;
    event.preventDefault();
    const broken = withNewLine(text, current.selectionStart, current.selectionEnd);
    caret.current = broken.caret;
    set(broken.text);
  };
  return (
    <div class="editor" style={{ "--lines": String(Math.max(lines, 8)) }}>
      <pre class="numbers" aria-hidden="true">
        {Array.from({ length: lines }, (_, i) => (
          <span key={i} class={fault?.line === i + 1 ? "faulty" : ""}>
            {i + 1}
            {"\n"}
          </span>
        ))}
      </pre>
      <div class="written">
        <div class="marks" ref={marks} aria-hidden="true">
          {fault?.line != null && (
            <i style={{ "--line": String(fault.line - 1), "--column": String((fault.column ?? 1) - 1) }} />
          )}
        </div>
        <textarea
          ref={area}
          value={text}
          spellcheck={false}
          autocapitalize="off"
          autocomplete="off"
          wrap="off"
          aria-label="The rule as YAML"
          aria-invalid={fault !== null}
          aria-describedby={describedBy}
          onInput={(event) => set(event.currentTarget.value)}
          onKeyDown={breakLine}
          onScroll={(event) =>
            marks.current?.style.setProperty("--scrolled", `${event.currentTarget.scrollLeft}px`)
          }
        />
      </div>
    </div>
  );
}

/** What is wrong, and where; a click goes there. */
export function FaultLine({ fault, text }: { fault: Fault; text: string }) {
  const go = (): void => {
    const area = document.querySelector<HTMLTextAreaElement>(".editor textarea");
    const at = fault.line === null ? 0 : offsetOf(text, fault.line, fault.column ?? 1);
    area?.focus();
    area?.setSelectionRange(at, at);
  };
  return (
    <>
      <button type="button" class="plain place" onClick={go}>
        {fault.where || "The rule"}
      </button>
      <p>
        <strong>{fault.message}</strong>
      </p>
      {fault.remedy && <p>{fault.remedy}</p>}
    </>
  );
}
