/** Light or dark: as the system says, until the user says otherwise. */

import { signal } from "@preact/signals";

export type Theme = "light" | "dark";

const KEPT = "semap.theme";
const system = matchMedia("(prefers-color-scheme: dark)");

export const theme = signal<Theme>("light");

export function startTheme(): void {
  apply();
  system.addEventListener("change", apply);
}

/** Takes the other theme, and keeps it; the one of the system is not kept. */
export function toggleTheme(): void {
  const next: Theme = theme.value === "dark" ? "light" : "dark";
  if (next === ofSystem()) localStorage.removeItem(KEPT);
  else localStorage.setItem(KEPT, next);
  apply();
}

function ofSystem(): Theme {
  return system.matches ? "dark" : "light";
}

function apply(): void {
  const kept = localStorage.getItem(KEPT);
  const next = kept === "light" || kept === "dark" ? kept : ofSystem();
  document.documentElement.dataset["theme"] = next;
  theme.value = next;
}
