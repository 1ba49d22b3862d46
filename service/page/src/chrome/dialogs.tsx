/** Help and sign-in. */

import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";

import type { App } from "../app";
import { Tour, tourAt } from "../welcome/tour";
import { isHelpOpen, isSignInOpen } from "./head";
import { KEYS } from "./keys";
import { language, LANGUAGES, say, speak, t, type Language } from "../language/catalogue";

export function Dialogs({ app, signedIn }: { app: App; signedIn: () => void }) {
  return (
    <>
      <Dialog isOpen={isHelpOpen.value} close={() => (isHelpOpen.value = false)} title={t("Keys")}>
        <Help />
      </Dialog>
      <Dialog
        isOpen={isSignInOpen.value}
        close={() => (isSignInOpen.value = false)}
        title={t("Sign in")}
        hasField
      >
        <SignIn app={app} signedIn={signedIn} />
      </Dialog>
      <Tour app={app} />
    </>
  );
}

interface DialogProps {
  isOpen: boolean;
  close: () => void;
  title: string;
  /** It has a field that is typed into first; else it begins at its title. */
  hasField?: boolean;
  children: ComponentChildren;
}

function Dialog({ isOpen, close, title, hasField = false, children }: DialogProps) {
  const element = useRef<HTMLDialogElement>(null);
  useEffect(() => {
    if (isOpen) element.current?.showModal();
    else element.current?.close();
  }, [isOpen]);
  return (
    <dialog
      ref={element}
      aria-label={title}
      onClose={close}
      onClick={(event) => event.target === element.current && close()}
    >
      {isOpen && (
        <>
          <h2 tabIndex={-1} autofocus={!hasField}>
            {title}
          </h2>
          {children}
        </>
      )}
    </dialog>
  );
}

function Help() {
  return (
    <>
      <table class="plain keys">
        <tbody>
          {KEYS.map(([keys, meaning]) => (
            <tr key={meaning}>
              <th scope="row">
                {keys.map((key) => (
                  <kbd key={key}>{key}</kbd>
                ))}
              </th>
              <td>{meaning}</td>
            </tr>
          ))}
        </tbody>
      </table>
      <label class="field">
        <span>{t("Language")}</span>
        <select value={language} onChange={(event) => speak(event.currentTarget.value as Language)}>
          {Object.entries(LANGUAGES).map(([tag, name]) => (
            <option key={tag} value={tag} lang={tag}>
              {name}
            </option>
          ))}
        </select>
      </label>
      <p class="soft help-links">
        {say(
          "The API behind this page: {0}, {1}.",
          <a href="/docs">/docs</a>,
          <a href="/openapi.json">/openapi.json</a>,
        )}
      </p>
      <footer>
        <button
          onClick={() => {
            isHelpOpen.value = false;
            tourAt.value = 0;
          }}
        >
          {t("Take the tour")}
        </button>
        <button class="primary" onClick={() => (isHelpOpen.value = false)}>
          {t("Close")}
        </button>
      </footer>
    </>
  );
}

function SignIn({ app, signedIn }: { app: App; signedIn: () => void }) {
  const [text, setText] = useState("");
  const problem = app.state.unauthorised.value;
  const hasToken = app.api.token !== null;
  return (
    <form
      class="stack"
      onSubmit={(event) => {
        event.preventDefault();
        app.api.token = text.trim();
        signedIn();
      }}
    >
      <p class="soft">
        {say(
          "This service asks for a token, such as {0} makes. It is kept in this tab only, until the tab is closed.",
          <code>semap token add NAME --scope read</code>,
        )}
      </p>
      {problem && hasToken && (
        <p class="note bad" role="alert">
          {problem.detail} {problem.remedy}
        </p>
      )}
      <label class="field">
        <span>{t("Token")}</span>
        <input
          id="token"
          type="password"
          autocomplete="off"
          spellcheck={false}
          placeholder="semap_…"
          autofocus
          value={text}
          onInput={(event) => setText(event.currentTarget.value)}
        />
      </label>
      <footer>
        {hasToken && (
          <button
            type="button"
            onClick={() => {
              app.api.token = null;
              location.reload();
            }}
          >
            {t("Sign out")}
          </button>
        )}
        <button class="primary" disabled={!/^[\x21-\x7e]+$/.test(text.trim())}>
          {t("Sign in")}
        </button>
      </footer>
    </form>
  );
}
