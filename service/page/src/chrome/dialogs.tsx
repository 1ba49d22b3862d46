/** Help and sign-in. */

import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";

import type { App } from "../app";
import { Tour, tourAt } from "../welcome/tour";
import { isHelpOpen, isSignInOpen } from "./head";
import { KEYS } from "./keys";

export function Dialogs({ app, signedIn }: { app: App; signedIn: () => void }) {
  return (
    <>
      <Dialog isOpen={isHelpOpen.value} close={() => (isHelpOpen.value = false)} title="Keys">
        <Help />
      </Dialog>
      <Dialog isOpen={isSignInOpen.value} close={() => (isSignInOpen.value = false)} title="Sign in" hasField>
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
      <p class="soft help-links">
        The API behind this page: <a href="/docs">/docs</a>, <a href="/openapi.json">/openapi.json</a>.
      </p>
      <footer>
        <button
          onClick={() => {
            isHelpOpen.value = false;
            tourAt.value = 0;
          }}
        >
          Take the tour
        </button>
        <button class="primary" onClick={() => (isHelpOpen.value = false)}>
          Close
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
        This service asks for a token, such as <code>semap token add NAME --scope read</code> makes. It is
        kept in this tab only, until the tab is closed.
      </p>
      {problem && hasToken && (
        <p class="note bad" role="alert">
          {problem.detail} {problem.remedy}
        </p>
      )}
      <label class="field">
        <span>Token</span>
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
            Sign out
          </button>
        )}
        <button class="primary" disabled={!/^[\x21-\x7e]+$/.test(text.trim())}>
          Sign in
        </button>
      </footer>
    </form>
  );
}
