// Rays between a view and the volume in it: from places in space to pixels and back, and where a ray meets the body.
// Behind camera.js; no DOM.

const HALF_SEEN = 0.5; // a surface is where half of the light is stopped

// A view's window on space: from places to pixels of one picture and back.
class SpaceCamera {
  // camera: see camera.js; bend: of a perspective; middle of what is seen; box: {left, top, width, height} in pixels.
  constructor(camera, bend, middle, box) {
    const { right, up, direction, pan, height } = camera, aspect = box.width / box.height;
    Object.assign(this, { right, up, ahead: direction, box, half: [(height / 2) * aspect, height / 2], bend: bend / height });
    this.eye = added(middle, added(scaled(right, pan[0]), scaled(up, pan[1])));
  }

  // Pixels, and how far away: {at: [x, y], depth, scale}, scale being a length in space for one pixel there.
  see(place) {
    const { box, bend, half } = this, from = place.map((x, k) => x - this.eye[k]), depth = dot(from, this.ahead);
    const near = bend > 0 ? Math.max(1e-6, 1 + depth * bend) : 1; // how much smaller things look there
    const a = dot(from, this.right) / near / half[0], b = dot(from, this.up) / near / half[1];
    return { at: [box.left + ((a + 1) / 2) * box.width, box.top + ((1 - b) / 2) * box.height], depth,
      scale: (2 * half[1] * near) / box.height };
  }

  // The way in space, parallel to the screen, of a way on it at a place.
  way(place, [dx, dy]) {
    const { scale } = this.see(place);
    return added(scaled(this.right, dx * scale), scaled(this.up, -dy * scale));
  }

  // The same along one axis of space: as far as brings its picture nearest to the hand.
  wayAlong(axis, place, [dx, dy]) {
    const { at, scale } = this.see(place), unit = [0, 1, 2].map((k) => (k === axis ? 1 : 0));
    const there = this.see(added(place, scaled(unit, scale))).at, [u, v] = [there[0] - at[0], there[1] - at[1]];
    const steep = u * u + v * v;
    return steep < 0.01 ? [0, 0, 0] : scaled(unit, (scale * (dx * u + dy * v)) / steep); // seen from its end it stands still
  }

  // Where the ray of a pixel begins and leads.
  ray([x, y]) {
    const { box, half, bend } = this, a = ((x - box.left) / box.width) * 2 - 1, b = 1 - ((y - box.top) / box.height) * 2;
    const aside = added(scaled(this.right, a * half[0]), scaled(this.up, b * half[1]));
    if (!(bend > 0)) return { start: added(this.eye, aside), ray: this.ahead };
    const ray = unitVector(added(aside, scaled(this.ahead, 1 / bend)));
    return { start: added(this.eye, scaled(this.ahead, -1 / bend)), ray };
  }

  // The way to the viewer from a place.
  toViewer(place) {
    if (!(this.bend > 0)) return scaled(this.ahead, -1);
    const eye = added(this.eye, scaled(this.ahead, -1 / this.bend));
    return unitVector(eye.map((x, k) => x - place[k]));
  }
}

// The deformed body as the ray caster sees it, for a few rays: lengths are along the index axes, from the first voxel.
class Body {
  constructor({ values, info, field, table, unit, clip }) {
    const box = field?.box ?? info.box;
    Object.assign(this, { values, info, space: field?.space ?? null, planar: field?.planar ?? null, table, unit,
      box: clip ? leftOf(box, clipSides(box, clip)) : box }); // what is cut away is no body
    this.step = Math.min(...info.spacing);
  }

  toFrame(place) {
    const from = place.map((x, k) => x - this.info.origin[k]);
    return this.info.to_frame.map((row) => dot(row, from));
  }

  origin(x) {
    const { planar, space } = this;
    const moved = planar && !planar.cut ? added(x, planarAt(planar, x)) : x;
    return space ? added(moved, sampleAt(space, moved)) : moved;
  }

  opacity(x) {
    const { shape, spacing } = this.info, from = this.origin(x), at = from.map((l, k) => Math.round(l / spacing[k]));
    if (at.some((i, k) => i < 0 || i >= shape[k])) return 0;
    return opacityOfByte(this.table, this.values[(at[2] * shape[1] + at[1]) * shape[0] + at[0]]);
  }

  // The place in the box where half of the light along a ray is stopped, as a length along it, or null.
  meet(start, ray, from = 0) {
    const { low, high } = this.box;
    let first = from, last = Infinity;
    for (let k = 0; k < 3; k++) {
      const slope = Math.abs(ray[k]) < 1e-9 ? 1e-9 : ray[k], a = (low[k] - start[k]) / slope, b = (high[k] - start[k]) / slope;
      first = Math.max(first, Math.min(a, b));
      last = Math.min(last, Math.max(a, b));
    }
    let left = 1;
    for (let t = first + this.step / 2; t < last; t += this.step) {
      left *= Math.pow(1 - Math.min(0.9999, this.opacity(added(start, scaled(ray, t)))), this.step / this.unit);
      if (left < 1 - HALF_SEEN) return t;
    }
    return null;
  }

  // Whether something lies between a place in space and the viewer; what is nearer than two voxels does not count.
  hides(place, toViewer) {
    const ray = unitVector(this.info.to_frame.map((row) => dot(row, toViewer)));
    return this.meet(this.toFrame(place), ray, 2 * this.step) !== null;
  }

  // The place in space where a ray in space meets the body, or null.
  surface({ start, ray }) {
    const along = unitVector(this.info.to_frame.map((row) => dot(row, ray))), t = this.meet(this.toFrame(start), along, -Infinity);
    return t === null ? null : added(start, scaled(ray, t));
  }
}

// A displacement sampled in space, between its samples; x in the frame of the volume.
function sampleAt({ shape: [nx, ny, nz], origin, spacing, values }, x) {
  const n = [nx, ny, nz], q = x.map((l, k) => Math.max(0, Math.min(n[k] - 1, (l - origin[k]) / spacing[k])));
  const i = q.map((v, k) => Math.max(0, Math.min(n[k] - 2, Math.floor(v)))), f = q.map((v, k) => v - i[k]), sum = [0, 0, 0];
  for (let corner = 0; corner < 8; corner++) {
    const at = i.map((v, k) => Math.min(n[k] - 1, v + ((corner >> k) & 1)));
    const weight = f.reduce((w, v, k) => w * ((corner >> k) & 1 ? v : 1 - v), 1), j = 3 * ((at[2] * ny + at[1]) * nx + at[0]);
    if (weight) for (let m = 0; m < 3; m++) sum[m] += weight * values[j + m];
  }
  return sum;
}

// The displacement of maps over a plane, weighted along its normal.
function planarAt({ shape: [count, rows, columns], origin, spacing, depth, plane: { origin: o, u, v, n }, maps, weights }, x) {
  const from = x.map((l, k) => l - o[k]), knots = weights.length / count;
  const clamp = (value, most) => Math.max(0, Math.min(most, value));
  const p = clamp((dot(from, u) - origin[0]) / spacing[0], columns - 1), q = clamp((dot(from, v) - origin[1]) / spacing[1], rows - 1);
  const z = depth[1] > depth[0] ? clamp((dot(from, n) - depth[0]) / (depth[1] - depth[0]), 1) * (knots - 1) : 0;
  const [i, j, k] = [[p, columns], [q, rows], [z, knots]].map(([w, m]) => Math.max(0, Math.min(m - 2, Math.floor(w))));
  const s = p - i, t = q - j, w = z - k, sum = [0, 0];
  for (let m = 0; m < count; m++) {
    const weight = weights[m * knots + k] * (1 - w) + (knots > 1 ? weights[m * knots + k + 1] * w : 0);
    if (!weight) continue;
    const row = (m * rows + j) * columns + i, down = rows > 1 ? columns : 0, east = columns > 1 ? 1 : 0;
    for (let c = 0; c < 2; c++) {
      const value = (at) => maps[2 * at + c];
      sum[c] += weight * ((1 - t) * ((1 - s) * value(row) + s * value(row + east)) +
        t * ((1 - s) * value(row + down) + s * value(row + down + east)));
    }
  }
  return added(scaled(u, sum[0]), scaled(v, sum[1]));
}
