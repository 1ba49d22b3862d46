/** Which names are written on the picture: of people below them, of rooms in their middle. */

import type { Mover } from "../live/movement";
import type { Thing } from "../map/model";
import type { Colours } from "./colours";
import { Labels, type LabelStyle } from "./labels";
import type { Look } from "./people";
import type { View } from "./view";

const ROOM_PX = 13;
const TRACK_PX = 11.5;
const TRACK_BELOW_PX = 19;
const SELECTED_BELOW_PX = 22;
const TRACK_RADIUS_PX = 7;
/** A room that is narrower on the screen has no name written. */
const LEAST_ROOM_PX = 30;

interface RoomName {
  text: string;
  x_m: number;
  y_m: number;
  z_m: number;
  extent_m: number;
}

export class Names {
  private readonly labels: Labels;
  private rooms: readonly RoomName[] = [];
  private readonly trackStyle: LabelStyle = { font: "", ink: "", halo: "" };
  private readonly roomStyle: LabelStyle = { font: "", ink: "", halo: "" };

  constructor(canvas: HTMLCanvasElement) {
    this.labels = new Labels(canvas);
  }

  /** Takes the rooms that are shown, and the colours. */
  prepare(rooms: readonly Thing[], colours: Colours): void {
    const family = getComputedStyle(document.body).fontFamily;
    const ink = `#${colours["map-label"].getHexString()}`;
    const halo = `#${colours["map-label-halo"].getHexString()}`;
    Object.assign(this.trackStyle, { font: `600 ${TRACK_PX}px ${family}`, ink, halo });
    Object.assign(this.roomStyle, { font: `500 ${ROOM_PX}px ${family}`, ink, halo });
    this.rooms = rooms.map((room) => ({
      text: room.alias ?? room.name,
      x_m: room.place[0],
      y_m: room.place[1],
      z_m: room.zMin_m,
      extent_m: extentOf(room),
    }));
  }

  /** Writes all that there is room for; people first. */
  write(view: View, ratio: number, movers: ReadonlyMap<number, Mover>, look: Look): void {
    this.labels.begin(view, ratio);
    for (const [id, mover] of movers) {
      const floor = look.floorOf(mover);
      if (floor === null) continue;
      const { x_m, y_m } = mover;
      this.labels.keepOff(x_m, y_m, floor, TRACK_RADIUS_PX);
      const below_px = id === look.selected ? SELECTED_BELOW_PX : TRACK_BELOW_PX;
      this.labels.write(mover.state.name, x_m, y_m, floor, below_px, TRACK_PX, this.trackStyle);
    }
    const narrowest_m = LEAST_ROOM_PX * look.metresPerPixel;
    for (const { text, x_m, y_m, z_m, extent_m } of this.rooms) {
      if (extent_m >= narrowest_m) this.labels.write(text, x_m, y_m, z_m, 0, ROOM_PX, this.roomStyle);
    }
  }
}

/** The shorter side of what a room reaches over [m]. */
function extentOf(room: Thing): number {
  const ring = room.outlines[0]?.[0] ?? [];
  const xs = ring.map(([x]) => x);
  const ys = ring.map(([, y]) => y);
  return Math.min(Math.max(...xs) - Math.min(...xs), Math.max(...ys) - Math.min(...ys));
}
