import type { Fault } from "./lens";
import { LEAST_POINTS, type Placing } from "./placing";

const FAULTS: Readonly<Record<Fault, readonly [string, string]>> = {
  line: [
    "The points span no area: all of them, or all but one, lie on one line.",
    "Take four corners of an area of the floor, as far from one another as the picture shows.",
  ],
  mirror: [
    "On the plan the points are a mirror image of those in the picture: they go round the other way.",
    "See that each number is the same point of the floor on both sides.",
  ],
  crossed: [
    "The points cross one another: two have changed places.",
    "See that each number is the same point of the floor on both sides.",
  ],
  focal: [
    "The points do not tell how wide the lens sees, as where a camera looks straight down.",
    "Give the angle of view across, or add points that are nearer and farther.",
  ],
};

/** What follows from the points, in words. */
export function Verdict({ placing }: { placing: Placing }) {
  return (
    <div role="status" aria-label="What the points tell">
      <Told placing={placing} />
    </div>
  );
}

function Told({ placing }: { placing: Placing }) {
  const [lens, picture] = [placing.lens.value, placing.picture.value];
  if (picture === null) return <p class="note">Choose a picture that the camera took.</p>;
  if (lens === null) {
    const missing = LEAST_POINTS - placing.count.value;
    return (
      <p class="note">
        {missing === 1 ? "One point is" : `${missing} points are`} missing, each in the picture and on the
        plan.
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
            No camera sees the points so:{" "}
            {Number.isFinite(most_px) ? `${most_px.toFixed(0)} px off` : "one is behind it"}.
          </strong>
        </p>
        <p>One is in a wrong place, or the picture is cropped, or bent as by a fisheye.</p>
      </div>
    );
  const [x, y] = lens.place;
  const angle_deg = (2 * Math.atan(picture.size[0] / 2 / lens.focal_px) * 180) / Math.PI;
  return (
    <p class="note good">
      The camera hangs {lens.height_m.toFixed(2)} m above the floor at {x.toFixed(2)}, {y.toFixed(2)}, and
      sees {angle_deg.toFixed(0)}° across. The points are {most_px.toFixed(1)} px off at most: look whether
      its floor lies on the plan as it should.
    </p>
  );
}
