/** The picture of the map: one scene for the plan and for the space, drawn when something changed and only then. */

import { effect, signal } from "@preact/signals";
import { Group, Scene, WebGLRenderer } from "three";

import type { Place, PointerTool, Surface } from "../app";
import type { World } from "../live/world";
import type { Mover } from "../live/movement";
import type { MapModel, Thing } from "../map/model";
import type { Selection, State, Way } from "../state";
import { readColours, trackColour, type Colours } from "./colours";
import { Controls } from "./controls";
import { part, type Parted } from "./crowds";
import { Doors } from "./doors";
import { empty } from "./emptying";
import { addRing, Floors, lines } from "./floors";
import { Names } from "./names";
import { isSoftware, Pace } from "./pace";
import { People, type Look } from "./people";
import { crowdAt, levelsOf, pick, type Level } from "./picking";
import { pulledApart } from "../map/apart";
import { lights, meshesOf, thingsInPlan } from "./things";
import { View, type Eye } from "./view";

const SWITCH_MS = 650;
const MOST_PIXEL_RATIO = 2;
const MARK_PX = 3.5;
const WAY_PX = 2;
/** Above walls and below the leaves of doors. */
const MARK_ABOVE_M = 0.018;
const HOVER_AGAIN_MS = 120;
const NAMES_AGAIN_MS = 100;
/** How much nearer a click on a crowd leads. */
const INTO_CROWD = 2.5;

/** What is under the pointer, and where that is. */
export interface Hover {
  selection: Selection;
  x_px: number;
  y_px: number;
}

export class Stage implements Surface {
  readonly element: HTMLElement;
  readonly viewed = signal(0);
  readonly hover = signal<Hover | null>(null);

  private readonly state: State;
  private world: World;
  private readonly renderer: WebGLRenderer;
  /** There is no graphics card: each pixel counts. */
  private readonly isSoftware: boolean;
  private readonly pace = new Pace();
  private readonly names: Names;
  private readonly view = new View();
  private readonly controls: Controls;
  private readonly scene = new Scene();
  private readonly ground = new Group();
  private readonly backdrop = new Group();
  private readonly solid = new Group();
  private readonly marks = new Group();
  private readonly way = new Group();
  private colours: Colours = readColours();
  private people = new People(this.colours);
  private floors: Floors | null = null;
  private doors: Doors | null = null;
  private doorsVersion = -1;
  /** A leaf was drawn on its way. */
  private doorsSwing = false;
  private plan: Group | null = null;
  private shown: readonly Thing[] = [];
  private levels: readonly Level[] = [];
  private map: MapModel | null = null;
  private isFitted = true;
  private frame = 0;
  /** Where the pointer rests on the picture, in pixels. */
  private pointer: { x: number; y: number } | null = null;
  private hoveredAt_ms = -Infinity;
  private switchedAt_ms = -Infinity;
  private switchedFrom = 0;
  private readonly stillness = matchMedia("(prefers-reduced-motion: reduce)");
  private readonly look: Look;
  /** Who is drawn alone and who as a crowd, since the last picture. */
  private parted: Parted = { alone: [], crowds: [] };
  private writtenAt_ms = -Infinity;
  private writtenView = -1;

  constructor(element: HTMLElement, state: State, world: World) {
    this.element = element;
    this.state = state;
    this.world = world;
    this.isSoftware = isSoftware();
    this.renderer = new WebGLRenderer({ antialias: !this.isSoftware, powerPreference: "high-performance" });
    const labels = document.createElement("canvas");
    labels.className = "labels";
    element.append(this.renderer.domElement, labels);
    this.renderer.domElement.addEventListener("webglcontextrestored", () => this.draw());
    this.names = new Names(labels);
    this.look = { metresPerPixel: 0.01, mix: 0, selected: null, hovered: null, floorOf: this.floorOf };
    this.scene.add(
      this.backdrop,
      this.ground,
      this.solid,
      this.marks,
      this.way,
      this.people.group,
      ...lights(),
    );
    this.controls = new Controls(element, this.view, {
      viewed: () => this.lookAround(),
      clicked: (x, y) => this.click(x, y),
      hovered: (x, y) => {
        this.pointer = { x, y };
        this.setHover(x, y);
      },
      left: () => {
        this.pointer = null;
        this.hover.value = null;
      },
      fit: () => this.fit(),
    });
    new ResizeObserver(() => this.resize()).observe(element);
    this.resize();
    this.follow();
  }

  draw(): void {
    if (this.frame === 0) this.frame = requestAnimationFrame(this.render);
  }

  use(tool: PointerTool | null): void {
    this.controls.tool = tool;
    this.element.style.cursor = tool?.cursor ?? "";
    this.pointer = null;
    this.hover.value = null;
  }

  placeOf(event: MouseEvent): Place {
    return this.controls.placeOf(event);
  }

  pixelOf({ x_m, y_m }: Place): { x: number; y: number } {
    const at = { x: 0, y: 0 };
    this.view.camera();
    this.view.project(x_m, y_m, this.view.floor_m, at);
    return at;
  }

  metresPerPixel(): number {
    return this.view.metresPerPixel();
  }

  fit(): void {
    if (!this.map?.bounds) return;
    this.view.show(this.map.bounds);
    this.isFitted = !this.view.isTurned;
    this.changed();
  }

  zoom(factor: number): void {
    this.view.zoom(factor);
    this.lookAround();
  }

  /** From where the map is looked at; null: so that all of it is seen. */
  get eye(): Eye | null {
    return this.isFitted ? null : this.view.eye;
  }

  set eye(eye: Eye | null) {
    if (eye === null) this.fit();
    else {
      this.view.eye = eye;
      this.lookAround();
    }
  }

  /** Draws those who move in this world from now on. */
  setWorld(world: World): void {
    if (this.world === world) return;
    this.world = world;
    this.doorsVersion = -1;
    this.draw();
  }

  /** Draws with the colours that the theme has now. */
  recolour(): void {
    this.colours = readColours();
    this.scene.remove(this.people.group);
    this.people = new People(this.colours);
    this.scene.add(this.people.group);
    this.rebuild();
  }

  /** Puts a picture below the map. */
  setBackdrop(group: Group | null): void {
    empty(this.backdrop);
    if (group) this.backdrop.add(group);
    this.draw();
  }

  /** Puts meshes into the space: the map's as glTF, or none. */
  async setMeshes(glb: ArrayBuffer | null): Promise<void> {
    const told = this.state.map.peek();
    const wanted = new Map(
      this.of("thing").map((each) => [
        each.uid,
        { thing: each, lift_m: each.zMin_m - (told?.byId.get(each.id)?.zMin_m ?? each.zMin_m) },
      ]),
    );
    const mesh = glb && wanted.size > 0 ? await meshesOf(glb, wanted, this.colours) : null;
    empty(this.solid);
    if (mesh) this.solid.add(mesh);
    this.draw();
  }

  get colourOfGrid(): Colours["map-grid"] {
    return this.colours["map-grid"];
  }

  private follow(): void {
    const { map, storey, view, selection } = this.state;
    let framed: string | null = null;
    effect(() => {
      const isApart = storey.value === null && this.state.isApart.value;
      this.map = map.value && isApart ? pulledApart(map.value) : map.value;
      this.rebuild();
      const heights = isApart ? (this.map?.storeys ?? []).map((each) => each.elevation_m) : [];
      this.view.rise_m = Math.max(0, (heights.at(-1) ?? 0) - (heights[0] ?? 0));
      const wanted = `${this.map?.name} ${this.view.rise_m > 0}`;
      if (this.map?.bounds && framed !== wanted) {
        framed = wanted;
        this.fit();
      }
    });
    effect(() => {
      const target = view.value === "plan" ? 0 : 1;
      if (target === this.view.mix) return;
      this.switchedFrom = this.view.mix;
      this.switchedAt_ms = this.stillness.matches ? -Infinity : performance.now();
      this.draw();
    });
    effect(() => this.mark(selection.value));
    effect(() => this.drawWay(this.state.way.value, storey.peek()));
    effect(() => {
      void [this.hover.value, this.state.heat.value, this.state.warmth.value];
      this.draw();
    });
  }

  private rebuild(): void {
    empty(this.ground);
    const { map } = this;
    const storey = this.state.storey.peek();
    this.shown = (map?.things ?? []).filter(
      (each) => storey === null || each.storey === null || each.storey === storey,
    );
    this.view.floor_m = map?.storeys.find((each) => each.name === storey)?.elevation_m ?? lowest(this.shown);
    this.levels = storey === null ? levelsOf(this.shown) : [{ z_m: this.view.floor_m, things: this.shown }];
    this.floors = new Floors(this.of("room"), this.colours);
    this.plan = thingsInPlan(this.of("thing"), this.colours);
    this.doors = new Doors(this.of("door"), this.colours);
    this.doorsVersion = -1;
    this.ground.add(this.floors.group, this.plan, this.doors.group);
    this.names.prepare(this.of("room"), this.colours);
    this.renderer.setClearColor(this.colours["map-ground"]);
    this.backdrop.position.z = this.view.floor_m;
    this.mark(this.state.selection.peek());
    this.drawWay(this.state.way.peek(), storey);
    this.changed();
  }

  private of(kind: Thing["kind"]): Thing[] {
    return this.shown.filter((each) => each.kind === kind);
  }

  private mark(selection: Selection | null): void {
    empty(this.marks);
    const id =
      selection?.kind === "instance"
        ? selection.id
        : selection?.kind === "event"
          ? selection.event.instance?.id
          : undefined;
    const thing = id === undefined ? undefined : this.shown.find((each) => each.id === id);
    if (thing) {
      const segments: number[] = [];
      const z = thing.zMin_m + MARK_ABOVE_M;
      for (const ring of thing.outlines.flat()) addRing(ring, z, segments);
      if (thing.outlines.length === 0 && thing.line) segments.push(...thing.line[0], z, ...thing.line[1], z);
      this.marks.add(lines(segments, MARK_PX, this.colours["map-select"].getHex()));
    }
    this.draw();
  }

  private drawWay(way: Way | null, storey: string | null): void {
    empty(this.way);
    const floors = new Map(this.map?.storeys.map((each) => [each.name, each.elevation_m]));
    const segments: number[] = [];
    for (const line of way?.lines ?? []) {
      if (storey !== null && line.storey !== null && line.storey !== storey) continue;
      const z = (floors.get(line.storey ?? storey ?? "") ?? this.view.floor_m) + MARK_ABOVE_M;
      segments.push(...line.from, z, ...line.to, z);
    }
    if (way && segments.length > 0) this.way.add(lines(segments, WAY_PX, trackColour(way.trackId).getHex()));
    this.draw();
  }

  private readonly render = (now_ms: number): void => {
    this.frame = 0;
    let goesOn = this.switchView(now_ms);
    const isStill = this.stillness.matches;
    if (isStill) this.world.settle();
    else if (this.world.move(now_ms)) goesOn = true;
    const { isKnown, occupancy } = this.world;
    const isNow = this.state.heat.peek() === "now";
    this.floors?.tint(isNow ? (isKnown ? occupancy : null) : this.state.warmth.peek());
    this.doors?.show(this.world.isKnown);
    this.floors?.mix(this.view.mix);
    if (this.doors && this.doorsVersion !== this.world.doorsVersion) {
      this.doors.take(this.world.doors, now_ms, isStill || this.doorsVersion === -1);
      this.doorsVersion = this.world.doorsVersion;
      this.doorsSwing = true;
    }
    if (this.doorsSwing) this.doorsSwing = this.doors?.draw(now_ms) ?? false;
    goesOn ||= this.doorsSwing;
    this.solid.visible = this.view.mix > 0;
    if (this.plan) this.plan.visible = this.view.mix < 1 || this.solid.children.length === 0;
    const camera = this.view.camera();
    this.look.metresPerPixel = this.view.metresPerPixel();
    this.look.mix = this.view.mix;
    const selection = this.state.selection.peek();
    const hovered = this.hover.peek()?.selection;
    this.look.selected =
      selection?.kind === "track"
        ? selection.id
        : selection?.kind === "event"
          ? (selection.event.track?.id ?? null)
          : null;
    this.look.hovered = hovered?.kind === "track" ? hovered.id : null;
    const { metresPerPixel } = this.look;
    this.parted = part(this.world.movers.values(), metresPerPixel, this.floorOf, this.isMarked);
    this.people.draw(this.parted, this.look);
    this.renderer.render(this.scene, camera);
    if (this.mayWrite(now_ms, goesOn)) this.names.write(this.view, this.ratio(), this.parted, this.look);
    if (this.pace.drawn(now_ms, goesOn)) this.renderer.setPixelRatio(this.ratio() * this.pace.scale);
    if (!goesOn) return;
    this.hoverAgain(now_ms);
    this.draw();
  };

  /** Height of the floor below a track: that of its room; null where it is on another storey. */
  private readonly floorOf = (mover: Mover): number | null => {
    const storey = this.state.storey.peek();
    const [first] = mover.state.rooms;
    const room = first === undefined ? undefined : this.map?.byId.get(first);
    if (room === undefined) return this.view.floor_m;
    return storey === null || room.storey === null || room.storey === storey ? room.zMin_m : null;
  };

  /** Names cost a processor that draws as much as all else, and are a few pixels behind at most while people walk. */
  private mayWrite(now_ms: number, goesOn: boolean): boolean {
    const viewed = this.viewed.peek();
    const isSoon = now_ms - this.writtenAt_ms < NAMES_AGAIN_MS && viewed === this.writtenView;
    if (this.isSoftware && goesOn && isSoon) return false;
    this.writtenAt_ms = now_ms;
    this.writtenView = viewed;
    return true;
  }

  private readonly isMarked = ({ state }: Mover): boolean =>
    state.track_id === this.look.selected || state.track_id === this.look.hovered;

  private switchView(now_ms: number): boolean {
    const target = this.state.view.peek() === "plan" ? 0 : 1;
    if (this.view.mix === target) return false;
    const part = Math.min(1, (now_ms - this.switchedAt_ms) / SWITCH_MS);
    const eased = part * part * (3 - 2 * part);
    this.view.mix = part === 1 ? target : this.switchedFrom + (target - this.switchedFrom) * eased;
    this.viewed.value = this.viewed.peek() + 1;
    return part < 1;
  }

  private lookAround(): void {
    this.isFitted = false;
    this.changed();
  }

  private changed(): void {
    this.viewed.value = this.viewed.peek() + 1;
    this.pointer = null;
    this.hover.value = null;
    this.draw();
  }

  private click(x_px: number, y_px: number): void {
    if (crowdAt(this.view, this.parted.crowds, x_px, y_px)) {
      this.view.zoom(INTO_CROWD, x_px, y_px);
      this.lookAround();
      return;
    }
    const found = this.pickAt(x_px, y_px);
    this.state.selection.value = found;
    if (found)
      this.state.tab.value =
        this.state.tab.peek() === "edit" && found.kind === "instance" ? "edit" : "details";
  }

  private setHover(x_px: number, y_px: number): void {
    const isCrowd = crowdAt(this.view, this.parted.crowds, x_px, y_px) !== null;
    const found = isCrowd ? null : this.pickAt(x_px, y_px);
    const before = this.hover.peek();
    this.element.style.cursor = isCrowd ? "zoom-in" : found ? "pointer" : "";
    if (found === null) this.hover.value = null;
    else if (before?.x_px !== x_px || before.y_px !== y_px || !isSame(before.selection, found)) {
      this.hover.value = { selection: found, x_px, y_px };
    }
  }

  /** Who moves comes below a pointer that rests, or leaves it. */
  private hoverAgain(now_ms: number): void {
    if (this.pointer === null || this.controls.tool !== null || now_ms - this.hoveredAt_ms < HOVER_AGAIN_MS)
      return;
    this.hoveredAt_ms = now_ms;
    this.setHover(this.pointer.x, this.pointer.y);
  }

  private pickAt(x_px: number, y_px: number): Selection | null {
    return pick(this.view, this.levels, this.parted.alone, this.floorOf, x_px, y_px);
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.element;
    if (clientWidth === 0 || clientHeight === 0) return;
    this.view.width_px = clientWidth;
    this.view.height_px = clientHeight;
    this.renderer.setPixelRatio(this.ratio() * this.pace.scale);
    this.renderer.setSize(clientWidth, clientHeight);
    if (this.isFitted) this.fit();
    this.changed();
  }

  private ratio(): number {
    return Math.min(devicePixelRatio, this.isSoftware ? 1 : MOST_PIXEL_RATIO);
  }
}

function isSame(a: Selection, b: Selection): boolean {
  return a.kind === b.kind && "id" in a && "id" in b && a.id === b.id;
}

function lowest(things: readonly Thing[]): number {
  const floors = things.filter((each) => each.kind === "room").map((each) => each.zMin_m);
  return floors.length > 0 ? Math.min(...floors) : 0;
}
