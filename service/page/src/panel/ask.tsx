import { render } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { t } from "../language/catalogue";

export interface Choice<T extends string> {
  value: T;
  label: string;
  isDanger?: boolean;
}

interface Question<T extends string> {
  title: string;
  text: string;
  choices: readonly Choice<T>[];
}

/** Asks in a dialog; resolves with what was chosen, or with null where it was put away. */
export function ask<T extends string>(question: Question<T>): Promise<T | null> {
  const place = document.body.appendChild(document.createElement("div"));
  return new Promise((resolve) => {
    const answer = (chosen: T | null): void => {
      render(null, place);
      place.remove();
      resolve(chosen);
    };
    render(<Dialog question={question} answer={answer} />, place);
  });
}

function Dialog<T extends string>({
  question,
  answer,
}: {
  question: Question<T>;
  answer: (chosen: T | null) => void;
}) {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => dialog.current?.showModal(), []);
  const close = (chosen: T | null): void => {
    // Closed by itself, the browser gives the focus back to where it was.
    dialog.current?.close();
    answer(chosen);
  };
  return (
    <dialog
      ref={dialog}
      aria-labelledby="question"
      onCancel={(event) => {
        event.preventDefault();
        close(null);
      }}
    >
      <h2 id="question">{question.title}</h2>
      <p>{question.text}</p>
      <footer>
        <button type="button" onClick={() => close(null)}>
          {t("Cancel")}
        </button>
        {question.choices.map((choice) => (
          <button
            key={choice.value}
            type="button"
            class={choice.isDanger ? "danger" : "primary"}
            onClick={() => close(choice.value)}
          >
            {choice.label}
          </button>
        ))}
      </footer>
    </dialog>
  );
}
