// The gestures of the editor of a picture of its tools, each with its tool.

import type { Vector, Vector2 } from "../types.ts";
import { Gesture } from "./gesture.ts";
import type { ShapeGrip } from "./hit_test.ts";
import type { PointMirror } from "./mirror.ts";
import type { PartHandle } from "./motion_handles.ts";
import type { PartMoves } from "./part_moves.ts";
import type { Pen, ShapeTools } from "./shape_tools.ts";
import type { Viewport } from "./viewport.ts";
import type { WindowTool } from "./window_tool.ts";

/** Two fingers that move and zoom the view. */
export class PinchGesture extends Gesture {
  #was: { x: number; y: number; gap: number };

  /** @param pointers places of those that are down */
  constructor(
    private readonly pointers: Map<number, Vector2>,
    private readonly viewport: Viewport,
  ) {
    super([0, 0], false);
    this.#was = this.#fingers();
  }

  #fingers() {
    const [[ax, ay], [bx, by]] = [...this.pointers.values()] as [Vector2, Vector2];
    return { x: (ax + bx) / 2, y: (ay + by) / 2, gap: Math.max(10, Math.hypot(ax - bx, ay - by)) };
  }

  drag() {
    if (this.pointers.size < 2) return;
    const was = this.#was,
      { x, y, gap } = this.#fingers();
    this.viewport.panBy(x - was.x, y - was.y);
    this.viewport.zoomAt(gap / was.gap, x, y);
    this.#was = { x, y, gap };
  }

  end() {}
}

/** A drag that changes the window of the grey values; its click is given, null for nothing. */
export class WindowGesture extends Gesture {
  constructor(
    from: Vector2,
    private readonly window: Pick<WindowTool, "begin" | "drag" | "end">,
    private readonly click: (() => void) | null,
  ) {
    super(from);
  }

  drag(_at: Vector2, by: Vector2) {
    if (this.isPress) this.window.begin();
    this.window.drag(by);
  }

  end(isCancelled: boolean) {
    if (!this.isPress || isCancelled) this.window.end(isCancelled);
    else this.click?.();
  }
}

/** A stroke of the pen, or a place that it sets. */
export class PenGesture extends Gesture {
  constructor(
    from: Vector2,
    private readonly pen: Pick<Pen, "drag" | "up">,
  ) {
    super(from);
  }

  drag(at: Vector2) {
    this.pen.drag(at);
  }

  end(isCancelled: boolean, at: Vector2) {
    if (!isCancelled) this.pen.up(this.from, at);
  }
}

interface Stroking {
  press(at: Vector2): void;
  drag(at: Vector2): void;
  lift(isCancelled: boolean): void;
  hover(at: Vector2 | null): void;
}

export class BrushGesture extends Gesture {
  constructor(
    from: Vector2,
    private readonly brush: Stroking,
    private readonly isFinger: boolean,
  ) {
    super(from, false);
    brush.press(from);
  }

  drag(at: Vector2) {
    this.brush.drag(at);
  }

  end(isCancelled: boolean) {
    this.brush.lift(isCancelled);
    if (this.isFinger) this.brush.hover(null); // one that has left has no place
  }
}

/** A drag of the axis of the mirror. */
export class AxisGesture extends Gesture {
  #start: { axis: string; at: number };

  constructor(
    from: Vector2,
    private readonly mirror: PointMirror,
    private readonly viewport: Viewport,
  ) {
    super(from);
    this.#start = mirror.state;
  }

  override get isHolding() {
    return true;
  }

  drag(_at: Vector2, [x, y]: Vector2) {
    const { axis, at } = this.#start;
    this.mirror.moveAxis(at + (axis === "a" ? x : y) / this.viewport.view.k, false);
  }

  end(isCancelled: boolean) {
    this.mirror.moveAxis((isCancelled ? this.#start : this.mirror.state).at, true);
  }
}

/** A drag of a shape, a corner or the middle of an edge. */
export class ShapeGesture extends Gesture {
  constructor(
    from: Vector2,
    private readonly shapes: ShapeTools,
    private readonly grip: ShapeGrip,
  ) {
    super(from);
  }

  drag(_at: Vector2, [x, y]: Vector2) {
    if (this.isPress) this.shapes.beginDrag(this.grip);
    this.shapes.drag(x, y);
  }

  end(isCancelled: boolean) {
    if (!this.isPress) this.shapes.endDrag(isCancelled);
  }
}

/** A drag of the motion of a rigid part. */
export class PartGesture extends Gesture {
  constructor(
    from: Vector2,
    private readonly parts: Pick<PartMoves<never, Vector>, "beginDrag" | "drag" | "endDrag">,
    private readonly handle: PartHandle,
  ) {
    super(from);
  }

  override get isHolding() {
    return true;
  }

  drag(at: Vector2, _by: Vector2, { shiftKey }: PointerEvent) {
    if (this.isPress) this.parts.beginDrag(this.handle, this.from);
    this.parts.drag(at, shiftKey);
  }

  end(isCancelled: boolean) {
    this.parts.endDrag(isCancelled);
  }
}
