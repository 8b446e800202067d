// The gestures of the editor in space that the editor of a picture lacks.

import { Gesture } from "../editor/gesture.ts";
import { dragWindow } from "../editor/window_tool.ts";
import { scaled } from "../maths/camera.ts";
import type { Vector2 } from "../types.ts";
import type { SpacePane } from "./pane.ts";
import type { Line } from "./pane_marks.ts";
import type { PartPen } from "./part_pen.ts";
import type { SpacePointTools } from "./point_tools.ts";

/** A drag of the plane of the mirror. */
export class MirrorGesture extends Gesture {
  #start: number;

  constructor(
    from: Vector2,
    private readonly pane: SpacePane,
    private readonly tools: SpacePointTools,
  ) {
    super(from);
    this.#start = tools.mirror.at;
  }

  drag(at: Vector2) {
    this.tools.moveMirror(this.pane.under(at), false);
  }

  end(isCancelled: boolean) {
    const { at, normal } = this.tools.mirror;
    this.tools.moveMirror(scaled(normal, isCancelled ? this.#start : at), true);
  }
}

/** A drag of the pen for rigid parts. */
export class DraftGesture extends Gesture {
  /** @param what a side of the drawing, "inside", or null for a new one */
  constructor(
    from: Vector2,
    private readonly pane: SpacePane,
    private readonly pen: PartPen,
    private readonly what: string | null,
  ) {
    super(from);
  }

  drag(at: Vector2) {
    if (this.isPress) this.pen.begin();
    this.pen.drag(this.pane, this.what, this.from, at);
  }

  end(isCancelled: boolean) {
    if (isCancelled && !this.isPress) this.pen.cancel();
  }
}

/** A drag that changes the window: to the right it gets wider, upwards its level rises. */
export class SliceWindowGesture extends Gesture {
  /** @param change called with the window, and whether it still moves */
  constructor(
    from: Vector2,
    private readonly start: Vector2,
    private readonly change: (window: Vector2, isMoving: boolean) => void,
    private readonly click: () => void,
  ) {
    super(from);
  }

  #windowAt(by: Vector2) {
    const [low, high] = this.start,
      width = high - low;
    return dragWindow(this.start, by, [low - 2 * width, high + 2 * width]);
  }

  drag(_at: Vector2, by: Vector2) {
    this.change(this.#windowAt(by), true);
  }

  end(isCancelled: boolean, at: Vector2) {
    if (isCancelled) this.change(this.start, false);
    else if (this.isPress) this.click();
    else this.change(this.#windowAt([at[0] - this.from[0], at[1] - this.from[1]]), false);
  }
}

/** A drag of the cross-hair, or of one of its lines; a click brings it there. */
export class CrossGesture extends Gesture {
  /** @param release called at the end, with whether it was a click */
  constructor(
    from: Vector2,
    private readonly pane: SpacePane,
    private readonly line: Line | null,
    private readonly release: (isClick: boolean) => void,
  ) {
    super(from);
  }

  drag(at: Vector2) {
    this.pane.moveCross(at, this.line, true);
  }

  end(isCancelled: boolean) {
    if (isCancelled) return;
    if (this.isPress && !this.line) this.pane.moveCross(this.from, null, false);
    this.release(this.isPress);
  }
}
