/** A drawing tool in the hand of a user: the pointer, the crosshair of the keyboard, and what sends the result. */

import { signal } from "@preact/signals";

import type { InstanceChanges, InstanceDocument, NewInstance } from "../documents";
import { ApiError, type Answer } from "../api";
import type { App, Place, PointerTool } from "../app";
import type { Point, Thing } from "../map/model";
import { Editing, type Draft, type Surroundings } from "./editing";
import { outlinesOf, polygonOf } from "./outline";
import { gridFor } from "./snapping";
import { changeInstance, createInstance, movedBy, poseOf, readInstance } from "./writes";
import { t } from "../language/catalogue";

/** What is asked of a new room or door beside its shape. */
export interface Naming {
  name: string;
  concept: string;
  height_m: number | null;
  leaf: "left" | "right" | null;
}

export class Drawing {
  readonly editing: Editing;
  readonly crosshair = signal<Point | null>(null);
  readonly isSending = signal(false);

  private away: Draft | null = null;
  /** What is being moved or reshaped, as it was when that began. */
  private base: Answer<InstanceDocument> | null = null;

  constructor(private readonly app: App) {
    this.editing = new Editing(
      () => this.surroundings(),
      () => app.surface.metresPerPixel(),
    );
  }

  get isOn(): boolean {
    return this.editing.draft.value !== null;
  }

  drawRoom(): void {
    this.take("crosshair");
    this.editing.drawRoom();
  }

  drawDoor(): void {
    this.take("crosshair");
    this.editing.drawDoor();
  }

  /** Takes hold of something as it is now, not as the map was read. Raises ApiError. */
  async change(thing: Thing): Promise<void> {
    this.base = await readInstance(this.app.api, thing.id);
    this.take("move");
    const { footprint } = this.base.body;
    this.editing.change(footprint === null ? thing : { ...thing, outlines: outlinesOf(footprint) });
  }

  /** Puts the drawing away while another panel is looked at; it is taken up again with this one. */
  putAway(): void {
    const draft = this.editing.draft.peek();
    if (draft === null) return;
    this.stop();
    this.away = draft;
    this.app.announce(t("The drawing waits in the panel Edit."));
  }

  takeUp(): void {
    const draft = this.away;
    if (draft === null) return;
    this.take(draft.kind === "room" || draft.kind === "door" ? "crosshair" : "move");
    this.editing.draft.value = draft;
  }

  stop(): void {
    this.away = null;
    this.app.surface.use(null);
    this.crosshair.value = null;
    this.editing.stop();
  }

  /** The thing that is selected, as the map shows it. */
  selected(): Thing | null {
    const selection = this.app.state.selection.value;
    return selection?.kind === "instance" ? (this.app.state.map.value?.byId.get(selection.id) ?? null) : null;
  }

  /** Moves the crosshair of a drawing, or what is being moved, by steps of the grid. */
  go([right, up]: Point): void {
    const grid_m = gridFor(this.app.surface.metresPerPixel());
    const draft = this.editing.draft.value;
    if (draft?.kind === "shape" || draft?.kind === "place") {
      this.editing.nudge([right * grid_m, up * grid_m]);
      return;
    }
    const [x, y] = this.crosshair.value ?? this.middle();
    this.crosshair.value = [x + right * grid_m, y + up * grid_m];
    this.editing.point(this.crosshair.value, false);
  }

  /** Enter: places what the crosshair is at, or closes the room where it was not moved since the last corner. */
  place(): void {
    const at = this.crosshair.value;
    const draft = this.editing.draft.value;
    const last = draft?.kind === "room" ? draft.corners.at(-1) : undefined;
    const aim = this.editing.aim.value?.point;
    if (
      at === null ||
      (last !== undefined && aim !== undefined && last[0] === aim[0] && last[1] === aim[1])
    ) {
      this.editing.close();
    } else {
      this.editing.press(at, false);
    }
  }

  /** Makes what was drawn. Raises ApiError. */
  async make(naming: Naming): Promise<void> {
    const map = this.app.state.mapName.value;
    const made = this.newInstance(naming);
    if (map === null || made === null) return;
    await this.sending(async () => {
      const { id } = await createInstance(this.app.api, map, made);
      this.stop();
      await this.app.reloadMap();
      this.app.state.selection.value = { kind: "instance", id };
      this.app.announce(t("{0} is on the map.", made.name));
    });
  }

  /**
   * Puts what was moved or reshaped in its new place. Raises ApiError; where somebody else was faster (412) the
   * tool goes on with what it is like now.
   */
  async settle(): Promise<void> {
    const draft = this.editing.draft.value;
    if (this.base === null || (draft?.kind !== "shape" && draft?.kind !== "place")) return;
    const changes = changesOf(draft, this.base.body);
    if (Object.keys(changes).length === 0) return this.stop();
    const { thing } = draft;
    const message = `${changes.footprint === undefined ? "move" : "reshape"} ${thing.name}`;
    const { etag } = this.base;
    await this.sending(async () => {
      try {
        await changeInstance(this.app.api, thing.id, changes, etag, message);
      } catch (error) {
        if (isConflict(error)) await this.beginAgain(thing.id);
        throw error;
      }
      this.stop();
      await this.app.reloadMap();
      this.app.announce(t("{0} has its new place.", thing.name));
    });
  }

  private async beginAgain(id: number): Promise<void> {
    await this.app.reloadMap();
    const newest = this.app.state.map.value?.byId.get(id);
    if (newest === undefined) this.stop();
    else await this.change(newest);
  }

  private newInstance({ name, concept, height_m, leaf }: Naming): NewInstance | null {
    const draft = this.editing.draft.value;
    const storey = this.storey();
    const elevation_m = storey?.elevation_m ?? 0;
    const made: NewInstance = { name, concept, ...(storey && { storey: storey.name }) };
    if (draft?.kind === "room" && draft.isClosed) {
      const heights = height_m === null ? {} : { elevation_m, height_m };
      return { ...made, footprint: polygonOf([draft.corners]), ...heights };
    }
    if (draft?.kind === "door" && draft.doorway !== null) {
      const attributes = { width_m: draft.doorway.width_m, ...(leaf && { leaf }) };
      return { ...made, joins: draft.doorway.joins, attributes, pose: poseOf(draft.doorway, elevation_m) };
    }
    return null;
  }

  private async sending(send: () => Promise<void>): Promise<void> {
    if (this.isSending.value) return;
    this.isSending.value = true;
    try {
      await send();
    } finally {
      this.isSending.value = false;
    }
  }

  private take(cursor: string): void {
    this.away = null;
    this.app.state.view.value = "plan";
    this.app.state.tab.value = "edit";
    if (!this.app.state.isLive.value) this.app.moveTo(null);
    this.crosshair.value = null;
    this.app.surface.use(this.tool(cursor));
    // So that the keys lead the tool, and not the button that began it.
    this.app.surface.element.closest<HTMLElement>("[tabindex]")?.focus();
  }

  private tool(cursor: string): PointerTool {
    const point = ({ x_m, y_m }: Place): Point => [x_m, y_m];
    return {
      cursor,
      down: (place, event) => {
        this.crosshair.value = null;
        return event.button === 0 && event.isPrimary && this.editing.press(point(place), event.shiftKey);
      },
      move: (place, event) => {
        if (this.crosshair.value !== null && event.movementX === 0 && event.movementY === 0) return false;
        this.crosshair.value = null;
        this.editing.point(point(place), event.shiftKey);
        return event.buttons === 1;
      },
      up: () => {
        this.editing.release();
        return true;
      },
      doubleClick: () => {
        this.editing.close();
        return true;
      },
    };
  }

  /** What is on the storey that is shown, without what is being changed. */
  private surroundings(): Surroundings {
    const draft = this.editing.draft.value;
    const changed = draft?.kind === "shape" || draft?.kind === "place" ? draft.thing.id : null;
    const storey = this.app.state.storey.value;
    const things = (this.app.state.map.value?.things ?? []).filter(
      (thing) =>
        thing.id !== changed && (storey === null || thing.storey === null || thing.storey === storey),
    );
    const rooms = things.filter((thing) => thing.kind === "room");
    return { rooms, outlines: rooms.flatMap((room) => room.outlines) };
  }

  /** The storey that something new is on: the one that is shown, or the only one. */
  private storey(): { name: string; elevation_m: number } | null {
    const storeys = this.app.state.map.value?.storeys ?? [];
    const shown = storeys.find((each) => each.name === this.app.state.storey.value);
    return shown ?? (storeys.length === 1 ? (storeys[0] ?? null) : null);
  }

  private middle(): Point {
    const { left, top, width, height } = this.app.surface.element.getBoundingClientRect();
    const at = new MouseEvent("mousemove", { clientX: left + width / 2, clientY: top + height / 2 });
    const { x_m, y_m } = this.app.surface.placeOf(at);
    const grid_m = gridFor(this.app.surface.metresPerPixel());
    return [Math.round(x_m / grid_m) * grid_m, Math.round(y_m / grid_m) * grid_m];
  }
}

function changesOf(draft: Draft & { kind: "shape" | "place" }, { pose }: InstanceDocument): InstanceChanges {
  const isMoved = draft.moved[0] !== 0 || draft.moved[1] !== 0;
  if (draft.kind === "place" && draft.doorway !== null) {
    return { pose: poseOf(draft.doorway, pose?.z_m ?? 0), joins: draft.doorway.joins };
  }
  const isReshaped = draft.kind === "shape" && (draft.isReshaped || (isMoved && pose === null));
  return {
    ...(isMoved && pose && { pose: movedBy(pose, draft.moved) }),
    ...(isReshaped && { footprint: polygonOf(draft.rings) }),
  };
}

/** Whether somebody else was faster. */
export function isConflict(error: unknown): boolean {
  return error instanceof ApiError && error.status === 412;
}
