// The matrix of a kernel between all centres, and its Cholesky factor. During a drag most centres stay where they are:
// those that move come last, so that only their rows are evaluated and factored again. Nothing is updated in place of
// being computed, so no error accumulates. A centre that moves costs O(n^2) instead of O(n^3).

const MOST_KEPT = 8; // matrices: of each region of cuts there is one
const MOST_NUMBERS = 2 ** 24; // of all of them, if they are as large as the latest

/**
 * The inputs of a matrix: places (n x dim), the support radius, the term added to the diagonal, and null or the support
 * radii of the centres' own.
 */
export type Centres = {
  kernel: string;
  radius: number;
  places: Float64Array;
  nugget: ArrayLike<number>;
  radii: ArrayLike<number> | null;
};

/** The latest first. */
const kept: KernelMatrix[] = [];

/**
 * The matrix of these centres: one of the latest, in which as few rows as possible are evaluated again, or a new one.
 * It is valid until the next call.
 * @param profile of the squared relative distance
 */
export function kernelMatrix(centres: Centres, profile: (s: number) => number) {
  const n = centres.nugget.length;
  let best = null,
    fewest = n / 2;
  for (const matrix of kept) {
    const moved = matrix.profile === profile ? matrix.findMoved(centres, fewest) : null;
    if (moved && (moved.length < fewest || !best)) {
      best = { matrix, moved };
      fewest = moved.length;
    }
    if (fewest === 0) break;
  }
  const matrix = best?.matrix ?? new KernelMatrix(n, centres, profile);
  if (best) {
    kept.splice(kept.indexOf(matrix), 1);
    matrix.move(centres, best.moved);
  }
  kept.unshift(matrix);
  const room = Math.floor(MOST_NUMBERS / (2 * Math.max(1, n) ** 2));
  kept.length = Math.min(kept.length, Math.max(1, Math.min(MOST_KEPT, room)));
  return matrix;
}

/** phi(|x_i - x_j| / R) + nugget, with R_j in place of R where the centres have their own radii. */
class KernelMatrix {
  dim: number;
  phi: Float64Array<ArrayBuffer>;
  order: number[];
  factored = 0; // rows
  factor: Float64Array<ArrayBuffer>;

  constructor(
    readonly n: number,
    public centres: Centres,
    readonly profile: (s: number) => number,
  ) {
    this.dim = centres.places.length / n;
    this.phi = new Float64Array(n * n); // row by row
    this.order = Array.from({ length: n }, (_, k) => k); // of the rows of the factor
    this.factor = new Float64Array(0);
    for (let i = 0; i < n; i++) this.#evaluate(i, i + 1);
  }

  /**
   * The centres that differ from these, null if those are more than a number or the matrix is of another kind.
   */
  findMoved(now: Centres, most: number) {
    const { n, dim, centres: old } = this,
      found = [];
    const isOther = old.kernel !== now.kernel || old.radius !== now.radius || !old.radii !== !now.radii;
    if (isOther || now.nugget.length !== n || now.places.length !== old.places.length) return null;
    for (let k = 0; k < n; k++) {
      let isSame = old.nugget[k] === now.nugget[k] && old.radii?.[k] === now.radii?.[k];
      for (let c = dim * k; c < dim * (k + 1); c++) if (old.places[c] !== now.places[c]) isSame = false;
      if (isSame) continue;
      if (found.length >= most) return null;
      found.push(k);
    }
    return found;
  }

  /** Take the places of moved centres. */
  move(centres: Centres, moved: number[]) {
    this.centres = centres;
    if (moved.length === 0) return;
    const isMoved = new Set(moved);
    this.factored = Math.min(
      this.factored,
      this.order.findIndex((k) => isMoved.has(k)),
    );
    this.order = [...this.order.filter((k) => !isMoved.has(k)), ...moved];
    for (const k of moved) this.#evaluate(k, this.n);
  }

  /** Evaluate row and column i up to a number of centres. */
  #evaluate(i: number, count: number) {
    const {
        n,
        dim,
        phi,
        profile,
        centres: { places, radius, nugget, radii },
      } = this,
      own = radii ? radii[i]! : radius;
    for (let j = 0; j < count; j++) {
      const r = radii ? radii[j]! : radius;
      let s = 0,
        t = 0;
      for (let c = 0; c < dim; c++) {
        const step = places[dim * i + c]! - places[dim * j + c]!;
        s += (step / r) ** 2;
        t += (step / own) ** 2;
      }
      phi[i * n + j] = profile(s);
      phi[j * n + i] = r === own ? phi[i * n + j]! : profile(t);
    }
    phi[i * n + i]! += nugget[i]!;
  }

  /** The solution of a positive definite system with m right-hand sides (n x m); NaN where it is not definite. */
  solve(rhs: Float64Array, m: number) {
    this.#complete();
    const { n, order, factor: l } = this,
      out = new Float64Array(n * m),
      x = new Float64Array(n);
    for (let c = 0; c < m; c++) {
      for (let i = 0; i < n; i++) x[i] = (rhs[order[i]! * m + c]! - dot(l, i * n, x, 0, i)) / l[i * n + i]!;
      for (let i = n - 1; i >= 0; i--) {
        const value = x[i]! / l[i * n + i]!;
        out[order[i]! * m + c] = value;
        for (let k = 0, at = i * n; k < i; k++, at++) x[k]! -= l[at]! * value;
      }
    }
    return out;
  }

  /** Factor the rows that are not: L L^T is the matrix in this order. */
  #complete() {
    const { n, phi, order } = this;
    if (this.factor.length === 0) this.factor = new Float64Array(n * n);
    const l = this.factor;
    for (let i = this.factored; i < n; i++) {
      const row = i * n,
        from = order[i]! * n;
      for (let j = 0; j < i; j++) l[row + j] = (phi[from + order[j]!]! - dot(l, row, l, j * n, j)) / l[j * n + j]!;
      l[row + i] = Math.sqrt(phi[from + order[i]!]! - dot(l, row, l, row, i));
    }
    this.factored = n;
  }
}

/** The sum of products of so many numbers of two arrays, from a place in each. */
function dot(a: Float64Array, p: number, b: Float64Array, q: number, count: number) {
  let s = 0,
    t = 0,
    u = 0,
    v = 0,
    k = 0; // four sums: a single one would stall at each term
  for (; k + 3 < count; k += 4) {
    s += a[p + k]! * b[q + k]!;
    t += a[p + k + 1]! * b[q + k + 1]!;
    u += a[p + k + 2]! * b[q + k + 2]!;
    v += a[p + k + 3]! * b[q + k + 3]!;
  }
  for (; k < count; k++) s += a[p + k]! * b[q + k]!;
  return s + t + (u + v);
}
