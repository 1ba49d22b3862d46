import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";

import type { Fault, RuleWords } from "../documents";
import { completionAt, type Completion } from "./completion";
import { offsetOf, withNewLine } from "./text";
import { t } from "../language/catalogue";

interface EditorProps {
  text: string;
  set: (text: string) => void;
  fault: Fault | null;
  /** The id of the element that says what is wrong. */
  describedBy: string;
  /** null until they were read; nothing is completed before. */
  words: RuleWords | null;
}

/** What is offered, and which option the keys are at. */
type Offer = Completion & { at: number };

const LIST = "rule-completions";
const optionId = (i: number): string => `${LIST}-${i}`;

/**
 * Text with numbered lines, a mark and a word at what is wrong, and names that are completed as one types.
 * Tab leaves it, as it leaves every field.
 */
export function Editor({ text, set, fault, describedBy, words }: EditorProps) {
  const area = useRef<HTMLTextAreaElement>(null);
  const marks = useRef<HTMLDivElement>(null);
  const caret = useRef<number | null>(null);
  const [offer, setOffer] = useState<Offer | null>(null);
  const [caretLine, setCaretLine] = useState(0);
  const lines = text.split("\n");
  useLayoutEffect(() => {
    if (caret.current === null) return;
    area.current?.setSelectionRange(caret.current, caret.current);
    caret.current = null;
  });
  useLayoutEffect(() => {
    if (offer !== null) document.getElementById(optionId(offer.at))?.scrollIntoView({ block: "nearest" });
  }, [offer]);
  const look = (isAsked: boolean): void => {
    const { current } = area;
    if (current === null || words === null || current.selectionStart !== current.selectionEnd) return;
    const found = completionAt(current.value, current.selectionStart, words, isAsked);
    setOffer(found === null ? null : { ...found, at: 0 });
  };
  // Who began to write before the names were read gets them now.
  useEffect(() => {
    if (document.activeElement === area.current) look(false);
  }, [words]);
  const noteLine = (): void => {
    const { current } = area;
    if (current) setCaretLine(current.value.slice(0, current.selectionStart).split("\n").length);
  };
  const take = ({ from, to, options }: Completion, at: number): void => {
    const { inserted } = options[at]!;
    caret.current = from + inserted.length;
    setOffer(null);
    set(text.slice(0, from) + inserted + text.slice(to));
    area.current?.focus();
  };
  const breakLine = (): void => {
    const broken = withNewLine(text, area.current!.selectionStart, area.current!.selectionEnd);
    caret.current = broken.caret;
    set(broken.text);
  };
  const press = (event: KeyboardEvent): void => {
    if (event.isComposing) return;
    const moved = offer === null ? undefined : { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (event.key === " " && event.ctrlKey) look(true);
    else if (offer !== null && moved !== undefined)
      setOffer({ ...offer, at: (offer.at + moved + offer.options.length) % offer.options.length });
    else if (offer !== null && event.key === "Escape") setOffer(null);
    else if (event.key === "Enter" && !event.ctrlKey) {
      if (offer !== null) take(offer, offer.at);
      else breakLine();
    } else return;
    event.preventDefault();
    event.stopPropagation();
  };
  const line = fault?.line == null ? null : Math.min(fault.line, lines.length);
  return (
    <div class="editing">
      <div class="editor" style={{ "--lines": String(Math.max(lines.length, 8)) }}>
        <pre class="numbers" aria-hidden="true">
          {lines.map((_, i) => (
            <span key={i} class={line === i + 1 ? "faulty" : ""}>
              {i + 1}
              {"\n"}
            </span>
          ))}
        </pre>
        <div class="written">
          <div class="marks" ref={marks} aria-hidden="true">
            {fault !== null && line !== null && (
              <>
                <i style={{ "--line": String(line - 1), "--column": String((fault.column ?? 1) - 1) }} />
                <b
                  class={line === caretLine ? "typing" : ""}
                  style={{ "--line": String(line - 1), "--length": String(lines[line - 1]!.length) }}
                >
                  {fault.message}
                </b>
              </>
            )}
          </div>
          <textarea
            ref={area}
            value={text}
            spellcheck={false}
            autocapitalize="off"
            autocomplete="off"
            wrap="off"
            aria-label={t("The rule as YAML")}
            aria-invalid={fault !== null}
            aria-describedby={describedBy}
            aria-autocomplete="list"
            // A text of several lines may be no combobox: that it has a list is told while there is one.
            {...(offer !== null && {
              "aria-haspopup": "listbox",
              "aria-controls": LIST,
              "aria-activedescendant": optionId(offer.at),
            })}
            onInput={(event) => {
              set(event.currentTarget.value);
              noteLine();
              look(false);
            }}
            onKeyDown={press}
            onKeyUp={noteLine}
            onClick={() => {
              noteLine();
              setOffer(null);
            }}
            onBlur={() => setOffer(null)}
            onScroll={(event) =>
              marks.current?.style.setProperty("--scrolled", `${event.currentTarget.scrollLeft}px`)
            }
          />
        </div>
      </div>
      {offer !== null && (
        <ul
          id={LIST}
          class="completions"
          role="listbox"
          aria-label={t("Completions")}
          style={placeOf(text, offer.from, area.current)}
          // The text keeps the focus.
          onPointerDown={(event) => event.preventDefault()}
        >
          {offer.options.map(({ word, kind }, i) => (
            <li
              key={`${kind} ${word}`}
              id={optionId(i)}
              role="option"
              aria-selected={i === offer.at}
              onClick={() => take(offer, i)}
            >
              <span>{word}</span> <small>{kind}</small>
            </li>
          ))}
        </ul>
      )}
    </div>
  );
}

/** Below the line, where the word begins; a list that would leave the editor to the right is moved back by CSS. */
function placeOf(text: string, from: number, area: HTMLTextAreaElement | null): Record<string, string> {
  const before = text.slice(0, from);
  return {
    "--line": String(before.split("\n").length),
    "--column": String(from - before.lastIndexOf("\n") - 1),
    "--scrolled": `${area?.scrollLeft ?? 0}px`,
  };
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
        {fault.where || t("The rule")}
      </button>
      <p>
        <strong>{fault.message}</strong>
      </p>
      {fault.remedy && <p>{fault.remedy}</p>}
    </>
  );
}
