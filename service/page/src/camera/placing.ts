/** A fixed camera that is being placed: its picture, and points of the floor in it and on the plan. */

import { computed, signal, type Signal } from "@preact/signals";

import type { Bounds, MapModel, Point, Thing } from "../map/model";
import { boundsOf } from "../map/shape";
import { lensOver, type Pair } from "./lens";
import { rigText } from "./rig_text";

export interface Picture {
  readonly name: string;
  readonly url: string;
  readonly size: Point;
  /** The same, smaller. */
  readonly small: ImageData;
}

/** A point of the floor; null where it has not been said yet. */
export interface Mark {
  readonly pixel: Point | null;
  readonly place: Point | null;
}

export type Side = keyof Mark;

export const LEAST_POINTS = 4;
/** A rig whose points are farther off, in its own pixels, is not read. */
const MOST_OFF_PX = 20;
const MOST_SMALL_PX = 960;
const MARGIN_M = 1;

export class Placing {
  readonly model: Signal<MapModel>;
  readonly picture = signal<Picture | null>(null);
  /** The name of a file that is no picture. */
  readonly refused = signal<string | null>(null);
  readonly marks = signal<readonly Mark[]>([]);
  readonly storey = signal<string | null>(null);
  readonly name = signal("camera_1");
  /** Empty: as its name. */
  readonly topic = signal("");
  /** null: as the points tell. */
  readonly angle_deg = signal<number | null>(null);
  /** Of the images in which persons are found; null: of the picture. */
  readonly width_px = signal<number | null>(null);

  private readonly pairs = computed(() =>
    this.marks.value.filter((mark): mark is Pair => mark.pixel !== null && mark.place !== null),
  );

  /** How many points are in the picture and on the plan. */
  readonly count = computed(() => this.pairs.value.length);

  /** null while there are too few points. */
  readonly lens = computed(() => {
    const picture = this.picture.value;
    if (picture === null || this.count.value < LEAST_POINTS) return null;
    return lensOver(this.pairs.value, picture.size, this.focalOf(picture.size[0]));
  });

  /** How far each mark is off [px]; null: not known. */
  readonly off_px = computed(() => {
    const lens = this.lens.value;
    const pairs: readonly Mark[] = this.pairs.value;
    return this.marks.value.map((mark) =>
      lens === null || typeof lens === "string" ? null : (lens.off_px[pairs.indexOf(mark)] ?? null),
    );
  });

  constructor(model: MapModel) {
    this.model = signal(model);
  }

  /** What stands on the storey. */
  things(): readonly Thing[] {
    const storey = this.storey.value;
    return this.model.value.things.filter((each) => storey === null || (each.storey ?? storey) === storey);
  }

  /** With a margin, in which cameras hang and points may lie. */
  bounds(): Bounds {
    const found = boundsOf(this.things()) ?? { xMin_m: 0, yMin_m: 0, xMax_m: 10, yMax_m: 10 };
    return {
      xMin_m: found.xMin_m - MARGIN_M,
      yMin_m: found.yMin_m - MARGIN_M,
      xMax_m: found.xMax_m + MARGIN_M,
      yMax_m: found.yMax_m + MARGIN_M,
    };
  }

  /** Says where a point is: the first that lacks this side, or a new one. */
  put(side: Side, at: Point): void {
    const lacking = this.marks.value.findIndex((mark) => mark[side] === null);
    if (lacking >= 0) this.move(lacking, side, at);
    else this.marks.value = [...this.marks.value, { pixel: null, place: null, [side]: at }];
  }

  move(index: number, side: Side, at: Point): void {
    this.marks.value = this.marks.value.map((mark, i) => (i === index ? { ...mark, [side]: at } : mark));
  }

  remove(index: number): void {
    this.marks.value = this.marks.value.filter((_, i) => i !== index);
  }

  async take(file: File): Promise<void> {
    const picture = await readPicture(file);
    this.refused.value = picture === null ? file.name : null;
    if (picture !== null) this.show(picture);
  }

  /** A picture of another size has other points. */
  show(picture: Picture): void {
    const before = this.picture.value;
    if (before !== null) URL.revokeObjectURL(before.url);
    if (before !== null && String(before.size) !== String(picture.size)) this.marks.value = [];
    this.picture.value = picture;
  }

  /** The camera's part of a rig; null: there is no such camera yet. */
  rig(): string | null {
    const [picture, lens] = [this.picture.value, this.lens.value];
    if (picture === null || lens === null || typeof lens === "string") return null;
    if (lens.off_px.some((each) => this.isFar(each)) || this.name.value.trim() === "") return null;
    const name = this.name.value.trim();
    const width_px = this.width_px.value ?? picture.size[0];
    const scale = this.scale();
    const { elevation_m } = this.model.value.storeys.find((each) => each.name === this.storey.value) ?? {
      elevation_m: 0,
    };
    return rigText({
      name,
      topic: this.topic.value.trim() || name,
      size: [width_px, Math.round(picture.size[1] * scale)],
      pairs: this.pairs.value.map(({ pixel: [u, v], place }) => ({ pixel: [u * scale, v * scale], place })),
      focal_px: this.focalOf(width_px),
      floor_z_m: elevation_m,
    });
  }

  /** Whether a point is so far off in the picture [px] that no rig can be made. */
  isFar(off_px: number): boolean {
    return off_px * this.scale() > MOST_OFF_PX;
  }

  private scale(): number {
    const width_px = this.picture.value?.size[0] ?? 1;
    return (this.width_px.value ?? width_px) / width_px;
  }

  private focalOf(width_px: number): number | null {
    const angle = this.angle_deg.value;
    return angle === null ? null : width_px / 2 / Math.tan((angle * Math.PI) / 360);
  }
}

/** null: it is no picture that the browser can show. */
async function readPicture(file: File): Promise<Picture | null> {
  let bitmap: ImageBitmap;
  try {
    bitmap = await createImageBitmap(file);
  } catch {
    return null;
  }
  const { width, height } = bitmap;
  const share = Math.min(1, MOST_SMALL_PX / Math.max(width, height));
  const canvas = document.createElement("canvas");
  canvas.width = Math.max(1, Math.round(width * share));
  canvas.height = Math.max(1, Math.round(height * share));
  const context = canvas.getContext("2d")!;
  context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
  const small = context.getImageData(0, 0, canvas.width, canvas.height);
  return { name: file.name, url: URL.createObjectURL(file), size: [width, height], small };
}
