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
  constructor(layered, maps, nodes, { origin, scale, shift }, softness) {
    Object.assign(this, { layered, maps, nodes, origin, scale, shift, softness, near: new Map() });
    this.still = layered.fits.length; // the number of the identity among the maps
    this.plan = new Int8Array(nodes.rows * nodes.columns);
    this.count = layered.fits.length + (layered.hasRest ? 1 : 0);
    this.#measure();
    for (let i = 0; i < nodes.rows; i++) {
      for (let j = 0; j < nodes.columns; j++) this.plan[i * nodes.columns + j] = this.#cell(i, j);
    }
  }

  // The depth of every node's images within their regions, and of the node itself within its own.
  #measure() {
    const { layered: { regions, fits }, maps, nodes: { rows, columns, a0, b0, step } } = this, n = rows * columns;
    this.keys = new Uint8Array(n);
    this.depth = new Float32Array(n);
    this.depths = fits.map(() => new Float32Array(n));
    for (let i = 0, at = 0; i < rows; i++) {
      for (let j = 0; j < columns; j++, at++) {
        const a = a0 + j * step, b = b0 + i * step;
        let key = 0, depth = Infinity;
        for (let k = 0; k < regions.length; k++) {
          const d = regions[k].distance(a, b);
          if (d < 0) key |= 1 << k;
          if (Math.abs(d) < depth) depth = Math.abs(d);
        }
        this.keys[at] = key;
        this.depth[at] = depth;
        for (let k = 0; k < fits.length; k++) {
          this.depths[k][at] = marginOf(regions, fits[k].key, this.#a(maps[k][2 * at]), this.#b(maps[k][2 * at + 1]));
        }
      }
    }
  }

  #a(p) { return (p - this.shift) / this.scale[0] + this.origin[0]; }

  #b(q) { return (q - this.shift) / this.scale[1] + this.origin[1]; }

  // What all of a cell shows: the number of a map, nothing, or not the same everywhere.
  #cell(i, j) {
    const { columns, rows, step } = this.nodes, { layered, softness } = this, half = softness / 2;
    const up = i * columns, down = Math.min(i + 1, rows - 1) * columns, right = Math.min(j + 1, columns - 1);
    const corners = [up + j, up + right, down + j, down + right], key = this.keys[up + j];
    const isOneRegion = corners.every((c) => this.keys[c] === key && this.depth[c] > step * 0.7072 + half);
    const own = isOneRegion ? layered.byKey.get(key) ?? this.still : LAYER_MIXED;
    if (own === this.still) return layered.rule === "paper" || this.#brought(corners, half).length === 0 ? own : LAYER_MIXED;
    if (layered.rule === "paper" && own === LAYER_MIXED) return LAYER_MIXED;
    const cover = own === LAYER_MIXED ? 0 : this.#coverage(own, corners, half);
    if (cover === 1) return own;
    if (layered.rule === "paper") return cover < 0 ? LAYER_EMPTY : LAYER_MIXED;
    if (cover === 0 && own !== LAYER_MIXED) return LAYER_MIXED;
    if (own === LAYER_MIXED && layered.hasRest) return LAYER_MIXED;
    const found = this.#brought(corners, half);
    if (found.length === 0) return LAYER_EMPTY;
    return found.length === 1 && this.#coverage(found[0], corners, half) === 1 ? found[0] : LAYER_MIXED;
  }

  #brought(corners, half) {
    return this.layered.fits.map((_, k) => k).filter((k) => this.#coverage(k, corners, half) >= 0);
  }

  // 1 if a cell's images under a map all lie deep in its region, -1 if none of them comes near it, else 0.
  #coverage(k, [p, q, r, s], half) {
    const map = this.maps[k], d = this.depths[k], { scale } = this;
    const gap = (m, n) => Math.hypot((map[2 * m] - map[2 * n]) / scale[0], (map[2 * m + 1] - map[2 * n + 1]) / scale[1]);
    const reach = half + 0.5 * (Math.max(gap(p, q), gap(r, s)) + Math.max(gap(p, r), gap(q, s)));
    if (Math.min(d[p], d[q], d[r], d[s]) > reach) return 1;
    return Math.max(d[p], d[q], d[r], d[s]) < -reach ? -1 : 0;
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
    const { columns } = this.nodes, { layered, maps, work } = this, j = cell % columns, i = (cell - j) / columns;
    const { a0, b0, step, rows } = this.nodes, a = a0 + (j + s) * step, b = b0 + (i + t) * step;
    const east = j < columns - 1 ? 2 : 0, south = i < rows - 1 ? 2 * columns : 0, at = 2 * cell;
    for (let k = 0; k < layered.fits.length; k++) {
      const map = maps[k];
      for (let c = 0; c < 2; c++) {
        const n = at + c, top = map[n] + s * (map[n + east] - map[n]), low = map[n + south];
        work.pixels[2 * k + c] = top + t * (low + s * (map[n + south + east] - low) - top);
      }
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

  work = { pixels: new Float64Array(512), moves: [], out: [0, 0, 1, 0] };

  move = (k) => this.work.moves[k];
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
