/** What an empty service offers: to draw a building, to bring one in, or to see a sample at work. */

import { useSignal } from "@preact/signals";

import type { Problem } from "../documents";
import type { App } from "../app";
import { isSideOpen } from "../chrome/side";
import { Guarded } from "../panel/guarded";
import { ProblemNote } from "../panel/problem";
import { problemOf } from "../unanswered";
import { isPlaying, playSample, stopSample } from "./sample";
import { tourAt } from "./tour";
import { say, t } from "../language/catalogue";

const FIRST_NAME = "building";

export function Welcome({ app }: { app: App }) {
  const name = useSignal(FIRST_NAME);
  const problem = useSignal<Problem | null>(null);
  const draw = async (): Promise<void> => {
    problem.value = null;
    try {
      await app.api.send("POST", "/maps", { body: { name: name.value.trim() } });
      await app.reloadMaps(name.value.trim());
      isSideOpen.value = true;
      app.state.tab.value = "edit";
    } catch (error) {
      problem.value = problemOf(error);
    }
  };
  return (
    <div class="stage-note welcome" id="no-map">
      <h2>{t("Welcome: there is no map yet")}</h2>
      <Guarded app={app} what={t("Making a map")} isShared>
        <form
          class="row"
          aria-label={t("Draw a building")}
          onSubmit={(event) => {
            event.preventDefault();
            void draw();
          }}
        >
          <label class="field grow">
            <span>{t("Name of the building")}</span>
            <input
              value={name.value}
              maxLength={200}
              required
              onInput={(event) => (name.value = event.currentTarget.value)}
            />
          </label>
          <button type="submit" class="primary" disabled={name.value.trim() === ""}>
            {t("Draw it")}
          </button>
        </form>
        {problem.value && <ProblemNote problem={problem.value} />}
        <div class="row">
          <button
            onClick={() => {
              isSideOpen.value = true;
              app.state.tab.value = "import";
            }}
          >
            {t("Import a file")}
          </button>
          <button disabled={isPlaying.value} onClick={() => void playSample(app)}>
            {t("Play the sample")}
          </button>
        </div>
      </Guarded>
      <div class="row">
        <button onClick={() => (tourAt.value = 0)}>{t("Take the tour")}</button>
      </div>
      <p class="soft">
        {t(
          "A file is a building (.geojson, .ifc, .gml) or a map (.yaml, or the .zip of an export): drop it anywhere. The sample is an office with three people, for a minute.",
        )}
      </p>
    </div>
  );
}

/** While the sample is told, it can be stopped. */
export function SampleBanner() {
  if (!isPlaying.value) return null;
  return (
    <div class="banner" role="status" id="sample">
      {say(
        "The sample is being played: three people in an office.{0}",
        <button onClick={stopSample}>{t("Stop")}</button>,
      )}
    </div>
  );
}
