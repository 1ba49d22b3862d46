import { signal } from "@preact/signals";

import type { App } from "../app";
import { CameraDialog } from "./dialog";
import { Placing } from "./placing";
import { t } from "../language/catalogue";

const isOpen = signal(false);
/** What was begun stays until the page is closed, for each map. */
const begun = new Map<string, Placing>();

/** Opens the dialog in which a fixed camera is placed. */
export function FixedCamera({ app }: { app: App }) {
  const model = app.state.map.value;
  if (model === null) return null;
  const open = (): void => {
    const placing = begun.get(model.name) ?? new Placing(model);
    placing.model.value = model;
    if (!model.storeys.some(({ name }) => name === placing.storey.value))
      placing.storey.value = app.state.storey.value ?? model.storeys[0]?.name ?? null;
    begun.set(model.name, placing);
    isOpen.value = true;
  };
  const placing = begun.get(model.name);
  return (
    <details>
      <summary>{t("Fixed cameras")}</summary>
      <div class="stack">
        <p class="soft">
          {t(
            "What somebody finds in the images of a camera on a wall has a place on the map as soon as it is known how it hangs.",
          )}
        </p>
        <p>
          <button type="button" onClick={open}>
            {t("Place a camera…")}
          </button>
        </p>
      </div>
      {isOpen.value && placing && <CameraDialog placing={placing} close={() => (isOpen.value = false)} />}
    </details>
  );
}
