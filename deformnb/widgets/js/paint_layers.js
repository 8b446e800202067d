// Which of several smooth maps is seen in every pixel of a picture with cuts. Needs cut_fits.js. No DOM.
//
// The maps are known at the nodes of a lattice. Most cells between the nodes show one map, or nothing at all, and are
// told from their corners: a distance changes by no more than the way that is walked. Only where a cut runs through a
// cell, each of its pixels is decided by itself, and no displacement is ever interpolated across a cut.

const LAYER_EMPTY = -1, LAYER_MIXED = -2;
const FEW_EDGES = 32; // of all cuts together: beyond that each cell looks for those that are near

// maps: one for each fit, and the identity if regions without points stay; places of the nodes in pixels of a level,
// p = (a - origin) * scale + shift. nodes: {a0, b0, step} in the picture, {rows, columns} of the lattice.
class LayerPlan {
  constructor(layered, maps, nodes, { origin, scale, shift }, softness, isMoving) {
    Object.assign(this, { layered, maps, nodes, origin, scale, shift, softness, isMoving, near: new Map() });
    this.still = layered.fits.length; // the number of the identity among the maps
    this.plan = new Int8Array(nodes.rows * nodes.columns);
    this.fitOf = Int8Array.from({ length: 1 << layered.regions.length }, (_, key) => layered.byKey.get(key) ?? -1);
    this.#measure();
    for (let i = 0; i < nodes.rows; i++) {
      for (let j = 0; j < nodes.columns; j++) this.plan[i * nodes.columns + j] = this.#cell(i, j);
    }
  }

  // Distances of every node to the cuts, and the depth of its images within their regions. Far from all cuts a bound
  // will do: a distance changes by no more than the way from the node before.
  #measure() {
    const { layered: { regions, fits }, maps, nodes: { rows, columns, a0, b0, step }, scale } = this, n = rows * columns;
    const enough = 6 * step + this.softness;
    this.here = regions.map(() => new Float32Array(n));
    this.depths = fits.map(() => new Float32Array(n));
    const fill = (values, exact, way) => {
      for (let i = 0, at = 0; i < rows; i++) {
        for (let j = 0; j < columns; j++, at++) {
          const before = j ? values[at - 1] : i ? values[at - columns] : 0, from = j ? at - 1 : at - columns;
          const left = Math.abs(before) - (at ? way(from, at) : 0);
          values[at] = left > enough ? (before < 0 ? -left : left) : exact(at, i, j);
        }
      }
    };
    regions.forEach(({ distance }, k) => fill(this.here[k], (at, i, j) => distance(a0 + j * step, b0 + i * step), () => step));
    fits.forEach(({ key }, k) => {
      const map = maps[k], exact = (at) => marginOf(regions, key, this.#a(map[2 * at]), this.#b(map[2 * at + 1]));
      fill(this.depths[k], exact, (m, at) => wayBetween(map, m, at, scale));
    });
  }

  #a(p) { return (p - this.shift) / this.scale[0] + this.origin[0]; }

  #b(q) { return (q - this.shift) / this.scale[1] + this.origin[1]; }

  // What all of a cell shows: the number of a map, nothing, or not the same everywhere.
  #cell(i, j) {
    const { columns, rows, step } = this.nodes, { layered, here, still } = this, half = this.softness / 2;
    const up = i * columns, down = Math.min(i + 1, rows - 1) * columns, right = Math.min(j + 1, columns - 1);
    const p = up + j, q = up + right, r = down + j, s = down + right, reach = 0.7072 * step + half;
    let key = 0, isOne = true;
    for (let k = 0; k < here.length && isOne; k++) {
      const d = here[k], least = Math.min(d[p], d[q], d[r], d[s]);
      if (least < -reach && Math.max(d[p], d[q], d[r], d[s]) < -reach) key |= 1 << k;
      else isOne = least > reach;
    }
    const own = isOne ? (this.fitOf[key] < 0 ? still : this.fitOf[key]) : LAYER_MIXED;
    if (layered.rule === "paper") {
      if (own === still || own === LAYER_MIXED) return own;
      const cover = this.#coverage(own, p, q, r, s, half);
      return cover > 0 ? own : cover < 0 ? LAYER_EMPTY : LAYER_MIXED;
    }
    if (own !== LAYER_MIXED && own !== still) {
      const cover = this.#coverage(own, p, q, r, s, half);
      if (cover > 0) return own;
      if (cover === 0) return LAYER_MIXED;
    } else if (own === LAYER_MIXED && layered.hasRest) return LAYER_MIXED;
    let found = LAYER_EMPTY;
    for (let k = 0; k < this.depths.length; k++) {
      const cover = this.#coverage(k, p, q, r, s, half);
      if (cover === 0 || (cover > 0 && (found >= 0 || own === still))) return LAYER_MIXED;
      if (cover > 0) found = k;
    }
    return own === still ? still : found;
  }

  // 1 if a cell's images under a map all lie deep in its region, -1 if none of them comes near it, else 0.
  #coverage(k, p, q, r, s, half) {
    const map = this.maps[k], d = this.depths[k], { scale } = this;
    const least = Math.min(d[p], d[q], d[r], d[s]), most = Math.max(d[p], d[q], d[r], d[s]);
    if (least < half && most > -half) return 0;
    const reach = half + 0.5 * (Math.max(wayBetween(map, p, q, scale), wayBetween(map, r, s, scale)) +
      Math.max(wayBetween(map, p, r, scale), wayBetween(map, q, s, scale)));
    return least > reach ? 1 : most < -reach ? -1 : 0;
  }

  // The cuts as one cell sees them: of long outlines only what is near.
  #regionsAt(cell) {
    const { layered: { regions }, maps, nodes: { columns, rows, step, a0, b0 } } = this;
    this.isShort ??= regions.reduce((sum, { edges }) => sum + (edges ?? 0), 0) <= FEW_EDGES;
    if (this.isShort) return regions;
    let made = this.near.get(cell);
    if (made) return made;
    const j = cell % columns, i = (cell - j) / columns, a = a0 + (j + 0.5) * step, b = b0 + (i + 0.5) * step;
    let radius = 0.7072 * step;
    const right = Math.min(j + 1, columns - 1);
    const corners = [i, Math.min(i + 1, rows - 1)].flatMap((y) => [y * columns + j, y * columns + right]);
    for (const map of maps.slice(0, this.layered.fits.length)) {
      for (const c of corners) radius = Math.max(radius, Math.hypot(this.#a(map[2 * c]) - a, this.#b(map[2 * c + 1]) - b));
    }
    this.near.set(cell, made = regions.map((region) => ({ distance: region.near(a, b, radius) })));
    return made;
  }

  // What one pixel shows: writes [p, q, opacity] in pixels of the level. The pixel lies at shares (s, t) of a cell.
  look(cell, s, t, out) {
    // Between several cuts, what stays is not told from one distance.
    if (this.isMoving && (this.here.length === 1 || !this.layered.hasRest)) this.#lookQuickly(cell, s, t, out);
    else this.#lookExactly(cell, s, t, out);
  }

  // Distances between the nodes are interpolated while something moves; at a corner of a cut that is not exact.
  #lookQuickly(cell, s, t, out) {
    const { layered, depths, here, softness, work } = this, { columns, rows } = this.nodes, { covers } = work;
    const e = cell % columns < columns - 1 ? 1 : 0, d = cell < (rows - 1) * columns ? columns : 0;
    let key = 0, inside = Infinity, still = 1, sum = 0, best = 0;
    for (let k = 0; k < here.length; k++) {
      const value = between(here[k], cell, e, d, s, t);
      if (value < 0) key |= 1 << k;
      inside = Math.min(inside, Math.abs(value));
    }
    const own = this.fitOf[key];
    for (let k = 0; k < depths.length; k++) sum += covers[k] = coverage(between(depths[k], cell, e, d, s, t), softness);
    let k = own;
    if (layered.rule === "paper") {
      out[2] = own < 0 ? 1 : Math.min(1, covers[own] / coverage(inside, softness));
    } else {
      if (layered.hasRest) still = own < 0 ? coverage(inside, softness) : 1 - coverage(inside, softness);
      else still = 0;
      best = own < 0 ? still : covers[own];
      if (best < 0.5) {
        for (let n = 0; n < covers.length && n < depths.length; n++) if (covers[n] > best) { best = covers[n]; k = n; }
        if (still > best) k = -1;
      }
      out[2] = Math.min(1, sum + still);
    }
    const map = this.maps[k < 0 ? this.still : k];
    out[0] = between(map, 2 * cell, 2 * e, 2 * d, s, t);
    out[1] = between(map, 2 * cell + 1, 2 * e, 2 * d, s, t);
  }

  #lookExactly(cell, s, t, out) {
    const { columns } = this.nodes, { layered, maps, work } = this, j = cell % columns, i = (cell - j) / columns;
    const { a0, b0, step, rows } = this.nodes, a = a0 + (j + s) * step, b = b0 + (i + t) * step;
    const east = j < columns - 1 ? 2 : 0, south = i < rows - 1 ? 2 * columns : 0;
    for (let k = 0; k < layered.fits.length; k++) {
      for (let c = 0; c < 2; c++) work.pixels[2 * k + c] = between(maps[k], 2 * cell + c, east, south, s, t);
      work.moves[k] ??= [0, 0];
      work.moves[k][0] = this.#a(work.pixels[2 * k]) - a;
      work.moves[k][1] = this.#b(work.pixels[2 * k + 1]) - b;
    }
    const [,, opacity, k] = chosenPlace(layered, this.#regionsAt(cell), a, b, this.move, this.softness, work.out);
    out[2] = opacity;
    if (k < 0) {
      out[0] = (a - this.origin[0]) * this.scale[0] + this.shift;
      out[1] = (b - this.origin[1]) * this.scale[1] + this.shift;
    } else {
      out[0] = work.pixels[2 * k];
      out[1] = work.pixels[2 * k + 1];
    }
  }

  work = { pixels: new Float64Array(512), covers: new Float64Array(256), moves: [], out: [0, 0, 1, 0] };

  move = (k) => this.work.moves[k];
}

// Bilinear between four nodes.
function between(values, at, east, south, s, t) {
  const p = values[at], r = values[at + south], top = p + s * (values[at + east] - p);
  return top + t * (r + s * (values[at + south + east] - r) - top);
}

// How far two nodes' images lie apart in the picture.
function wayBetween(map, m, n, scale) {
  const a = (map[2 * m] - map[2 * n]) / scale[0], b = (map[2 * m + 1] - map[2 * n + 1]) / scale[1];
  return Math.sqrt(a * a + b * b);
}

// The pixels of all cells that show more than one map, or nothing: `paper` is [r, g, b].
function lookUpLayers(out, w, h, layers, lattice, { pixels, width, height }, channels, fill, rim, paper) {
  const { plan, nodes: { columns } } = layers, seen = [0, 0, 1], right = width - 1, bottom = height - 1;
  const empty = OPAQUE | (paper[2] << 16) | (paper[1] << 8) | paper[0];
  for (let y = 0; y < h; y++) {
    const i = Math.min(Math.floor(y / lattice), Math.max(0, Math.floor((h - 2) / lattice))), t = y / lattice - i;
    for (let j = 0, x = 0; x < w; j++) {
      const last = Math.min(w, x + lattice), cell = i * columns + j, first = x;
      if (plan[cell] >= 0) { x = last; continue; }
      if (plan[cell] === LAYER_EMPTY) { out.fill(empty, y * w + x, y * w + last); x = last; continue; }
      for (; x < last; x++) {
        layers.look(cell, (x - first) / lattice, t, seen);
        const [u, v, opacity] = seen;
        if (opacity === 0) { out[y * w + x] = empty; continue; }
        const isIn = u >= -rim && v >= -rim && u < right + rim && v < bottom + rim;
        const p = u < 0 ? 0 : u > right ? right : u, q = v < 0 ? 0 : v > bottom ? bottom : v, pi = p | 0, qi = q | 0;
        const s = p - pi, f = q - qi, at = channels * (qi * width + pi), east = pi < right ? channels : 0;
        const low = at + (qi < bottom ? channels * width : 0);
        let colour = OPAQUE;
        for (let c = 0; c < 3; c++) {
          const e = channels === 1 ? 0 : c, top = pixels[at + e] + s * (pixels[at + east + e] - pixels[at + e]);
          const bed = pixels[low + e] + s * (pixels[low + east + e] - pixels[low + e]);
          const value = isIn ? top + f * (bed - top) : fill;
          colour |= ((paper[c] + opacity * (value - paper[c]) + 0.5) | 0) << (8 * c);
        }
        out[y * w + x] = colour;
      }
    }
  }
}
