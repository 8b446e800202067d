// A press or a drag of a pointer; each kind of gesture is a class. Those of both editors are here.

import { turnOfDrag } from "../maths/points.ts";
import type { Vector, Vector2 } from "../types.ts";
import type { EditedPoints } from "./edited_points.ts";
import type { Viewport } from "./viewport.ts";

/** The places of points that a drag moves. */
export type Moved = "target" | "source" | "both";

/** A rectangle of the view, in CSS pixels. */
export type Band = { x: number; y: number; width: number; height: number };

/** A gesture under way; places are in CSS pixels of the view. */
export abstract class Gesture {
  /** Whether the page must not scroll while a finger makes it. */
  readonly keepsPage: boolean = true;

  from: Vector2;

  /** The last place of the pointer. */
  at: Vector2;

  /** Whether the pointer has not moved yet. */
  isPress: boolean;

  constructor(from: Vector2, isPress = true) {
    this.from = this.at = from;
    this.isPress = isPress;
  }

  /** Whether a second finger changes nothing. */
  get isHolding() {
    return false;
  }

  /** Follow the pointer, once a press has moved by `slack`. */
  move(at: Vector2, slack: number, event: PointerEvent) {
    const by: Vector2 = [at[0] - this.from[0], at[1] - this.from[1]];
    if (this.isPress && Math.hypot(...by) < slack) return;
    this.drag(at, by, event);
    this.isPress = false;
    this.at = at;
  }

  /** @param by since the press */
  abstract drag(at: Vector2, by: Vector2, event: PointerEvent): void;

  /** The pointer was released at a place; a cancelled gesture changes nothing. */
  abstract end(isCancelled: boolean, at: Vector2): void;
}

/** A gesture that is a click where the pointer does not move. */
abstract class ClickGesture extends Gesture {
  constructor(
    from: Vector2,
    private readonly click: (() => void) | null,
  ) {
    super(from, click !== null);
  }

  end(isCancelled: boolean) {
    if (this.isPress && !isCancelled) this.click?.();
    else this.release(isCancelled);
  }

  /** The end of a drag. */
  release(_isCancelled: boolean) {}
}

/**
 * Keep a page from scrolling under a finger that drags something. The first movement decides, not the press: a tap stays
 * a click. The property touch-action of a part of an SVG does not do it.
 */
export function keepPage(event: TouchEvent, gesture: Gesture | null) {
  if (event.cancelable && gesture?.keepsPage) event.preventDefault();
}

/** A drag that moves the view. */
export class PanGesture extends ClickGesture {
  override readonly keepsPage = false; // where the stage lets the page scroll

  constructor(
    from: Vector2,
    private readonly viewport: Viewport,
    click: (() => void) | null = null,
  ) {
    super(from, click);
  }

  drag(at: Vector2) {
    this.viewport.panBy(at[0] - this.at[0], at[1] - this.at[1]);
  }
}

/** A finger while the editor has no focus: its drag belongs to the host page, which may scroll. */
export class TapGesture extends ClickGesture {
  override readonly keepsPage = false;

  constructor(
    from: Vector2,
    private readonly advise: () => void,
    click: () => void,
  ) {
    super(from, click);
  }

  drag() {}

  override release(isCancelled: boolean) {
    if (!isCancelled) this.advise();
  }
}

/** A rectangle that selects the points in it. */
export class BandGesture extends ClickGesture {
  #show: (band: Band | null) => void;
  #inside: (band: Band) => number[];
  #before: number[];
  #was: number[];
  #end: (() => void) | undefined;

  /** @param adds whether the selection before stays */
  constructor(
    from: Vector2,
    private readonly points: EditedPoints<Vector>,
    adds: boolean,
    act: { show: (band: Band | null) => void; inside: (band: Band) => number[]; click?: () => void; end?: () => void },
  ) {
    super(from, act.click ?? (() => {}));
    this.#show = act.show;
    this.#inside = act.inside;
    this.#end = act.end;
    this.#was = [...points.selected];
    this.#before = adds ? this.#was : [];
  }

  drag([x, y]: Vector2) {
    const [x0, y0] = this.from;
    const band = { x: Math.min(x0, x), y: Math.min(y0, y), width: Math.abs(x - x0), height: Math.abs(y - y0) };
    this.#show(band);
    this.points.select([...this.#before, ...this.#inside(band)]);
  }

  override release(isCancelled: boolean) {
    this.#show(null);
    if (isCancelled) this.points.select(this.#was);
    else this.#end?.();
  }
}

/** A tool that drags points: `by` in CSS pixels since the press, `isLoose` where they need not snap to the grid. */
export interface PointDragger {
  beginDrag(): void;
  drag(ids: number[], by: Vector2, what: Moved, id: number, isLoose: boolean): void;
  endDrag(isCancelled: boolean): void;
}

/** A point under the pointer; `isNew` where the press has added it. */
export type GrabbedPoint = { id: number; what: "target" | "source"; isNew?: boolean };

/** A drag of a point and of those that are selected with it; its click selects. */
export class PointsGesture extends Gesture {
  #adds: boolean;
  #was: boolean;
  #what: Moved;

  /** @param isSelecting whether each click adds to the selection */
  constructor(
    event: PointerEvent,
    from: Vector2,
    private readonly grabbed: GrabbedPoint,
    private readonly points: EditedPoints<Vector>,
    isSelecting: boolean,
    private readonly dragger: PointDragger,
  ) {
    super(from);
    const { id, what } = grabbed;
    this.#adds = isSelecting || event.shiftKey || event.ctrlKey || event.metaKey;
    this.#was = points.selected.has(id);
    this.#what = event.altKey ? "both" : what;
    if (!this.#was) points.select(this.#adds ? [...points.selected, id] : [id]);
  }

  override get isHolding() {
    return true;
  }

  drag(_at: Vector2, by: Vector2, { altKey }: PointerEvent) {
    const { id } = this.grabbed;
    if (this.isPress) this.dragger.beginDrag();
    this.dragger.drag(this.points.idsAt(id), by, this.#what, id, altKey);
  }

  end(isCancelled: boolean) {
    const { id, isNew } = this.grabbed;
    if (!this.isPress) this.dragger.endDrag(isCancelled);
    else if (this.#was && !isNew && !isCancelled) {
      this.points.select(this.#adds ? [...this.points.selected].filter((other) => other !== id) : [id]);
    }
  }
}

/** A drag of the handle that rotates points about a place of the view; Alt scales instead, Shift snaps to steps. */
export class TurnGesture extends Gesture {
  #scales = false;

  constructor(
    from: Vector2,
    private readonly about: Vector2,
    private readonly turn: (angle: number, factor: number) => void,
    private readonly endDrag: (isCancelled: boolean, kind: "turn" | "scale") => void,
  ) {
    super(from);
  }

  override get isHolding() {
    return true;
  }

  drag([x, y]: Vector2, _by: Vector2, event: PointerEvent) {
    const [a, b] = this.about,
      [x0, y0] = this.from;
    this.#scales = event.altKey;
    this.turn(...turnOfDrag([x0 - a, y0 - b], [x - a, y - b], event));
  }

  end(isCancelled: boolean) {
    this.endDrag(isCancelled || this.isPress, this.#scales ? "scale" : "turn");
  }
}
