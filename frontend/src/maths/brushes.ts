// Brushes that write ordinary control points.
//
// A brush is a circle of a radius with a smooth falloff. The tissue in it moves as in a flow that is strongest in the
// middle and at rest on the rim: such a flow never folds. Points represent it: the existing ones move with
// it, and where there are none the stroke places some, each holding the tissue there. Rings of still points around
// the brush keep the rest of the picture where it is: kernels reach far, and one ring alone would be overshot.

import type { PicturePoint, Vector2, Vector4 } from "../types.ts";
import { newPoint } from "./points.ts";

const BRUSH_STEP = 0.125; // of the radius: the longest piece of a stroke that is done in one edit
const BRUSH_LEG = 0.5; // of the radius: after that distance the rings are replaced around the brush
const BRUSH_CARRIES = 0.6,
  BRUSH_SLIPS = 0.5; // radii that the middle is carried; then it is left behind bit by bit
const BRUSH_TAKES = 0.4; // of the radius: a point nearer than this to the middle is used instead of a new one
const BRUSH_ROOM = 0.45; // of the radius: no new point nearer than this to an old one
const BRUSH_RINGS = [1.1, 1.7, 2.6]; // of still points, in radii
const BRUSH_RING = 8; // points of a ring
const BRUSH_INNER = 0.55; // of the radius: the ring that swells or shrinks
const BRUSH_MOST_SWELL = 0.8; // logarithm of the largest scale in the middle

const BRUSH_NAME = /^(move|grow|shrink|smudge|expand) \d+$/; // the last two: of earlier versions

function brushFalloff(t: number) {
  const s = 1 - t * t;
  return t < 1 ? s * s : 0;
}

/** The number of the next stroke, in the names of the points that it leaves. */
function nextStroke(points: PicturePoint[]) {
  const numbers = points.filter(({ name }) => BRUSH_NAME.test(name)).map(({ name }) => Number(name.split(" ")[1]));
  return Math.max(0, ...numbers) + 1;
}

function distanceTo(p: PicturePoint, [a, b]: Vector2) {
  return Math.hypot(p.target[0] - a, p.target[1] - b);
}

/** The distance to the nearest active point. */
function gapTo(points: PicturePoint[], place: Vector2) {
  return points.reduce((least, p) => (p.active ? Math.min(least, distanceTo(p, place)) : least), Infinity);
}

/** The picture as a stroke needs it. */
export interface StrokeSurroundings {
  /** A function of places that returns the source of the tissue visible there, null for none. */
  sourceAt: (points: PicturePoint[]) => (place: Vector2) => Vector2 | null;
  /** Of the picture. */
  box: Vector4;
  /** Of points, 0 for everywhere. */
  reach: number;
  /** Move a new place, such as to the axis of a mirror. */
  settle: (place: Vector2) => Vector2;
}

export class Stroke {
  middle: Vector2;
  tool: string;
  id: number;
  way = 0;
  done = 0;
  swell = 0;
  number: number;
  /** The id of the point in the middle */
  held: number | null = null;
  isBegun = false;
  lead = 0; // the side of a mirror that decides, for mirrorEdit
  lockedBy: PicturePoint | null;
  source: (place: Vector2) => Vector2 | null;

  constructor(
    public points: PicturePoint[],
    middle: Vector2,
    readonly radius: number,
    { tool, id }: { tool: string; id: number },
    private readonly around: StrokeSurroundings,
  ) {
    this.middle = [...middle];
    this.tool = tool;
    this.id = id;
    this.number = nextStroke(points);
    const taken = points
      .filter((p) => p.active && distanceTo(p, middle) < BRUSH_TAKES * radius)
      .sort((p, q) => distanceTo(p, middle) - distanceTo(q, middle))
      .at(0);
    this.lockedBy = taken?.locked ? taken : null;
    this.source = () => null;
    if (this.lockedBy) return;
    this.source = around.sourceAt(points);
    this.held = taken ? taken.id : this.#add(middle, 0);
    this.isBegun = this.held !== null;
    if (tool === "grow") this.#ring(BRUSH_INNER, BRUSH_TAKES);
    this.#surround(true);
  }

  get name() {
    return `${this.tool === "move" ? "move" : this.swell < 0 ? "shrink" : "grow"} ${this.number}`;
  }

  get isPossible() {
    return this.lockedBy === null && this.isBegun;
  }

  /** Add a point that holds the tissue visible at a place; its id, or null where it is not needed. */
  #add(there: Vector2, room: number) {
    const place = this.around.settle(there),
      [a0, a1, b0, b1] = this.around.box;
    const isInside = place[0] >= a0 && place[0] <= a1 && place[1] >= b0 && place[1] <= b1;
    if (!isInside || gapTo(this.points, place) < room * this.radius) return null;
    const source = this.source(place);
    if (source === null) return null;
    this.points = [...this.points, newPoint(this.id, source, place, this.name)];
    this.id += 1;
    return this.id - 1;
  }

  #ring(share: number, room: number, turn: number = 0) {
    for (let k = 0; k < BRUSH_RING; k++) {
      const angle = turn + (2 * Math.PI * (k + 0.5)) / BRUSH_RING,
        r = share * this.radius;
      this.#add([this.middle[0] + r * Math.cos(angle), this.middle[1] + r * Math.sin(angle)], room);
    }
  }

  /** Add still points around the brush, and once for a stroke at the rim of the picture. */
  #surround(isFirst: boolean) {
    BRUSH_RINGS.forEach((share, k) => {
      if (this.around.reach > 0 && share >= 2 && this.around.reach <= share * this.radius) return;
      this.#ring(share, Math.max(BRUSH_ROOM, 0.4 * share), (k * Math.PI) / BRUSH_RING);
    });
    if (!isFirst || (this.around.reach > 0 && this.around.reach < 4 * this.radius)) return;
    const [a0, a1, b0, b1] = this.around.box,
      room = Math.hypot(a1 - a0, b1 - b0) / 6 / this.radius;
    for (const u of [0, 0.5, 1])
      for (const v of [0, 0.5, 1]) {
        if (u !== 0.5 || v !== 0.5) this.#add([a0 + u * (a1 - a0), b0 + v * (b1 - b0)], Math.max(1, room));
      }
  }

  // ---- the flow -----------------------------------------------------------------------------------------------------

  #flow(by: (p: PicturePoint, x: number, y: number, share: number) => Vector2) {
    this.points = this.points.map((p) => {
      if (!p.active || p.locked) return p;
      const x = p.target[0] - this.middle[0],
        y = p.target[1] - this.middle[1],
        t = Math.hypot(x, y) / this.radius;
      return t < 1 || p.id === this.held ? { ...p, target: by(p, x, y, p.id === this.held ? 1 : brushFalloff(t)) } : p;
    });
  }

  /**
   * Move the brush to a place, with the tissue in it. Tissue that is carried on and on would pile up ahead and fold:
   * after a while the brush moves faster than its tissue, which stays behind.
   */
  move(place: Vector2) {
    const way: Vector2 = [place[0] - this.middle[0], place[1] - this.middle[1]],
      length = Math.hypot(...way);
    const count = Math.ceil(length / (BRUSH_STEP * this.radius) - 1e-9);
    for (let k = 0; k < count; k++) {
      const da = way[0] / count,
        db = way[1] / count;
      const hold = Math.max(BRUSH_SLIPS, Math.min(1, 1 - (this.done / this.radius - BRUSH_CARRIES)));
      if (hold < 1) this.held = null;
      this.#flow((p, _x, _y, share) => [p.target[0] + hold * share * da, p.target[1] + hold * share * db]);
      this.middle = [this.middle[0] + da, this.middle[1] + db];
      this.way += length / count;
      this.done += length / count;
      if (this.way < BRUSH_LEG * this.radius) continue;
      this.way = 0;
      this.source = this.around.sourceAt(this.points);
      this.#surround(false);
    }
  }

  /** Grow the tissue in the brush (by a positive logarithm of its scale) or shrink it. */
  grow(swell: number) {
    const wanted = Math.max(-BRUSH_MOST_SWELL, Math.min(BRUSH_MOST_SWELL, swell)),
      by = wanted - this.swell;
    const count = Math.ceil(Math.abs(by) / BRUSH_STEP - 1e-9),
      was = this.name;
    for (let k = 0; k < count; k++) {
      this.#flow((p, x, y, share) => {
        const factor = p.id === this.held ? 1 : Math.exp((share * by) / count);
        return [this.middle[0] + factor * x, this.middle[1] + factor * y];
      });
    }
    this.swell = wanted;
    if (this.name !== was) this.points = this.points.map((p) => (p.name === was ? { ...p, name: this.name } : p));
  }
}
