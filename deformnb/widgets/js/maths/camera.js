// Where the viewer stands. Parallel projection: a direction of looking, what is up, and how much is seen.
// Vectors are in space (LPS); the ray caster gets them in the volume's own frame.

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const scaled = (a, k) => a.map((x) => x * k);
export const added = (a, b) => a.map((x, i) => x + b[i]);
export const unitVector = (a) => { const n = Math.hypot(...a); return n > 1e-9 ? scaled(a, 1 / n) : null; };
const rotated = (a, side, angle) => added(scaled(a, Math.cos(angle)), scaled(side, Math.sin(angle)));

const SEEN = 1.02; // a little air around the box, as in the stills
const SMALLEST_SHARE = 0.62; // of the box's diagonal: what is seen after turning a thin view must not burst the frame

export class Camera {
  constructor() {
    this.direction = [0.4, 1, -0.3];
    this.up = [0, 0, 1];
    this.height = 1;
    this.pan = [0, 0];
    this.bend = 0;
    this.#straighten();
  }

  get right() { return cross(this.direction, this.up); }

  #straighten() {
    this.direction = unitVector(this.direction) || [0, 1, 0];
    const across = unitVector(cross(this.direction, this.up));
    const other = Math.abs(this.direction[2]) > 0.99 ? [0, -1, 0] : [0, 0, 1];
    this.up = unitVector(cross(across || unitVector(cross(this.direction, other)), this.direction));
  }

  look(direction, up) {
    this.direction = [...direction];
    this.up = up ? [...up] : Math.abs(unitVector(direction)[2]) > 0.999 ? [0, -1, 0] : [0, 0, 1];
    this.#straighten();
  }

  /** Turns what is seen as if the pointer held its front: dx to the right, dy downwards, in radians. */
  turn(dx, dy) {
    const right = this.right;
    const direction = rotated(this.direction, scaled(right, -1), -dx);
    const up = this.up;
    this.direction = rotated(direction, up, -dy);
    this.up = rotated(up, scaled(direction, -1), -dy);
    this.#straighten();
  }

  /** Turns the picture itself, anticlockwise. */
  roll(angle) {
    this.up = rotated(this.up, this.right, angle);
    this.#straighten();
  }

  /** The length in space that the picture is high when all corners (vectors from the middle) are to be seen. */
  fit(corners, aspect) {
    const right = this.right;
    let a = 0, b = 0, far = 0;
    for (const corner of corners) {
      a = Math.max(a, Math.abs(dot(corner, right)));
      b = Math.max(b, Math.abs(dot(corner, this.up)));
      far = Math.max(far, Math.hypot(...corner));
    }
    return 2 * SEEN * Math.max(b, a / aspect, SMALLEST_SHARE * far * Math.min(1, 1 / aspect));
  }

  /** What the ray caster wants. toFrame: 3 x 3 rows, from space to the volume's frame; middle: there. */
  inFrame(toFrame, middle, aspect) {
    const turned = (v) => toFrame.map((row) => dot(row, v));
    const right = turned(this.right), up = turned(this.up), ahead = turned(this.direction), half = this.height / 2;
    const eye = added(middle, added(scaled(right, this.pan[0]), scaled(up, this.pan[1])));
    return { eye, right: scaled(right, half * aspect), up: scaled(up, half), ahead, bend: this.bend / this.height };
  }
}

/** The side of a patient that a direction in space leads to, one or two letters: "L", "PS". */
export function sideOf(vector) {
  const names = [["L", "R"], ["P", "A"], ["S", "I"]];
  const order = [0, 1, 2].sort((i, j) => Math.abs(vector[j]) - Math.abs(vector[i]));
  const [first, second] = order.map((i) => names[i][vector[i] < 0 ? 1 : 0]);
  return Math.abs(vector[order[1]]) > 0.45 ? first + second : first;
}
