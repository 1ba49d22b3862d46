import type { Fault } from "./lens";
import { LEAST_POINTS, type Placing } from "./placing";
import { fixed, say, t } from "../language/catalogue";

const FAULTS: Readonly<Record<Fault, readonly [string, string]>> = {
  line: [
    t("The points span no area: all of them, or all but one, lie on one line."),
    t("Take four corners of an area of the floor, as far from one another as the picture shows."),
  ],
  mirror: [
    t("On the plan the points are a mirror image of those in the picture: they go round the other way."),
    t("See that each number is the same point of the floor on both sides."),
  ],
  crossed: [
    t("The points cross one another: two have changed places."),
    t("See that each number is the same point of the floor on both sides."),
  ],
  focal: [
    t("The points do not tell how wide the lens sees, as where a camera looks straight down."),
    t("Give the angle of view across, or add points that are nearer and farther."),
  ],
};

/** What follows from the points, in words. */
export function Verdict({ placing }: { placing: Placing }) {
  return (
    <div role="status" aria-label={t("What the points tell")}>
      <Told placing={placing} />
    </div>
  );
}

function Told({ placing }: { placing: Placing }) {
  const [lens, picture] = [placing.lens.value, placing.picture.value];
  if (picture === null) return <p class="note">{t("Choose a picture that the camera took.")}</p>;
  if (lens === null) {
    const missing = LEAST_POINTS - placing.count.value;
    return (
      <p class="note">
        {missing === 1
          ? t("One point is missing, each in the picture and on the plan.")
          : t("{0} points are missing, each in the picture and on the plan.", missing)}
      </p>
    );
  }
  if (typeof lens === "string") {
    const [problem, remedy] = FAULTS[lens];
    return (
      <div class="note bad">
        <p>
          <strong>{problem}</strong>
        </p>
        <p>{remedy}</p>
      </div>
    );
  }
  const most_px = Math.max(...lens.off_px);
  if (placing.isFar(most_px))
    return (
      <div class="note bad">
        <p>
          <strong>
            {say(
              "No camera sees the points so: {0}.",
              Number.isFinite(most_px) ? t("{0} px off", fixed(most_px, 0)) : t("one is behind it"),
            )}
          </strong>
        </p>
        <p>{t("One is in a wrong place, or the picture is cropped, or bent as by a fisheye.")}</p>
      </div>
    );
  const [x, y] = lens.place;
  const angle_deg = (2 * Math.atan(picture.size[0] / 2 / lens.focal_px) * 180) / Math.PI;
  return (
    <p class="note good">
      {say(
        "The camera hangs {0} m above the floor at {1}, {2}, and sees {3}° across. The points are {4} px off at most: look whether its floor lies on the plan as it should.",
        fixed(lens.height_m, 2),
        fixed(x, 2),
        fixed(y, 2),
        fixed(angle_deg, 0),
        fixed(most_px, 1),
      )}
    </p>
  );
}
