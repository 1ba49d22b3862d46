/** Pointer, wheel and keys on the picture: they move the view, or are given to the tool that has the pointer. */

import type { Place, PointerTool } from "../app";
import type { View } from "./view";

const WHEEL_ZOOM = 0.0016;
const KEY_PAN = 0.12;
const KEY_ZOOM = 1.25;
/** A pointer that moved less was a click. */
const CLICK_PX = 5;

export interface ControlsUser {
  /** The view was changed. */
  viewed(): void;
  clicked(x_px: number, y_px: number): void;
  hovered(x_px: number, y_px: number): void;
  left(): void;
  /** Shows all of the map. */
  fit(): void;
}

interface Finger {
  x: number;
  y: number;
  startX: number;
  startY: number;
}

export class Controls {
  tool: PointerTool | null = null;
  private readonly element: HTMLElement;
  private readonly view: View;
  private readonly user: ControlsUser;
  private readonly fingers = new Map<number, Finger>();
  /** The tool has the pointer that is down. */
  private isTools = false;
  private isTurning = false;
  private wasClick = false;

  constructor(element: HTMLElement, view: View, user: ControlsUser) {
    this.element = element;
    this.view = view;
    this.user = user;
    element.addEventListener("pointerdown", this.down);
    element.addEventListener("pointermove", this.move);
    element.addEventListener("pointerup", this.up);
    element.addEventListener("pointercancel", this.up);
    element.addEventListener("pointerleave", () => user.left());
    element.addEventListener("dblclick", (event) => this.tool?.doubleClick?.(this.placeOf(event), event));
    element.addEventListener("contextmenu", (event) => event.preventDefault());
    element.addEventListener("wheel", this.wheel, { passive: false });
    element.addEventListener("keydown", this.key);
  }

  placeOf(event: MouseEvent): Place {
    const box = this.element.getBoundingClientRect();
    return this.view.placeAt(event.clientX - box.left, event.clientY - box.top);
  }

  private readonly down = (event: PointerEvent): void => {
    const { x, y } = this.pixelOf(event);
    this.element.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, { x, y, startX: x, startY: y });
    this.wasClick = this.fingers.size === 1;
    this.isTurning = this.view.mix === 1 && event.button === 0 && !event.shiftKey;
    if (this.fingers.size === 1 && event.button === 0 && this.tool?.down) {
      this.isTools = this.tool.down(this.placeOf(event), event);
    } else if (this.fingers.size > 1) this.isTools = false;
  };

  private readonly move = (event: PointerEvent): void => {
    const { x, y } = this.pixelOf(event);
    const finger = this.fingers.get(event.pointerId);
    if (!finger) {
      if (this.tool?.move?.(this.placeOf(event), event)) return;
      this.user.hovered(x, y);
      return;
    }
    if (Math.hypot(x - finger.startX, y - finger.startY) > CLICK_PX) this.wasClick = false;
    if (this.isTools) {
      this.tool?.move?.(this.placeOf(event), event);
      finger.x = x;
      finger.y = y;
      return;
    }
    if (this.fingers.size === 2) this.pinch(event.pointerId, finger, x, y);
    else if (!this.wasClick) {
      if (this.isTurning) this.view.orbit(x - finger.x, y - finger.y);
      else this.view.drag(finger.x, finger.y, x, y);
      this.user.viewed();
    }
    if (!this.wasClick) {
      finger.x = x;
      finger.y = y;
    }
  };

  private readonly up = (event: PointerEvent): void => {
    if (!this.fingers.delete(event.pointerId)) return;
    const wasTools = this.isTools;
    if (this.fingers.size === 0) this.isTools = false;
    if (wasTools) {
      this.tool?.up?.(this.placeOf(event), event);
      return;
    }
    const { x, y } = this.pixelOf(event);
    if (this.wasClick && this.fingers.size === 0 && event.type === "pointerup" && event.button === 0)
      this.user.clicked(x, y);
  };

  /** Two fingers: what is below them stays below them. */
  private pinch(id: number, finger: Finger, x: number, y: number): void {
    const other = [...this.fingers].find(([each]) => each !== id)?.[1];
    if (!other) return;
    const before = Math.hypot(finger.x - other.x, finger.y - other.y);
    const after = Math.hypot(x - other.x, y - other.y);
    const [middleX, middleY] = [(x + other.x) / 2, (y + other.y) / 2];
    this.view.drag((finger.x + other.x) / 2, (finger.y + other.y) / 2, middleX, middleY);
    if (before > 10 && after > 10) this.view.zoom(after / before, middleX, middleY);
    this.user.viewed();
  }

  private readonly wheel = (event: WheelEvent): void => {
    event.preventDefault();
    const { x, y } = this.pixelOf(event);
    const lines = event.deltaMode === 1 ? 24 : 1;
    const speed = event.ctrlKey ? 6 : 1;
    this.view.zoom(Math.exp(-event.deltaY * lines * speed * WHEEL_ZOOM), x, y);
    this.user.viewed();
  };

  private readonly key = (event: KeyboardEvent): void => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target !== this.element) return;
    const step = KEY_PAN * this.view.height_px;
    const pan: Record<string, [number, number]> = {
      ArrowLeft: [step, 0],
      ArrowRight: [-step, 0],
      ArrowUp: [0, step],
      ArrowDown: [0, -step],
    };
    const by = pan[event.key];
    const [middleX, middleY] = [this.view.width_px / 2, this.view.height_px / 2];
    if (by && event.shiftKey) this.view.orbit(by[0], by[1]);
    else if (by) this.view.drag(middleX, middleY, middleX + by[0], middleY + by[1]);
    else if (event.key === "+" || event.key === "=") this.view.zoom(KEY_ZOOM);
    else if (event.key === "-") this.view.zoom(1 / KEY_ZOOM);
    else if (event.key !== "0" && event.key !== "Home") return;
    event.preventDefault();
    if (event.key === "0" || event.key === "Home") this.user.fit();
    else this.user.viewed();
  };

  private pixelOf(event: MouseEvent): { x: number; y: number } {
    const box = this.element.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }
}
