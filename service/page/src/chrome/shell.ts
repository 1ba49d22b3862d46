/** What the document itself says, before any part of the page is drawn, in the language of its reader. */

import { t } from "../language/catalogue";

export function sayShell(): void {
  const part = (selector: string): Element => document.querySelector(selector)!;
  part(".skip").textContent = t("Skip to the map");
  const named: readonly [string, string][] = [
    ["#scene", t("Map")],
    [
      "#stage",
      t(
        "Picture of the map. Arrow keys move it, plus and minus zoom, 0 shows all. What is on it is listed in the panel Details.",
      ),
    ],
    ["#side", t("Panels")],
    ["#time", t("Timeline")],
  ];
  for (const [selector, name] of named) part(selector).setAttribute("aria-label", name);
}
