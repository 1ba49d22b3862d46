/** Imports under way and done: sent, followed as jobs of the service, cancelled. */

import { signal } from "@preact/signals";

import type { ImportDocument, ImportJob, Problem } from "../documents";
import { ApiError, inHeader, path } from "../api";
import type { App } from "../app";
import { author } from "../edit/author";
import { problemOf } from "../panel/problem";
import { t } from "../language/catalogue";

export interface Import {
  key: number;
  file: string;
  /** null while the file is being sent. */
  job: ImportJob | null;
  /** Why it could not be sent, or why it failed. */
  problem: Problem | null;
  isCancelled: boolean;
}

export const SUFFIXES = [".geojson", ".json", ".ifc", ".gml", ".yaml", ".yml", ".zip"];

const WAIT_S = 20;
const FIRST_RETRY_MS = 500;
const LAST_RETRY_MS = 8000;
const KIND = "map_import";

/** Why a file cannot be one; null: it may be. */
export function refusalOf(file: string): string | null {
  const dot = file.lastIndexOf(".");
  if (dot > 0 && SUFFIXES.includes(file.slice(dot).toLowerCase())) return null;
  return t("{0} is no map or building that semap reads: it takes {1}.", file, SUFFIXES.join(", "));
}

export function hasEnded({ job, problem, isCancelled }: Import): boolean {
  return isCancelled || problem !== null || (job !== null && !["waiting", "running"].includes(job.state));
}

export class Imports {
  /** The newest first. */
  readonly list = signal<readonly Import[]>([]);
  private readonly stops = new Map<number, AbortController>();
  private lastKey = 0;

  constructor(private readonly app: App) {}

  /** Sends a file and follows its job; a building goes into the map of this name, or into one of its own. */
  async bringIn(file: File, map: string | null): Promise<void> {
    const key = this.add(file.name, null);
    const stop = new AbortController();
    this.stops.set(key, stop);
    try {
      const body = new FormData();
      body.set("file", file);
      const query = map === null ? "" : `?name=${encodeURIComponent(map)}`;
      const { body: job } = await this.app.api.send<ImportJob>("POST", `/maps/import${query}`, {
        body,
        message: `import ${file.name}`,
        headers: { Prefer: "respond-async", "Semap-Author": inHeader(author()) },
        signal: stop.signal,
      });
      this.set(key, { job });
      await this.follow(key, job.job_id, stop.signal);
    } catch (error) {
      if (stop.signal.aborted) this.set(key, { isCancelled: true });
      else this.set(key, { problem: problemOf(error) });
    }
  }

  /** Follows what was begun before the page was opened, or in another one. */
  async find(): Promise<void> {
    // The job of what is being sent has no card of its own yet.
    if (this.list.peek().some((each) => each.job === null && !hasEnded(each))) return;
    let jobs: ImportJob[];
    try {
      jobs = (await this.app.api.get<{ jobs: ImportJob[] }>("/jobs?limit=50")).jobs;
    } catch (error) {
      problemOf(error);
      return;
    }
    const known = new Set(this.list.peek().map((each) => each.job?.job_id));
    for (const job of jobs) {
      if (job.kind !== KIND || known.has(job.job_id) || !["waiting", "running"].includes(job.state)) continue;
      const key = this.add(job.file, job);
      const stop = new AbortController();
      this.stops.set(key, stop);
      void this.follow(key, job.job_id, stop.signal).catch((error: unknown) =>
        this.set(key, { problem: problemOf(error) }),
      );
    }
  }

  async cancel(key: number): Promise<void> {
    const found = this.list.value.find((each) => each.key === key);
    if (found === undefined || hasEnded(found)) return;
    if (found.job === null) {
      this.stops.get(key)?.abort();
      return;
    }
    try {
      await this.app.api.send("DELETE", path`/jobs/${found.job.job_id}`);
    } catch (error) {
      this.app.announce(problemOf(error).detail, "error");
    }
  }

  forget(key: number): void {
    this.list.value = this.list.value.filter((each) => each.key !== key);
    this.stops.delete(key);
  }

  private async follow(key: number, id: number, stop: AbortSignal): Promise<void> {
    let retry_ms = FIRST_RETRY_MS;
    for (;;) {
      try {
        const job = await this.app.api.get<ImportJob>(path`/jobs/${id}` + `?wait=${WAIT_S}`, stop);
        retry_ms = FIRST_RETRY_MS;
        this.set(key, { job, problem: job.problem, isCancelled: job.state === "cancelled" });
        if (job.state === "done") await this.showResult(job.result);
        if (!["waiting", "running"].includes(job.state)) return;
      } catch (error) {
        // A service that is away comes back; its jobs are told then.
        if (!(error instanceof ApiError) || (error.status !== 0 && error.status < 500)) throw error;
        await new Promise((resolve) => setTimeout(resolve, retry_ms));
        retry_ms = Math.min(retry_ms * 2, LAST_RETRY_MS);
      }
    }
  }

  private async showResult(result: ImportDocument | null): Promise<void> {
    if (result === null) return;
    this.app.announce(t("{0} is there.", result.map));
    await this.app.reloadMaps(result.map);
  }

  private add(file: string, job: ImportJob | null): number {
    this.lastKey += 1;
    this.list.value = [
      { key: this.lastKey, file, job, problem: null, isCancelled: false },
      ...this.list.value,
    ];
    return this.lastKey;
  }

  private set(key: number, changed: Partial<Import>): void {
    this.list.value = this.list.value.map((each) => (each.key === key ? { ...each, ...changed } : each));
  }
}
