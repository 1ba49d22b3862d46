/** What one takes along from the page: onto the clipboard, or as a file. */

/** Over plain HTTP browsers have no clipboard but that of a selected text. */
export async function hasCopied(text: string): Promise<boolean> {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    // Outside of an open dialog nothing can be focused.
    const place = document.querySelector("dialog[open]") ?? document.body;
    const field = place.appendChild(document.createElement("textarea"));
    const focused = document.activeElement as HTMLElement | null;
    field.value = text;
    field.select();
    const isCopied = document.execCommand("copy");
    field.remove();
    focused?.focus();
    return isCopied;
  }
}

const KEPT_MS = 10_000;

/** A file of this name, without what a file's name may not have everywhere. */
export function save(name: string, ending: string, text: string, type: string): void {
  const link = document.createElement("a");
  link.download = `${name.replace(/[^\p{L}\p{N}_-]+/gu, "_")}.${ending}`;
  link.href = URL.createObjectURL(new Blob([text], { type }));
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), KEPT_MS);
}
