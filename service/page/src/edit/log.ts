/** The history of the map, as far as the panel shows it and undo needs it. */

import { computed, signal } from "@preact/signals";

import type { ChangeSummary, Problem } from "../documents";
import type { App } from "../app";
import { problemOf } from "../panel/problem";
import { author } from "./author";
import { stepsOf } from "./history";
import { listChanges, undoChange } from "./writes";
import { t } from "../language/catalogue";

const AT_MOST = 100;

export class Log {
  readonly author = signal(author());
  /** The newest first; null until they were read. */
  readonly changes = signal<readonly ChangeSummary[] | null>(null);
  readonly problem = signal<Problem | null>(null);
  readonly isUndoing = computed(() => this.waiting.value > 0);
  readonly steps = computed(() => stepsOf(this.changes.value ?? [], this.author.value));

  private readonly waiting = signal(0);
  private last: Promise<void> = Promise.resolve();

  constructor(private readonly app: App) {}

  async read(): Promise<void> {
    const map = this.app.state.mapName.peek();
    if (map === null) return;
    try {
      const found = await listChanges(this.app.api, map, AT_MOST);
      if (map !== this.app.state.mapName.peek()) return;
      this.changes.value = found;
      this.problem.value = null;
    } catch (error) {
      this.problem.value = problemOf(error);
    }
  }

  undo(): Promise<void> {
    return this.inTurn(async () => {
      await this.read();
      const { undo } = this.steps.value;
      if (undo === null) this.app.announce(t("There is nothing of yours to undo."));
      else await this.send(undo, `undo: ${nameOf(undo)}`, t("Undone: {0}.", nameOf(undo)));
    });
  }

  redo(): Promise<void> {
    return this.inTurn(async () => {
      await this.read();
      const { redo } = this.steps.value;
      if (redo === null) return this.app.announce(t("There is nothing of yours to do again."));
      const undone = this.changes.value?.find((change) => change.id === redo.undoes);
      const name = undone === undefined ? t("change {0}", redo.undoes) : nameOf(undone);
      await this.send(redo, `again: ${name}`, t("Done again: {0}.", name));
    });
  }

  /** Takes any change back; one that something later builds on is refused by the service. */
  takeBack(change: ChangeSummary): Promise<void> {
    return this.inTurn(() =>
      this.send(change, `undo: ${nameOf(change)}`, t("Taken back: {0}.", nameOf(change))),
    );
  }

  /** One after the other, so that keys which are pressed fast go back step by step. */
  private inTurn(step: () => Promise<void>): Promise<void> {
    this.waiting.value += 1;
    const done = this.last.then(step).finally(() => (this.waiting.value -= 1));
    this.last = done.catch(() => {});
    return done;
  }

  private async send(change: ChangeSummary, message: string, done: string): Promise<void> {
    this.problem.value = null;
    try {
      await undoChange(this.app.api, change, message);
      this.app.announce(done);
      await this.app.reloadMap();
    } catch (error) {
      this.problem.value = problemOf(error);
      this.app.announce(this.problem.value.detail, "error");
    }
    await this.read();
  }
}

/** What a change did, in the words of its author, or by its number. */
export function nameOf(change: ChangeSummary): string {
  return change.message || t("change {0}", change.id);
}
