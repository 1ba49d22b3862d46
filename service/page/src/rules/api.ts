/** Rules over the API. */

import type {
  DryRunAnswer,
  FilledTemplate,
  RuleCheck,
  RuleDocument,
  RuleTemplate,
  RuleVersionDocument,
  RuleWords,
} from "../documents";
import { allPages, path, type Answer, type Api } from "../api";

export type Declaration = Record<string, unknown>;

export function listRules(api: Api, map: string, signal: AbortSignal): Promise<RuleDocument[]> {
  return allPages<RuleDocument, "rules">(api, `/rules?map=${encodeURIComponent(map)}`, "rules", signal);
}

export async function listTemplates(api: Api, signal: AbortSignal): Promise<RuleTemplate[]> {
  return (await api.get<{ templates: RuleTemplate[] }>("/rule-templates", signal)).templates;
}

export async function fillTemplate(
  api: Api,
  name: string,
  values: Readonly<Record<string, string>>,
  signal: AbortSignal,
): Promise<string> {
  const where = path`/rule-templates/${name}/text`;
  return (await api.send<FilledTemplate>("POST", where, { body: { values }, signal })).body.text;
}

/** What texts of rules may name on a map. */
export function readWords(api: Api, map: string, signal: AbortSignal): Promise<RuleWords> {
  return api.get(path`/maps/${map}/rule-words`, signal);
}

export async function listVersions(
  api: Api,
  id: number,
  signal: AbortSignal,
): Promise<RuleVersionDocument[]> {
  return (await api.get<{ versions: RuleVersionDocument[] }>(path`/rules/${id}/versions`, signal)).versions;
}

/** The rule with its ETag, and then its text: where it changes in between, saving the text is refused. */
export async function readRule(
  api: Api,
  id: number,
): Promise<{ rule: RuleDocument; etag: string | null; text: string }> {
  const { body, etag } = await api.send<RuleDocument>("GET", path`/rules/${id}`);
  return { rule: body, etag, text: await readText(api, id) };
}

export async function readText(api: Api, id: number, version?: number): Promise<string> {
  const query = version === undefined ? "" : `?version=${version}`;
  return (await api.send<string>("GET", path`/rules/${id}/text` + query)).body;
}

/** replaces  the rule whose name the text may have */
export async function checkRule(
  api: Api,
  map: string,
  text: string,
  replaces: number | null,
  signal: AbortSignal,
): Promise<RuleCheck> {
  const body = replaces === null ? { text } : { text, replaces };
  return (await api.send<RuleCheck>("POST", path`/maps/${map}/rules/check`, { body, signal })).body;
}

/** backfill_from  a stamp or `all`: runs over what is stored from then on, too */
export async function addRule(
  api: Api,
  map: string,
  name: string,
  declaration: Declaration,
  backfill_from: string | null,
): Promise<RuleDocument> {
  return (await api.send<RuleDocument>("POST", "/rules", { body: { map, name, declaration, backfill_from } }))
    .body;
}

export function changeRule(
  api: Api,
  id: number,
  changes: { enabled?: boolean; declaration?: Declaration; backfill_from?: string | null },
  ifMatch: string | null,
): Promise<Answer<RuleDocument>> {
  return api.send<RuleDocument>("PATCH", path`/rules/${id}`, { body: changes, ifMatch });
}

export async function deleteRule(api: Api, id: number): Promise<void> {
  await api.send("DELETE", path`/rules/${id}`);
}

/** from, to  milliseconds since 1970 */
export async function dryRun(
  api: Api,
  map: string,
  name: string,
  declaration: Declaration,
  span: { from: number; to: number },
  signal: AbortSignal,
): Promise<DryRunAnswer> {
  const body = {
    map,
    name,
    declaration,
    from: new Date(span.from).toISOString(),
    to: new Date(span.to).toISOString(),
  };
  return (await api.send<DryRunAnswer>("POST", "/rules/dry-run", { body, signal })).body;
}

/** Why a rule found something around a moment, or how far it came; key: of each property `name=value`. */
export async function explain(
  api: Api,
  id: number,
  at: number,
  key: readonly string[],
): Promise<{ found: boolean; lines: string[] }> {
  const query = new URLSearchParams([
    ["at", new Date(at).toISOString()],
    ...key.map((each) => ["key", each]),
  ]);
  return api.get(path`/rules/${id}/explanation` + `?${query}`);
}
