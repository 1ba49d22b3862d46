import { useState } from "preact/hooks";

import { isWanted, notifyOf } from "../chrome/notifying";
import { t } from "../language/catalogue";

interface NotifyProps {
  map: string;
  types: readonly string[];
  /** Of the rule, where several are listed. */
  name?: string;
}

/** Whether this browser notifies of a rule's events. */
export function Notify({ map, types, name }: NotifyProps) {
  const [why, setWhy] = useState<string | null>(null);
  const isOn = isWanted(map, types);
  return (
    <>
      <button
        type="button"
        aria-pressed={isOn}
        aria-label={name && t("Notify me of {0}", name)}
        disabled={types.length === 0}
        onClick={() => void notifyOf(map, types, !isOn).then(setWhy)}
      >
        {name === undefined ? t("Notify me in this browser") : t("Notify me")}
      </button>
      {why && (
        <p class="note warn" role="alert">
          {why}
        </p>
      )}
    </>
  );
}
