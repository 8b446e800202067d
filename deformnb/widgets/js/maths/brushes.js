// Brushes that write ordinary control points. Pure functions of plain lists, no DOM; needs maths/points.js.
//
// A brush is a circle of a radius with a smooth falloff. What lies in it moves as in a flow that is strongest in the
// middle and at rest on the rim: such a flow never folds. Points stand for it: the ones that are there already move with
// it, and where there are none the stroke places some, each holding what is seen there. Rings of still points around the
// brush keep the rest of the picture where it is: kernels reach far, and one ring alone would be overshot.

import { newPoint } from "./points.js";

const BRUSH_STEP = 0.125; // of the radius: the longest piece of a stroke that is done at once
const BRUSH_LEG = 0.5; // of the radius: after that way the rings are set anew around the brush
const BRUSH_CARRIES = 0.6, BRUSH_SLIPS = 0.5; // what lies in the middle is carried so many radii, then left behind bit by bit
const BRUSH_TAKES = 0.4; // of the radius: a point nearer than this to the middle is taken instead of a new one
const BRUSH_ROOM = 0.45; // of the radius: no new point nearer than this to another
const BRUSH_RINGS = [1.1, 1.7, 2.6]; // of still points, in radii
const BRUSH_RING = 8; // points of a ring
const BRUSH_INNER = 0.55; // of the radius: the ring that swells or shrinks
const BRUSH_MOST_SWELL = 0.8; // logarithm of the largest scale in the middle

const BRUSH_NAME = /^(smudge|expand|shrink) \d+$/;

function brushFalloff(t) {
  const s = 1 - t * t;
  return t < 1 ? s * s : 0;
}

// The number of the next stroke: that of the points it leaves.
function nextStroke(points) {
  return points.reduce((most, { name }) => (BRUSH_NAME.test(name) ? Math.max(most, Number(name.split(" ")[1])) : most), 0) + 1;
}

function gapTo(points, [a, b]) {
  return points.reduce((least, p) => (p.active ? Math.min(least, Math.hypot(p.target[0] - a, p.target[1] - b)) : least), Infinity);
}

export class Stroke {
  // sourceAt(points) makes a function of places, which says what is seen there (null: nothing). `box` is the picture's,
  // `reach` how far points reach (0: everywhere), `settle(place)` moves a new place, as to the axis of a mirror.
  constructor(points, middle, radius, { tool, id, sourceAt, box, reach = 0, settle = (place) => place }) {
    Object.assign(this, { points, middle: [...middle], radius, tool, id, sourceAt, box, reach, settle, way: 0, done: 0, swell: 0,
      number: nextStroke(points), held: null });
    const near = points.filter((p) => p.active).map((p) => [Math.hypot(p.target[0] - middle[0], p.target[1] - middle[1]), p])
      .sort((p, q) => p[0] - q[0])[0];
    const taken = near && near[0] < BRUSH_TAKES * radius ? near[1] : null;
    this.lockedBy = taken?.locked ? taken : null;
    if (this.lockedBy) return;
    this.source = sourceAt(points);
    this.held = taken ? taken.id : this.#add(middle, 0);
    this.isBegun = this.held !== null;
    if (tool === "size") this.#ring(BRUSH_INNER, BRUSH_TAKES);
    this.#surround(true);
  }

  get name() { return `${this.tool === "smudge" ? "smudge" : this.swell < 0 ? "shrink" : "expand"} ${this.number}`; }

  get isPossible() { return this.lockedBy === null && this.isBegun; }

  // A new point that holds what is seen at a place; its id, or null where it is not wanted.
  #add(wanted, room) {
    const place = this.settle(wanted), [a0, a1, b0, b1] = this.box;
    const isInside = place[0] >= a0 && place[0] <= a1 && place[1] >= b0 && place[1] <= b1;
    if (!isInside || gapTo(this.points, place) < room * this.radius) return null;
    const source = this.source(place);
    if (source === null) return null;
    this.points = [...this.points, newPoint(this.id, source, place, this.name)];
    this.id += 1;
    return this.id - 1;
  }

  #ring(share, room, turn = 0) {
    for (let k = 0; k < BRUSH_RING; k++) {
      const angle = turn + 2 * Math.PI * (k + 0.5) / BRUSH_RING, r = share * this.radius;
      this.#add([this.middle[0] + r * Math.cos(angle), this.middle[1] + r * Math.sin(angle)], room);
    }
  }

  // Still points around the brush, and once for a stroke at the rim of the picture, where none are near.
  #surround(isFirst) {
    BRUSH_RINGS.forEach((share, k) => {
      if (this.reach === 0 || share < 2 || this.reach > share * this.radius) this.#ring(share, Math.max(BRUSH_ROOM, 0.4 * share), k * Math.PI / BRUSH_RING);
    });
    if (!isFirst || (this.reach > 0 && this.reach < 4 * this.radius)) return;
    const [a0, a1, b0, b1] = this.box, room = Math.hypot(a1 - a0, b1 - b0) / 6 / this.radius;
    for (const u of [0, 0.5, 1]) for (const v of [0, 0.5, 1]) {
      if (u !== 0.5 || v !== 0.5) this.#add([a0 + u * (a1 - a0), b0 + v * (b1 - b0)], Math.max(1, room));
    }
  }

  // ---- the flow -----------------------------------------------------------------------------------------------------

  #move(by) {
    this.points = this.points.map((p) => {
      if (!p.active || p.locked) return p;
      const x = p.target[0] - this.middle[0], y = p.target[1] - this.middle[1], t = Math.hypot(x, y) / this.radius;
      return t < 1 || p.id === this.held ? { ...p, target: by(p, x, y, p.id === this.held ? 1 : brushFalloff(t)) } : p;
    });
  }

  // The brush goes to a place, and takes what lies in it along. Matter that is carried on and on would pile up ahead and
  // fold: after a while the brush goes faster than what it holds, which stays on the way.
  smudge(place) {
    const way = [place[0] - this.middle[0], place[1] - this.middle[1]], length = Math.hypot(...way);
    const count = Math.ceil(length / (BRUSH_STEP * this.radius) - 1e-9);
    for (let k = 0; k < count; k++) {
      const da = way[0] / count, db = way[1] / count;
      const hold = Math.max(BRUSH_SLIPS, Math.min(1, 1 - (this.done / this.radius - BRUSH_CARRIES)));
      if (hold < 1) this.held = null;
      this.#move((p, x, y, share) => [p.target[0] + hold * share * da, p.target[1] + hold * share * db]);
      this.middle = [this.middle[0] + da, this.middle[1] + db];
      this.way += length / count;
      this.done += length / count;
      if (this.way < BRUSH_LEG * this.radius) continue;
      this.way = 0;
      this.source = this.sourceAt(this.points);
      this.#surround(false);
    }
  }

  // What lies in the brush grows (by a positive logarithm of its scale) or shrinks.
  size(swell) {
    const wanted = Math.max(-BRUSH_MOST_SWELL, Math.min(BRUSH_MOST_SWELL, swell)), by = wanted - this.swell;
    const count = Math.ceil(Math.abs(by) / BRUSH_STEP - 1e-9), was = this.name;
    for (let k = 0; k < count; k++) {
      this.#move((p, x, y, share) => {
        const factor = p.id === this.held ? 1 : Math.exp(share * by / count);
        return [this.middle[0] + factor * x, this.middle[1] + factor * y];
      });
    }
    this.swell = wanted;
    if (this.name !== was) this.points = this.points.map((p) => (p.name === was ? { ...p, name: this.name } : p));
  }
}
