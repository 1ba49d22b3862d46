import { useRef } from "preact/hooks";

import type { Placing } from "./placing";
import { say, t } from "../language/catalogue";

export function Settings({ placing }: { placing: Placing }) {
  const chosen = useRef<HTMLInputElement>(null);
  const refused = placing.refused.value;
  const picture = placing.picture.value;
  const { storeys } = placing.model.value;
  return (
    <>
      {refused !== null && (
        <p class="note bad" role="alert">
          {say("{0} is no picture that this browser can show: take a JPEG, PNG or WebP.", refused)}
        </p>
      )}
      <div class="settings">
        <div class="field">
          <button
            type="button"
            class={picture === null ? "primary" : ""}
            onClick={() => chosen.current?.click()}
          >
            {picture === null ? t("Choose a picture…") : t("Another picture…")}
          </button>
          <input
            ref={chosen}
            type="file"
            hidden
            accept="image/*"
            aria-label={t("Picture of the camera")}
            onChange={(event) => {
              const file = event.currentTarget.files?.[0];
              event.currentTarget.value = "";
              if (file) void placing.take(file);
            }}
          />
        </div>
        {storeys.length > 1 && (
          <label class="field">
            <span>{t("Storey")}</span>
            <select
              value={placing.storey.value ?? ""}
              onChange={(event) => (placing.storey.value = event.currentTarget.value)}
            >
              {storeys.map(({ name }) => (
                <option key={name} value={name}>
                  {name}
                </option>
              ))}
            </select>
          </label>
        )}
        <Text
          label={t("Name of the camera")}
          value={placing.name.value}
          set={(text) => (placing.name.value = text)}
        />
        <Text
          label={t("Topic, or name in Frigate")}
          value={placing.topic.value}
          placeholder={placing.name.value}
          set={(text) => (placing.topic.value = text)}
        />
        <Amount
          label={t("Angle of view across [°]")}
          value={placing.angle_deg.value}
          most={170}
          placeholder={t("as the points tell")}
          set={(value) => (placing.angle_deg.value = value)}
        />
        {picture && (
          <Amount
            label={t("Persons are found in images of a width of [px]")}
            value={placing.width_px.value}
            most={20_000}
            placeholder={String(picture.size[0])}
            set={(value) => (placing.width_px.value = value === null ? null : Math.round(value))}
          />
        )}
      </div>
    </>
  );
}

interface TextProps {
  label: string;
  value: string;
  placeholder?: string;
  set: (text: string) => void;
}

function Text({ label, value, placeholder, set }: TextProps) {
  return (
    <label class="field">
      <span>{label}</span>
      <input
        value={value}
        maxLength={200}
        spellcheck={false}
        autocomplete="off"
        {...(placeholder !== undefined && { placeholder })}
        onInput={(event) => set(event.currentTarget.value)}
      />
    </label>
  );
}

interface AmountProps {
  label: string;
  value: number | null;
  most: number;
  placeholder: string;
  set: (value: number | null) => void;
}

/** A number of at least 1; empty: null. */
function Amount({ label, value, most, placeholder, set }: AmountProps) {
  return (
    <label class="field">
      <span>{label}</span>
      <input
        type="number"
        min={1}
        max={most}
        step="any"
        defaultValue={value ?? ""}
        placeholder={placeholder}
        onInput={(event) => {
          const { valueAsNumber: number } = event.currentTarget;
          set(number >= 1 && number <= most ? number : null);
        }}
      />
    </label>
  );
}
