/** How fast frames follow each other, and with how many pixels they may be drawn for that. */

const SLOW_MS = 45;
const LEAST_SCALE = 0.6;
const SMALLER = 0.8;
/** So many frames tell how fast it is. */
const FRAMES = 20;

export class Pace {
  /** What the resolution is multiplied with. */
  scale = 1;
  private last_ms: number | null = null;
  private sum_ms = 0;
  private count = 0;

  /** Takes the time of a frame, and whether another follows at once; true: the scale is another now. */
  drawn(now_ms: number, goesOn: boolean): boolean {
    const interval_ms = this.last_ms === null ? null : now_ms - this.last_ms;
    this.last_ms = goesOn ? now_ms : null;
    if (interval_ms === null) return false;
    this.sum_ms += interval_ms;
    if (++this.count < FRAMES) return false;
    const isSlow = this.sum_ms / this.count > SLOW_MS;
    this.sum_ms = this.count = 0;
    if (!isSlow || this.scale <= LEAST_SCALE) return false;
    this.scale = Math.max(LEAST_SCALE, this.scale * SMALLER);
    return true;
  }
}

/** Whether WebGL is drawn by the processor. */
export function isSoftware(): boolean {
  const gl = document.createElement("canvas").getContext("webgl2");
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? String(gl?.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}
