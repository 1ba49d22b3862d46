/** Ellipses of uncertainty. */

/** The square root of the 95 % quantile of chi-squared with two degrees of freedom. */
const RADII_95 = 2.447746830680816;

export interface Ellipse {
  /** Half axes, the longer first. */
  a_m: number;
  b_m: number;
  /** Of the longer axis, from x towards y. */
  angle_rad: number;
}

/** Writes the ellipse that holds 95 % of a Gaussian with this covariance into `into`; false where it is none. */
export function ellipse95(
  xx_m2: number | null,
  xy_m2: number | null,
  yy_m2: number | null,
  into: Ellipse,
): boolean {
  if (xx_m2 === null || yy_m2 === null) return false;
  const xy = xy_m2 ?? 0;
  const mean = (xx_m2 + yy_m2) / 2;
  const spread = Math.hypot((xx_m2 - yy_m2) / 2, xy);
  if (!(mean + spread > 0)) return false;
  into.a_m = RADII_95 * Math.sqrt(mean + spread);
  into.b_m = RADII_95 * Math.sqrt(Math.max(0, mean - spread));
  into.angle_rad = Math.atan2(2 * xy, xx_m2 - yy_m2) / 2;
  return true;
}
