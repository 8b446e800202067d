// The gestures of the editor in space that the editor of a picture lacks.

import { Gesture } from "../editor/gesture.ts";
import { scaled } from "../maths/camera.ts";
import type { Vector2 } from "../types.ts";
import type { SpacePane } from "./pane.ts";
import type { Line } from "./pane_marks.ts";
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
