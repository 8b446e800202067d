// Brushes that write ordinary control points.
//
// A brush is a circle of a radius with a smooth falloff, and in space a ball. The tissue in it moves as in a flow that is
// strongest in the middle and at rest on the rim: such a flow never folds. Points represent it: the existing ones move
// with it, and where there are none the stroke places some, each holding the tissue there. Rings of still points around
// the brush keep the rest of the picture where it is: kernels reach far, and one ring alone would be overshot.

import type { PaneInfo, Point, Vector, Vector2, Vector3, Vector4 } from "../types.ts";
import { mapVector } from "./camera.ts";
import { distance, newPoint } from "./points.ts";
import { RbfError } from "./rbf.ts";
import { fromPane, toPane } from "./space.ts";

const BRUSH_STEP = 0.125; // of the radius: the longest piece of a stroke that is done in one edit
const BRUSH_LEG = 0.5; // of the radius: after that distance the rings are replaced around the brush
const BRUSH_CARRIES = 0.6,
  BRUSH_SLIPS = 0.5; // radii that the middle is carried; then it is left behind bit by bit
const BRUSH_TAKES = 0.4; // of the radius: a point nearer than this to the middle is used instead of a new one
const BRUSH_ROOM = 0.45; // of the radius: no new point nearer than this to an old one
const BRUSH_RINGS = [1.1, 1.7, 2.6]; // of still points, in radii
const BRUSH_RING = 8, // points of a ring
  BRUSH_SPHERE = 20; // and of a sphere in space, about as far apart
const BRUSH_INNER = 0.55; // of the radius: the ring that swells or shrinks
const AT_ONCE = 5; // of so many points one more is added before a stroke is fitted again
const BRUSH_MOST_SWELL = 0.8; // logarithm of the largest scale in the middle
const GOLDEN = Math.PI * (3 - Math.sqrt(5)); // the angle between the points of a spiral around a sphere

const BRUSH_NAME = /^(move|grow|shrink|smudge|expand) \d+$/; // the last two: of earlier versions

function brushFalloff(t: number) {
  const s = 1 - t * t;
  return t < 1 ? s * s : 0;
}

/** The number of the next stroke, in the names of the points that it leaves. */
function nextStroke(points: Point[]) {
  const numbers = points.filter(({ name }) => BRUSH_NAME.test(name)).map(({ name }) => Number(name.split(" ")[1]));
  return Math.max(0, ...numbers) + 1;
}

/** The distance to the nearest active point. */
function gapTo(points: Point[], place: Vector) {
  return points.reduce((least, p) => (p.active ? Math.min(least, distance(p.target, place)) : least), Infinity);
}

/** The picture, or the volume, as a stroke needs it. */
export interface StrokeSurroundings<V extends Vector> {
  /** A function of places that returns the source of the tissue visible there, null for none. */
  sourceAt: (points: Point<V>[]) => (place: V) => V | null;
  frame: StrokeFrame<V>;
  /** Of points, 0 for everywhere. */
  reach: number;
  /** Move a new place, such as to the axis of a mirror. */
  settle: (place: V) => V;
}

/** Where points may be put. */
export interface StrokeFrame<V extends Vector> {
  isInside: (place: V) => boolean;
  /** Places at the rim. */
  rim: V[];
  diagonal: number;
  /** Unit vectors to the points of a ring, numbered from the brush outwards; -1 within it. */
  ring: (index: number) => V[];
}

/** The frame of strokes on a picture, [a0, a1, b0, b1]. */
export function pictureFrame([a0, a1, b0, b1]: Vector4): StrokeFrame<Vector2> {
  const shares = [0, 0.5, 1];
  return {
    isInside: ([a, b]) => a >= a0 && a <= a1 && b >= b0 && b <= b1,
    rim: shares.flatMap((u) =>
      shares.filter((v) => u !== 0.5 || v !== 0.5).map((v): Vector2 => [a0 + u * (a1 - a0), b0 + v * (b1 - b0)]),
    ),
    diagonal: Math.hypot(a1 - a0, b1 - b0),
    ring: (index) =>
      Array.from({ length: BRUSH_RING }, (_, k) => {
        const angle = (2 * Math.PI * (k + (index === 1 ? 1 : 0.5))) / BRUSH_RING;
        return [Math.cos(angle), Math.sin(angle)];
      }),
  };
}

/** The frame of strokes in a volume, whose box a picture of it has. */
export function volumeFrame(pane: PaneInfo): StrokeFrame<Vector3> {
  const [a0, a1, b0, b1, c0, c1] = pane.box,
    shares = [0, 0.5, 1],
    place = (u: number, v: number, w: number) =>
      fromPane(pane, [a0 + u * (a1 - a0), b0 + v * (b1 - b0), c0 + w * (c1 - c0)]);
  const all = shares.flatMap((u) => shares.flatMap((v) => shares.map((w): Vector3 => [u, v, w])));
  return {
    isInside: (at) => {
      const [a, b, c] = toPane(pane, at);
      return a >= a0 && a <= a1 && b >= b0 && b <= b1 && c >= c0 && c <= c1;
    },
    rim: all.filter((at) => at.filter((share) => share === 0.5).length % 2 === 0).map((at) => place(...at)), // no edges
    diagonal: Math.hypot(a1 - a0, b1 - b0, c1 - c0),
    ring: (index) =>
      Array.from({ length: BRUSH_SPHERE }, (_, k) => {
        const z = 1 - (2 * (k + 0.5)) / BRUSH_SPHERE,
          angle = GOLDEN * k + index,
          r = Math.sqrt(1 - z * z);
        return [r * Math.cos(angle), r * Math.sin(angle), z];
      }),
  };
}

export class Stroke<V extends Vector> {
  middle: V;
  tool: string;
  id: number;
  way = 0;
  done = 0;
  swell = 0;
  number: number;
  /** The id of the point in the middle */
  held: number | null = null;
  isBegun = false;
  lockedBy: Point<V> | null;
  source: (place: V) => V | null;
  #first: number; // id of its first point

  constructor(
    public points: Point<V>[],
    middle: V,
    readonly radius: number,
    { tool, id }: { tool: string; id: number },
    private readonly around: StrokeSurroundings<V>,
  ) {
    this.middle = middle;
    this.tool = tool;
    this.id = this.#first = id;
    this.number = nextStroke(points);
    const taken = points
      .filter((p) => p.active && distance(p.target, middle) < BRUSH_TAKES * radius)
      .sort((p, q) => distance(p.target, middle) - distance(q.target, middle))
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
  #add(there: V, room: number) {
    const place = this.around.settle(there);
    if (!this.around.frame.isInside(place) || gapTo(this.points, place) < room * this.radius) return null;
    const source = this.source(place);
    if (source === null) return null;
    this.points = [...this.points, newPoint(this.id, source, place, this.name)];
    this.id += 1;
    return this.id - 1;
  }

  #ring(share: number, room: number, index = -1) {
    for (const direction of this.around.frame.ring(index))
      this.#add(sum(this.middle, direction, share * this.radius), room);
  }

  /** Add still points around the brush, and once for a stroke at the rim of the picture. */
  #surround(isFirst: boolean) {
    const { reach, frame } = this.around;
    BRUSH_RINGS.forEach((share, k) => {
      if (reach > 0 && share >= 2 && reach <= share * this.radius) return;
      this.#ring(share, Math.max(BRUSH_ROOM, 0.4 * share), k);
    });
    if (!isFirst || (reach > 0 && reach < 4 * this.radius)) return;
    const room = frame.diagonal / 6 / this.radius;
    for (const place of frame.rim) this.#add(place, Math.max(1, room));
  }

  // ---- the flow -----------------------------------------------------------------------------------------------------

  #flow(by: (p: Point<V>, from: V, share: number) => V) {
    this.points = this.points.map((p) => {
      if (!p.active || p.locked) return p;
      const from = sum(p.target, this.middle, -1),
        t = Math.hypot(...from) / this.radius;
      return t < 1 || p.id === this.held ? { ...p, target: by(p, from, p.id === this.held ? 1 : brushFalloff(t)) } : p;
    });
  }

  /**
   * Move the brush to a place, with the tissue in it. Tissue that is carried on and on would pile up ahead and fold:
   * after a while the brush moves faster than its tissue, which stays behind.
   */
  move(place: V) {
    const way = sum(place, this.middle, -1),
      length = Math.hypot(...way);
    const count = Math.ceil(length / (BRUSH_STEP * this.radius) - 1e-9);
    for (let k = 0; k < count; k++) {
      const hold = Math.max(BRUSH_SLIPS, Math.min(1, 1 - (this.done / this.radius - BRUSH_CARRIES)));
      if (hold < 1) this.held = null;
      this.#flow((p, _from, share) => sum(p.target, way, (hold * share) / count));
      this.middle = sum(this.middle, way, 1 / count);
      this.way += length / count;
      this.done += length / count;
      if (this.way < BRUSH_LEG * this.radius) continue;
      this.way = 0;
      this.source = this.around.sourceAt(this.points);
      this.#surround(false);
    }
  }

  /**
   * Leave out the points of this stroke without which no tissue moves by more than a tolerance. Those that stay are
   * added a few at a time, where the map of those before is farthest from that of all.
   * @param complete the points that are fitted, of some points of the stroke: with their mirror images
   */
  thin(tolerance: number, complete: (points: Point<V>[]) => Point<V>[]) {
    const whole = this.around.sourceAt(complete(this.points));
    let rest = this.points
        .filter(({ id }) => id >= this.#first)
        .map((point) => ({ point, wanted: whole(point.target) })),
      kept = this.points.filter(({ id }) => id < this.#first);
    while (rest.length) {
      const now = this.#mapOf(complete(kept));
      const away = ({ point, wanted }: (typeof rest)[number]) => {
        const found = now(point.target);
        return wanted && found ? distance(wanted, found) : 0;
      };
      const next = rest
        .map((one) => ({ one, far: away(one) }))
        .filter(({ far }) => far > tolerance)
        .sort((p, q) => q.far - p.far)
        .slice(0, Math.max(1, Math.floor(kept.length / AT_ONCE)))
        .map(({ one }) => one);
      if (!next.length) break;
      rest = rest.filter((one) => !next.includes(one));
      kept = [...kept, ...next.map(({ point }) => point)];
    }
    const left = new Set(rest.map(({ point }) => point));
    this.points = this.points.filter((p) => !left.has(p));
  }

  /** The sources of some points; places themselves where so few cannot be fitted. */
  #mapOf(points: Point<V>[]) {
    try {
      return this.around.sourceAt(points);
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      return (place: V) => place;
    }
  }

  /** Grow the tissue in the brush (by a positive logarithm of its scale) or shrink it. */
  grow(swell: number) {
    const wanted = Math.max(-BRUSH_MOST_SWELL, Math.min(BRUSH_MOST_SWELL, swell)),
      by = wanted - this.swell;
    const count = Math.ceil(Math.abs(by) / BRUSH_STEP - 1e-9),
      was = this.name;
    for (let k = 0; k < count; k++) {
      this.#flow((p, from, share) => sum(this.middle, from, p.id === this.held ? 1 : Math.exp((share * by) / count)));
    }
    this.swell = wanted;
    if (this.name !== was) this.points = this.points.map((p) => (p.name === was ? { ...p, name: this.name } : p));
  }
}

/** A place and a share of a vector. */
function sum<V extends Vector>(place: V, vector: V, share: number): V {
  return mapVector(place, (value, k) => value + share * vector[k]!);
}
