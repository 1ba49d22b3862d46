/** What a token may not do is shown as not allowed, with the scope that would. */

import type { ComponentChildren } from "preact";

import type { CallerDocument } from "../documents";
import type { App } from "../app";

interface GuardedProps {
  app: App;
  /** What is done there, as a sentence begins: Editing. */
  what: string;
  /** Whether it is about what all maps share. */
  isShared?: boolean;
  children: ComponentChildren;
}

/** Buttons and fields that change something: without the right to, they cannot be used, and it is said why. */
export function Guarded({ app, what, isShared = false, children }: GuardedProps) {
  const lack = lackOf(app.state.caller.value, isShared);
  return (
    <>
      {lack !== null && (
        <p class="note" role="note">
          {what} is not allowed with the token {app.state.caller.value!.name}: {lack}
        </p>
      )}
      <fieldset class="bare" disabled={lack !== null}>
        {children}
      </fieldset>
    </>
  );
}

/** null: it may write, as far as is known. */
export function lackOf(caller: CallerDocument | null, isShared: boolean): string | null {
  if (caller === null) return null;
  if (!caller.scopes.includes("write")) return "sign in with one that has the scope write.";
  return isShared && caller.maps !== null ? "sign in with one for all maps." : null;
}
