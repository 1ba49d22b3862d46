/** How the page stands with the service, as it changes with what happens. Pure: times are passed in. */

import type { Connection } from "../state";

export type Happening =
  | { kind: "asked" }
  | { kind: "snapshot" }
  | { kind: "lost"; now: number; retryAt: number }
  | { kind: "noticed" };

const FIRST_WAIT_MS = 400;
const LONGEST_WAIT_MS = 1_500;

/** The next state: what follows a loss is "resumed" until that was noticed. */
export function follow(connection: Connection, happening: Happening): Connection {
  switch (happening.kind) {
    case "asked":
      return connection.state === "disconnected" ? connection : { state: "loading" };
    case "snapshot":
      if (connection.state === "live") return connection;
      return { state: "live", resumed: connection.state === "disconnected" };
    case "lost":
      return {
        state: "disconnected",
        since: connection.state === "disconnected" ? connection.since : happening.now,
        retryAt: happening.retryAt,
      };
    case "noticed":
      return connection.state === "live" ? { state: "live", resumed: false } : connection;
  }
}

/** How long to wait before an attempt, the first being 0: twice as long each time, spread by `random` in [0, 1). */
export function waitBefore(attempt: number, random: number): number {
  return Math.min(LONGEST_WAIT_MS, FIRST_WAIT_MS * 2 ** attempt) * (0.75 + random / 2);
}
