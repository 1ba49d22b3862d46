/** Which names are written on the picture: of people below them, of rooms in their middle. */

import type { Mover } from "../live/movement";
import type { Point, Thing } from "../map/model";
import { outlineContains } from "../map/shape";
import type { Colours } from "./colours";
import { radiusOf, type Parted } from "./crowds";
import { Labels, type LabelStyle } from "./labels";
import { halfLength, type Look } from "./people";
import type { View } from "./view";

const ROOM_PX = 13;
const TRACK_PX = 11.5;
/** From the edge of one to the middle of his name. */
const BELOW_PX = 13;
const BELOW_SELECTED_PX = 16;
/** A room that is narrower on the screen has no name written. */
const LEAST_ROOM_PX = 30;
const TRACK_WIDTH_PX = 150;
/** Between a name and the walls. */
const BESIDE_PX = 8;
const LEAST_STOREY_M = 0.5;
const ROWS = 24;

/** A place for a name, and how wide it may be. */
interface Span {
  x_m: number;
  y_m: number;
  width_m: number;
}

interface RoomName {
  text: string;
  x_m: number;
  y_m: number;
  z_m: number;
  extent_m: number;
  /** How much room there is for it to the left and right. */
  width_m: number;
  /** Where the room is widest, for a name that is longer. */
  widest: Span;
}

export class Names {
  private readonly labels: Labels;
  private rooms: readonly RoomName[] = [];
  /** Where there are several storeys: the rooms whose floors may lie before a name. */
  private floors: readonly Thing[] = [];
  private readonly at = { x: 0, y: 0 };
  private readonly trackStyle: LabelStyle = { font: "", ink: "", halo: "" };
  private readonly roomStyle: LabelStyle = { font: "", ink: "", halo: "" };
  private readonly crowdStyle: LabelStyle = { font: "", ink: "", halo: null };
  private readonly ordered: Mover[] = [];
  /** Whose names the last picture had. */
  private written: ReadonlySet<number> = new Set();

  constructor(canvas: HTMLCanvasElement) {
    this.labels = new Labels(canvas);
  }

  /** Takes the rooms that are shown, and the colours. */
  prepare(rooms: readonly Thing[], colours: Colours): void {
    const family = getComputedStyle(document.body).fontFamily;
    const ink = `#${colours["map-label"].getHexString()}`;
    const halo = `#${colours["map-label-halo"].getHexString()}`;
    Object.assign(this.trackStyle, { font: `600 ${TRACK_PX}px ${family}`, ink, halo });
    Object.assign(this.crowdStyle, { font: `600 ${TRACK_PX}px ${family}`, ink: halo });
    Object.assign(this.roomStyle, { font: `500 ${ROOM_PX}px ${family}`, ink, halo });
    this.rooms = rooms.map((room) => ({
      text: room.alias ?? room.name,
      x_m: room.place[0],
      y_m: room.place[1],
      z_m: room.zMin_m,
      extent_m: extentOf(room),
      width_m: widthAt(room, room.place),
      widest: widestOf(room),
    }));
    const storeys = new Set(this.rooms.map((each) => each.z_m));
    this.floors = storeys.size > 1 ? rooms : [];
  }

  /**
   * Writes all that there is room for, the more important first: who was chosen, whose name was there a moment ago, who is
   * on the move, and then rooms. No name lies on another or on somebody.
   */
  write(view: View, ratio: number, { alone, crowds }: Parted, look: Look): void {
    this.labels.begin(view, ratio);
    for (const { x_m, y_m, floor_m, count } of crowds) {
      this.labels.keepOff(x_m, y_m, floor_m, radiusOf(count));
      this.labels.writeOn(String(count), x_m, y_m, floor_m, this.crowdStyle);
    }
    for (const mover of alone) {
      const floor_m = look.floorOf(mover);
      if (floor_m !== null) this.labels.keepOff(mover.x_m, mover.y_m, floor_m, radiusIn(look, mover));
    }
    this.people(alone, look);
    this.named(view, look);
  }

  private people(alone: readonly Mover[], look: Look): void {
    const wanted = this.ordered;
    wanted.length = 0;
    for (const mover of alone) wanted.push(mover);
    wanted.sort((a, b) => this.importance(b, look) - this.importance(a, look));
    const written = new Set<number>();
    for (const mover of wanted) {
      const floor_m = look.floorOf(mover);
      if (floor_m === null) continue;
      const { track_id: id, name } = mover.state;
      const below_px = radiusIn(look, mover) + (id === look.selected ? BELOW_SELECTED_PX : BELOW_PX);
      const { x_m, y_m } = mover;
      if (this.labels.write(name, x_m, y_m, floor_m, below_px, TRACK_PX, TRACK_WIDTH_PX, this.trackStyle))
        written.add(id);
    }
    this.written = written;
  }

  private importance({ state, trailLength }: Mover, look: Look): number {
    const id = state.track_id;
    if (id === look.selected) return 4;
    if (id === look.hovered) return 3;
    return (this.written.has(id) ? 2 : 0) + (trailLength > 1 ? 1 : 0);
  }

  private named(view: View, look: Look): void {
    const narrowest_m = LEAST_ROOM_PX * look.metresPerPixel;
    for (const room of this.rooms) {
      if (room.extent_m < narrowest_m) continue;
      const isLong =
        this.labels.widthOf(room.text, this.roomStyle.font) > room.width_m / look.metresPerPixel - BESIDE_PX;
      const { x_m, y_m, width_m } = isLong ? room.widest : room;
      if (this.isCovered(view, x_m, y_m, room.z_m)) continue;
      const width_px = width_m / look.metresPerPixel - BESIDE_PX;
      this.labels.write(room.text, x_m, y_m, room.z_m, 0, ROOM_PX, width_px, this.roomStyle);
    }
  }

  /** Whether the floor of a room above lies before a place: its name would seem to be of that room. */
  private isCovered(view: View, x_m: number, y_m: number, z_m: number): boolean {
    if (this.floors.length === 0 || !view.project(x_m, y_m, z_m, this.at)) return false;
    const { origin, direction } = view.sight(this.at.x, this.at.y);
    return this.floors.some((room) => {
      if (room.zMin_m <= z_m + LEAST_STOREY_M) return false;
      const far = (room.zMin_m - origin.z) / direction.z;
      const place: Point = [origin.x + far * direction.x, origin.y + far * direction.y];
      return room.outlines.some((outline) => outlineContains(outline, place));
    });
  }
}

/** How large somebody is on the screen [px]. */
function radiusIn({ metresPerPixel }: Look, mover: Mover): number {
  return halfLength(mover, metresPerPixel) / metresPerPixel;
}

/** The shorter side of what a room reaches over [m]. */
function extentOf(room: Thing): number {
  const ring = room.outlines[0]?.[0] ?? [];
  const xs = ring.map(([x]) => x);
  const ys = ring.map(([, y]) => y);
  return Math.min(Math.max(...xs) - Math.min(...xs), Math.max(...ys) - Math.min(...ys));
}

/** From wall to wall through a row of a room, where that is longest. */
function widestIn(room: Thing, y_m: number): Span {
  const crossed = (room.outlines[0] ?? []).flatMap((ring) =>
    ring.flatMap(([ax, ay], i) => {
      const [bx, by] = ring[(i + 1) % ring.length]!;
      return ay > y_m === by > y_m ? [] : [ax + ((y_m - ay) / (by - ay)) * (bx - ax)];
    }),
  );
  crossed.sort((a, b) => a - b);
  let best: Span = { x_m: room.place[0], y_m, width_m: 0 };
  for (let i = 0; i + 1 < crossed.length; i += 2) {
    const [left, right] = [crossed[i]!, crossed[i + 1]!];
    if (right - left > best.width_m) best = { x_m: (left + right) / 2, y_m, width_m: right - left };
  }
  return best;
}

function widestOf(room: Thing): Span {
  const ys = (room.outlines[0]?.[0] ?? []).map(([, y]) => y);
  const [low, high] = [Math.min(...ys), Math.max(...ys)];
  const rows = Array.from({ length: ROWS }, (_, i) =>
    widestIn(room, low + ((i + 0.5) / ROWS) * (high - low)),
  );
  const most_m = Math.max(...rows.map((each) => each.width_m));
  const wide = rows.filter((each) => each.width_m >= 0.98 * most_m);
  // The middle one, away from the walls.
  return wide[wide.length >> 1] ?? { x_m: room.place[0], y_m: room.place[1], width_m: 0 };
}

/** How wide a name may be in the middle of which a place is. */
function widthAt(room: Thing, [x_m, y_m]: Point): number {
  const row = widestIn(room, y_m);
  return Math.max(0, row.width_m - 2 * Math.abs(row.x_m - x_m));
}
