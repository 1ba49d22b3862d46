/** Tables as spreadsheets read them (RFC 4180), saved as files. */

import { save } from "./taking";

/** A text that a spreadsheet would take for a formula begins with an apostrophe, as it does for those who type one. */
export function csvOf(head: readonly string[], rows: readonly (readonly unknown[])[]): string {
  return [head, ...rows].map((row) => `${row.map(cell).join(",")}\r\n`).join("");
}

export function saveCsv(name: string, text: string): void {
  save(name, "csv", text, "text/csv");
}

function cell(value: unknown): string {
  const said = value === null || value === undefined ? "" : String(value);
  const text = typeof value === "string" && /^[=+@-]/.test(said) ? `'${said}` : said;
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}
