/** Who edits: a name that stays with the browser, so that the history tells one's own changes from others'. */

const KEY = "semap.author";

export function author(): string {
  const known = localStorage.getItem(KEY);
  if (known !== null) return known;
  const made = `page ${Math.floor(Math.random() * 0x10000)
    .toString(16)
    .padStart(4, "0")}`;
  localStorage.setItem(KEY, made);
  return made;
}

/** An empty name gives a made-up one again. */
export function renameAuthor(name: string): string {
  const kept = name.trim().slice(0, 100);
  if (kept === "") localStorage.removeItem(KEY);
  else localStorage.setItem(KEY, kept);
  return author();
}

/** Whether the history names this author; beside the name it tells the token's. */
export function isBy(signature: string, name: string): boolean {
  return signature === name || signature.startsWith(`${name} (`);
}
