/** A WebSocket that is made again whenever it is lost, or says nothing for too long. */

import type { Api } from "../api";
import { waitBefore } from "./connection";
import { t } from "../language/catalogue";

/** The service says that it is there every 15 s. */
const SILENCE_MS = 40_000;
/** The service refuses by these codes: the token, its scope, or what is asked for, which no retry mends. */
const REFUSALS: Readonly<Record<number, number>> = { 4400: 400, 4401: 401, 4403: 403 };

export interface SocketUser {
  /** The path to ask for; asked again before each attempt, as a cursor moves on. */
  path(): string;
  take(message: { type: string } & Record<string, unknown>): void;
  /** It was lost; the next attempt comes at `retryAt`, in milliseconds since 1970. */
  lost(retryAt: number): void;
  /** It was refused for good, by an HTTP status. */
  refused(status: number, detail: string): void;
}

export class LastingSocket {
  private readonly api: Api;
  private readonly user: SocketUser;
  private socket: WebSocket | null = null;
  private attempt = 0;
  private retry = 0;
  private silence = 0;
  private refusal = "";
  private isStopped = false;

  constructor(api: Api, user: SocketUser) {
    this.api = api;
    this.user = user;
    this.open();
    addEventListener("online", this.retryNow);
    document.addEventListener("visibilitychange", this.retryNow);
  }

  stop(): void {
    this.isStopped = true;
    removeEventListener("online", this.retryNow);
    document.removeEventListener("visibilitychange", this.retryNow);
    clearTimeout(this.retry);
    this.drop();
  }

  /** Does not wait for the next attempt, where it waits for one. */
  readonly retryNow = (): void => {
    if (this.socket !== null || this.isStopped || document.hidden) return;
    clearTimeout(this.retry);
    this.open();
  };

  private open(): void {
    const socket = this.api.socket(this.user.path());
    this.socket = socket;
    this.listen();
    socket.onmessage = ({ data }): void => {
      this.listen();
      const message = JSON.parse(data as string) as { type: string } & Record<string, unknown>;
      if (message.type === "error") {
        this.refusal = [message["detail"], message["remedy"]].filter(Boolean).join(" ");
        return;
      }
      this.attempt = 0;
      this.user.take(message);
    };
    socket.onclose = ({ code }): void => {
      const status = REFUSALS[code];
      this.drop();
      if (status === undefined) this.again();
      else this.user.refused(status, this.refusal || t("The service refused the connection."));
    };
  }

  private again(): void {
    const wait_ms = waitBefore(this.attempt++, Math.random());
    this.retry = window.setTimeout(this.retryNowUnseen, wait_ms);
    this.user.lost(Date.now() + wait_ms);
  }

  private readonly retryNowUnseen = (): void => {
    if (this.socket === null && !this.isStopped) this.open();
  };

  private listen(): void {
    clearTimeout(this.silence);
    this.silence = window.setTimeout(() => {
      this.drop();
      this.again();
    }, SILENCE_MS);
  }

  private drop(): void {
    clearTimeout(this.silence);
    if (this.socket === null) return;
    this.socket.onmessage = this.socket.onclose = null;
    this.socket.close();
    this.socket = null;
  }
}
