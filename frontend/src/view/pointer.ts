// Pointer, wheel and keys of a view: turn, move, zoom. One finger turns, two move and zoom.

import type { ScreenBox } from "../maths/space_camera.ts";
import type { Vector2 } from "../types.ts";
import { isInUse } from "../ui/dom.ts";
import type { VolumeViewLike } from "./types.ts";

const TURN = 2.6; // radians for a drag across the smaller side of the view
const KEY_TURN = Math.PI / 36;
const DOUBLE_TAP = { wait: 350, away: 24 }; // milliseconds and CSS pixels between two taps of a finger

export class PointerControls {
  points = new Map<number, Vector2>(); // the places of the pointers that are down, by their ids
  moving = false;
  rest = 0;
  closed = new AbortController();
  #tap = { at: [0, 0] as Vector2, time: -Infinity };

  constructor(readonly view: VolumeViewLike) {
    const { canvas } = view.elements,
      { signal } = this.closed;
    const add = <K extends keyof HTMLElementEventMap>(name: K, handler: (event: HTMLElementEventMap[K]) => void) =>
      canvas.addEventListener(
        name,
        (event) => {
          if (view.info) handler(event);
        },
        { passive: false, signal },
      );
    add("pointerdown", (e) => this.down(e));
    add("pointermove", (e) => this.move(e));
    add("pointerup", (e) => this.up(e));
    add("pointercancel", (e) => this.up(e));
    add("wheel", (e) => this.wheel(e));
    add("dblclick", (e) => {
      if (e.timeStamp - this.#tap.time > DOUBLE_TAP.wait) this.#doubleClick(e); // a tap's own came already
    });
    add("keydown", (e) => this.key(e));
  }

  get isBusy() {
    return this.points.size > 0;
  }

  /** The box of the picture, of two side by side the one at x. */
  box(x = 0): ScreenBox {
    const whole = this.view.elements.canvas.getBoundingClientRect(),
      { parts } = this.view.camera,
      width = whole.width / parts;
    const part = Math.max(0, Math.min(parts - 1, Math.floor((x - whole.left) / width)));
    return { left: whole.left + part * width, top: whole.top, width, height: whole.height };
  }

  close() {
    this.closed.abort();
  }

  down(event: PointerEvent) {
    if (event.button > 1 || this.view.spacePoints.press(event)) return; // the right button is the browser's
    this.view.elements.canvas.setPointerCapture(event.pointerId);
    this.view.elements.canvas.focus({ preventScroll: true });
    this.points.set(event.pointerId, [event.clientX, event.clientY]);
    this.moving = false;
  }

  move(event: PointerEvent) {
    const before = this.points.get(event.pointerId);
    if (!before) return;
    const now: Vector2 = [event.clientX, event.clientY];
    const dx = now[0] - before[0],
      dy = now[1] - before[1];
    const { camera } = this.view,
      box = this.box(),
      small = Math.min(box.width, box.height);
    if (this.points.size === 2) this.pinch(event.pointerId, before, now, box);
    else if (event.shiftKey || event.buttons === 4) this.pan(dx, dy, box);
    else if (event.altKey) camera.roll((-dx / small) * TURN);
    else camera.turn((dx / small) * TURN, (dy / small) * TURN);
    this.points.set(event.pointerId, now);
    this.moving = true;
    this.view.touch(true);
  }

  pan(dx: number, dy: number, box: ScreenBox) {
    const { camera } = this.view,
      length = camera.height / box.height;
    camera.pan = [camera.pan[0] - dx * length, camera.pan[1] + dy * length];
    camera.keepBoxInView();
  }

  pinch(id: number, before: Vector2, now: Vector2, box: ScreenBox) {
    const other = [...this.points].find(([key]) => key !== id)![1];
    const distance = (p: Vector2) => Math.max(8, Math.hypot(p[0] - other[0], p[1] - other[1]));
    this.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2, box);
    this.zoom(distance(now) / distance(before));
  }

  up(event: PointerEvent) {
    if (!this.points.delete(event.pointerId) || this.points.size) return;
    this.view.release();
    if (this.moving) this.view.writeCamera();
    else if (event.type === "pointerup") {
      this.view.elements.flicker.press(false);
      if (event.pointerType === "touch") this.#tapAt(event);
    }
  }

  /** Two taps at one place are a double click. */
  #tapAt(event: PointerEvent) {
    const at: Vector2 = [event.clientX, event.clientY],
      before = this.#tap;
    const isSecond =
      event.timeStamp - before.time < DOUBLE_TAP.wait &&
      Math.hypot(at[0] - before.at[0], at[1] - before.at[1]) < DOUBLE_TAP.away;
    this.#tap = { at, time: event.timeStamp };
    if (isSecond) this.#doubleClick(event);
  }

  /** A double click puts a point on the surface; it never moves the camera. */
  #doubleClick(event: MouseEvent) {
    this.view.spacePoints.doubleClick(event).catch((error) => this.view.fail(error));
  }

  /** Zoom by a factor, keeping the place under a pointer where it is. */
  zoom(factor: number, at: { clientX: number; clientY: number } | null = null) {
    const { camera } = this.view,
      { full } = camera;
    const height = Math.min(8 * full, Math.max(full / 60, camera.height / factor)),
      change = camera.height - height;
    if (at) {
      const { clientX: x, clientY: y } = at,
        box = this.box(x);
      camera.pan[0] += change * ((x - box.left - box.width / 2) / box.height);
      camera.pan[1] -= change * ((y - box.top - box.height / 2) / box.height);
    }
    camera.height = height;
    camera.keepBoxInView();
  }

  wheel(event: WheelEvent) {
    if (this.view.spacePoints.wheel(event)) return;
    if (!event.ctrlKey && !event.metaKey && !isInUse(this.view.elements.canvas)) return;
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1);
    this.zoom(Math.exp(-Math.max(-300, Math.min(300, pixels)) * 0.0016), event);
    this.view.touch();
    this.later();
  }

  /** Send one message to Python when the wheel or a key rests, not one for each notch. */
  later() {
    clearTimeout(this.rest);
    this.rest = setTimeout(() => {
      if (!this.view.closed) this.view.writeCamera();
    }, 300);
  }

  key(event: KeyboardEvent) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { camera } = this.view,
      step = event.shiftKey ? 3 * KEY_TURN : KEY_TURN;
    const turns: Record<string, Vector2> = {
      ArrowLeft: [-step, 0],
      ArrowRight: [step, 0],
      ArrowUp: [0, -step],
      ArrowDown: [0, step],
    };
    if (event.key === " " && !this.view.elements.flicker.press(true)) return;
    const turn = turns[event.key];
    if (turn) camera.turn(...turn);
    else if (event.key === "+" || event.key === "=") this.zoom(1.2);
    else if (event.key === "-") this.zoom(1 / 1.2);
    else if (event.key === "0") this.view.showView("home");
    else if (event.key !== " ") return;
    event.preventDefault(); // and not to the notebook, whose cells listen to the same keys
    event.stopPropagation();
    if (event.key === " ") return;
    this.view.touch();
    if (event.key !== "0") this.later();
  }
}
