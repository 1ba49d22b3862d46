/** Names on the picture, drawn on a canvas of their own above it; a name that would cover another is left out. */

import type { View } from "./view";

const PAD_PX = 3;
const FEWEST_LETTERS = 3;
const RIGHT_TO_LEFT = /[\u0590-\u08ff\ufb1d-\ufdff\ufe70-\ufefc]/;

export interface LabelStyle {
  font: string;
  ink: string;
  /** null: it stands on its mark. */
  halo: string | null;
}

interface Box {
  left: number;
  top: number;
  right: number;
  bottom: number;
}

export class Labels {
  private readonly canvas: HTMLCanvasElement;
  private readonly context: CanvasRenderingContext2D;
  private readonly taken: Box[] = [];
  private used = 0;
  private readonly widths = new Map<string, number>();
  private readonly shortened = new Map<string, string | null>();
  private readonly at = { x: 0, y: 0 };
  private view: View | null = null;

  constructor(canvas: HTMLCanvasElement) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d")!;
  }

  begin(view: View, ratio: number): void {
    this.view = view;
    const [width, height] = [Math.round(view.width_px * ratio), Math.round(view.height_px * ratio)];
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
      this.canvas.style.width = `${view.width_px}px`;
      this.canvas.style.height = `${view.height_px}px`;
    }
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.context.clearRect(0, 0, view.width_px, view.height_px);
    this.context.textAlign = "center";
    this.context.textBaseline = "middle";
    this.context.lineJoin = "round";
    this.context.lineWidth = 3.5;
    this.used = 0;
  }

  /**
   * Writes a name at a place of the map, `below_px` further down, no wider than `width_px`: a longer one ends in an
   * ellipsis. Whether there was room for it.
   */
  write(
    text: string,
    x_m: number,
    y_m: number,
    z_m: number,
    below_px: number,
    size_px: number,
    width_px: number,
    style: LabelStyle,
  ): boolean {
    if (!this.view?.project(x_m, y_m, z_m, this.at)) return false;
    const { x } = this.at;
    const y = this.at.y + below_px;
    if (x < -80 || y < -20 || x > this.view.width_px + 80 || y > this.view.height_px + 20) return false;
    this.context.font = style.font;
    const fitted = this.fitted(text, style.font, width_px);
    if (fitted === null) return false;
    this.context.direction = RIGHT_TO_LEFT.test(fitted) ? "rtl" : "ltr";
    const half = this.widthOf(fitted, style.font) / 2 + PAD_PX;
    if (!this.take(x - half, y - size_px * 0.62, x + half, y + size_px * 0.62)) return false;
    if (style.halo !== null) {
      this.context.strokeStyle = style.halo;
      this.context.strokeText(fitted, x, y);
    }
    this.context.fillStyle = style.ink;
    this.context.fillText(fitted, x, y);
    return true;
  }

  /** Writes what is part of a mark, on which it stands. */
  writeOn(text: string, x_m: number, y_m: number, z_m: number, { font, ink }: LabelStyle): void {
    if (!this.view?.project(x_m, y_m, z_m, this.at)) return;
    this.context.font = font;
    this.context.fillStyle = ink;
    this.context.fillText(text, this.at.x, this.at.y);
  }

  /** Keeps names off what is drawn at a place. */
  keepOff(x_m: number, y_m: number, z_m: number, radius_px: number): void {
    if (!this.view?.project(x_m, y_m, z_m, this.at)) return;
    const { x, y } = this.at;
    this.occupy(x - radius_px, y - radius_px, x + radius_px, y + radius_px);
  }

  /** As much of a text as a width has room for; null: not even a few letters. */
  private fitted(text: string, font: string, width_px: number): string | null {
    if (this.widthOf(text, font) <= width_px) return text;
    const key = `${font}${Math.round(width_px)} ${text}`;
    let found = this.shortened.get(key);
    if (found === undefined) {
      if (this.shortened.size > 5000) this.shortened.clear();
      const letters = [...new Intl.Segmenter().segment(text)].map((each) => each.segment);
      let [least, most] = [0, letters.length - 1];
      this.context.font = font;
      while (least < most) {
        const middle = (least + most + 1) >> 1;
        const isNarrow = this.context.measureText(`${letters.slice(0, middle).join("")}…`).width <= width_px;
        if (isNarrow) least = middle;
        else most = middle - 1;
      }
      found = least < FEWEST_LETTERS ? null : `${letters.slice(0, least).join("").trimEnd()}…`;
      this.shortened.set(key, found);
    }
    return found;
  }

  private take(left: number, top: number, right: number, bottom: number): boolean {
    for (let i = 0; i < this.used; i++) {
      const box = this.taken[i]!;
      if (left < box.right && right > box.left && top < box.bottom && bottom > box.top) return false;
    }
    this.occupy(left, top, right, bottom);
    return true;
  }

  private occupy(left: number, top: number, right: number, bottom: number): void {
    const box = (this.taken[this.used++] ??= { left, top, right, bottom });
    box.left = left;
    box.top = top;
    box.right = right;
    box.bottom = bottom;
  }

  widthOf(text: string, font: string): number {
    const key = font + text;
    let width = this.widths.get(key);
    if (width === undefined) {
      if (this.widths.size > 5000) this.widths.clear();
      this.context.font = font;
      width = this.context.measureText(text).width;
      this.widths.set(key, width);
    }
    return width;
  }
}
