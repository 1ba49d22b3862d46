/** An occupancy grid, the backdrop: its image as map_server writes it (PGM, netpbm's "P5" with one byte a pixel). */

import type { GridDocument } from "../documents";

export interface Graymap {
  width: number;
  height: number;
  /** Row by row from the top. */
  pixels: Uint8Array;
}

/** Reads a binary PGM. Raises RangeError if it is none, or is cut off. */
export function readPgm(bytes: Uint8Array): Graymap {
  let at = 0;
  const isBlank = (byte: number): boolean => byte === 32 || (byte >= 9 && byte <= 13);
  const token = (): string => {
    for (;;) {
      while (at < bytes.length && isBlank(bytes[at]!)) at++;
      if (bytes[at] !== 35) break; // "#" begins a comment
      while (at < bytes.length && bytes[at] !== 10) at++;
    }
    let text = "";
    while (at < bytes.length && !isBlank(bytes[at]!)) text += String.fromCharCode(bytes[at++]!);
    return text;
  };
  if (token() !== "P5") throw new RangeError("not a binary PGM");
  const [width, height, largest] = [Number(token()), Number(token()), Number(token())];
  at++;
  if (!(width > 0 && height > 0 && largest > 0 && largest < 256) || at + width * height > bytes.length) {
    throw new RangeError("a PGM that is cut off or not of one byte a pixel");
  }
  return { width, height, pixels: bytes.subarray(at, at + width * height) };
}

/** How strongly a grid shows at each pixel, 0 to 255: what is occupied fully, what is unknown a little. */
export function shadeOf(grid: GridDocument, image: Graymap): Uint8Array {
  const table = new Uint8Array(256);
  for (let value = 0; value < 256; value++) {
    const occupied = (grid.negate ? value : 255 - value) / 255;
    if (occupied > grid.occupied_thresh) table[value] = 255;
    else if (occupied < grid.free_thresh) table[value] = 0;
    else table[value] = 45;
  }
  return image.pixels.map((value) => table[value]!);
}

/** An image with at most so many pixels to a side, in which no wall is lost: each pixel is the strongest of its block. */
export function reduced({ width, height, pixels }: Graymap, largest_px: number): Graymap {
  const block = Math.ceil(Math.max(width, height) / largest_px);
  if (block <= 1) return { width, height, pixels };
  const small = { width: Math.ceil(width / block), height: Math.ceil(height / block) };
  const strongest = new Uint8Array(small.width * small.height);
  for (let y = 0; y < height; y++) {
    const row = Math.floor(y / block) * small.width;
    for (let x = 0; x < width; x++) {
      const at = row + Math.floor(x / block);
      const value = pixels[y * width + x]!;
      if (value > strongest[at]!) strongest[at] = value;
    }
  }
  return { ...small, pixels: strongest };
}
