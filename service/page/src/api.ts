/** Requests to the service on the page's own host: with the token, and errors as what they say. */

import type { Problem } from "./documents";
import { t } from "./language/catalogue";

/** A request that was refused, or never answered (status 0). */
export class ApiError extends Error {
  readonly problem: Problem;

  constructor(problem: Problem) {
    super(problem.detail);
    this.name = "ApiError";
    this.problem = problem;
  }

  get status(): number {
    return this.problem.status;
  }

  /** What the user can do about it; may be empty. */
  get remedy(): string {
    return this.problem.remedy;
  }
}

export interface Answer<T> {
  status: number;
  body: T;
  etag: string | null;
  location: string | null;
}

export interface RequestOptions {
  /** Sent as JSON, or as it is where it is a form. */
  body?: unknown;
  /** The change is refused with 412 if what was read has another ETag by now. */
  ifMatch?: string | null;
  /** Why, for the history of the map. */
  message?: string;
  headers?: Record<string, string>;
  signal?: AbortSignal;
}

const TOKEN = "semap.token";
const PROTOCOL = "semap";

export class Api {
  /** Told of each 401: the page asks for a token. */
  onUnauthorised: (problem: Problem) => void = () => {};

  get token(): string | null {
    return sessionStorage.getItem(TOKEN);
  }

  set token(token: string | null) {
    if (token === null) sessionStorage.removeItem(TOKEN);
    else sessionStorage.setItem(TOKEN, token);
  }

  /** A whole answer. Raises ApiError; a request that was aborted raises what `fetch` does. */
  async send<T>(method: string, path: string, options: RequestOptions = {}): Promise<Answer<T>> {
    const response = await this.fetch(method, path, options);
    const type = response.headers.get("content-type") ?? "";
    const isJson = response.status !== 204 && type.includes("json");
    const body = (await whole(isJson ? response.json() : response.text(), path, options.signal)) as T;
    return {
      status: response.status,
      body,
      etag: response.headers.get("etag"),
      location: response.headers.get("location"),
    };
  }

  async get<T>(path: string, signal?: AbortSignal): Promise<T> {
    return (await this.send<T>("GET", path, signal ? { signal } : {})).body;
  }

  async bytes(path: string, signal?: AbortSignal): Promise<ArrayBuffer> {
    const response = await this.fetch("GET", path, signal ? { signal } : {});
    return whole(response.arrayBuffer(), path, signal);
  }

  /** The response as it comes, for streams; raises ApiError like `send`. */
  async fetch(method: string, path: string, options: RequestOptions = {}): Promise<Response> {
    const headers = new Headers(options.headers);
    if (this.token !== null) headers.set("Authorization", `Bearer ${this.token}`);
    if (options.ifMatch) headers.set("If-Match", options.ifMatch);
    if (options.message) headers.set("Semap-Message", inHeader(options.message));
    let body: BodyInit | null = null;
    if (options.body instanceof FormData) body = options.body;
    else if (options.body !== undefined) {
      headers.set("Content-Type", "application/json");
      body = JSON.stringify(options.body);
    }
    let response: Response;
    try {
      response = await fetch(path, { method, headers, body, signal: options.signal ?? null });
    } catch (error) {
      if (options.signal?.aborted) throw error;
      throw new ApiError(unanswered(path));
    }
    if (!response.ok) {
      const problem = await problemOf(response, path);
      if (problem.status === 401) this.onUnauthorised(problem);
      throw new ApiError(problem);
    }
    return response;
  }

  /** A WebSocket that carries the token as a subprotocol, since a browser sends it no headers. */
  socket(path: string): WebSocket {
    const address = new URL(path, location.href);
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    const protocols = this.token === null ? [PROTOCOL] : [PROTOCOL, `bearer.${this.token}`];
    return new WebSocket(address, protocols);
  }
}

/** A path from parts that are escaped: path`/maps/${name}/grids/${grid}`. */
export function path(texts: TemplateStringsArray, ...parts: (string | number)[]): string {
  return texts.reduce((whole, text, i) => whole + encodeURIComponent(parts[i - 1] ?? "") + text);
}

/** All of a list that is given in pages. */
export async function allPages<T, K extends string>(
  api: Api,
  path: string,
  key: K,
  signal?: AbortSignal,
): Promise<T[]> {
  const found: T[] = [];
  let after: number | string | null = null;
  do {
    const address: string =
      path +
      (path.includes("?") ? "&" : "?") +
      "limit=1000" +
      (after === null ? "" : `&after=${encodeURIComponent(after)}`);
    const page: Record<K, T[]> & { next: number | string | null } = await api.get(address, signal);
    found.push(...page[key]);
    after = page.next;
  } while (after !== null);
  return found;
}

/** The body of an answer; one that was cut off is no answer. */
async function whole<T>(body: Promise<T>, path: string, signal: AbortSignal | undefined): Promise<T> {
  try {
    return await body;
  } catch (error) {
    if (signal?.aborted) throw error;
    throw new ApiError(unanswered(path));
  }
}

async function problemOf(response: Response, path: string): Promise<Problem> {
  const plain: Problem = {
    type: "about:blank",
    title: response.statusText,
    status: response.status,
    detail: t("The service answered {0} {1}.", response.status, response.statusText),
    instance: path,
    remedy: "",
    errors: [],
  };
  try {
    return { ...plain, ...((await response.json()) as Partial<Problem>) };
  } catch {
    return plain;
  }
}

function unanswered(path: string): Problem {
  return {
    type: "about:blank",
    title: t("No answer"),
    status: 0,
    detail: t("The service does not answer."),
    instance: path,
    remedy: t("See that semap is running; the page goes on when it answers again."),
    errors: [],
  };
}

/** Text in a header: as the bytes of UTF-8, which `Headers` takes as one character each. */
export function inHeader(text: string): string {
  return String.fromCharCode(...new TextEncoder().encode(text.replace(/[\r\n]+/g, " ")));
}
