/** What a token may not do is shown as not allowed, with the scope that would. */

import type { ComponentChildren } from "preact";

import type { CallerDocument } from "../documents";
import type { App } from "../app";
import { say, t } from "../language/catalogue";

interface GuardedProps {
  app: App;
  /** What is done there, as a sentence begins: Editing. */
  what: string;
  /** Whether it is about what all maps share. */
  isShared?: boolean;
  /** What a token must allow for it. */
  scope?: "write" | "admin";
  children: ComponentChildren;
}

/** Buttons and fields that change something: without the right to, they cannot be used, and it is said why. */
export function Guarded({ app, what, isShared = false, scope = "write", children }: GuardedProps) {
  const lack = lackOf(app.state.caller.value, isShared, scope);
  return (
    <>
      {lack !== null && (
        <p class="note" role="note">
          {say("{0} is not allowed with the token {1}: {2}", what, app.state.caller.value!.name, lack)}
        </p>
      )}
      <fieldset class="bare" disabled={lack !== null}>
        {children}
      </fieldset>
    </>
  );
}

/** null: it may do it, as far as is known. */
export function lackOf(
  caller: CallerDocument | null,
  isShared: boolean,
  scope: "write" | "admin" = "write",
): string | null {
  if (caller === null) return null;
  if (!caller.scopes.includes(scope)) return t("sign in with one that has the scope {0}.", scope);
  return isShared && caller.maps !== null ? t("sign in with one for all maps.") : null;
}
