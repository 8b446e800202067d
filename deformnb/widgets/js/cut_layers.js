// The maps of a field as the ray caster takes them, with those that an editor makes put in. Needs regions.js, cut_fits.js.
// No DOM. Equal to deformnb/widgets/textures.py: one layer for each map of each region, and the distance to each cut.

const CUT_STEPS = 512, CUT_MARGIN = 0.125; // nodes along the longer side, and how far beyond the maps they go
const CUT_TILE = 32; // nodes along a square that only the near edges of an outline are asked for

/** The message "field" with its buffers in place; null if it builds on distances that `known` does not hold. */
function fieldOf(content, buffers, known) {
  const isHalf = (name) => content.space?.cut && (name === "space" || name === "depths");
  const parts = Object.fromEntries(content.buffers.map((name, k) => [name,
    isHalf(name) ? new Uint16Array(bytesOf(buffers[k]).slice().buffer) : floatsOf(buffers[k])]));
  const planar = content.planar && { ...content.planar, maps: parts.maps, weights: parts.weights };
  if (planar?.cut) {
    if (parts.distances) { known.id = planar.cut.id; known.distances = parts.distances; }
    if (known.id !== planar.cut.id) return null;
    planar.cut = { ...planar.cut, distances: known.distances };
  }
  return { box: content.box, coarse: content.coarse, planar, space: content.space && { ...content.space, values: parts.space, depths: parts.depths } };
}

/**
 * A planar field with one of its maps made anew in each region, or null if it has no such map or cannot be told.
 * layered: of layeredFit; settings: with the cuts that it was made with; index: which map it is.
 */
function withLayers(base, layered, { cuts = [] }, index) {
  const [layers, rows, columns] = base.shape, size = rows * columns * 2, before = base.cut ? base.cut.sides.length : 1;
  const count = layers / before, cut = layered.regions.length ? cutOf(base, layered, cuts) : null;
  const isSame = cut ? cut.sides === base.cut?.sides : !base.cut;
  if (index >= count || (!isSame && count > 1)) return null; // other maps would have to be divided too: Python does that
  const keys = cut ? cut.sides.map(bitsOf) : [0], raster = { shape: [rows, columns], origin: base.origin, spacing: base.spacing };
  const maps = isSame ? base.maps.slice() : new Float32Array(keys.length * size);
  const values = layersOnRaster(layered, raster);
  keys.forEach((key, r) => {
    const k = layered.regions.length ? layered.fits.findIndex((f) => f.key === key) : 0, at = (r * count + index) * size;
    if (k >= 0) maps.set(values[k], at); else maps.fill(0, at, at + size); // a region without points stays
  });
  return { ...base, maps, shape: [keys.length * count, rows, columns], cut: cut && { ...cut, rule: layered.rule } };
}

function bitsOf(sides) { return sides.reduce((sum, inside, c) => sum + (inside ? 2 ** c : 0), 0); }

// The cuts of a fit: the base's own while the same lines are drawn, for then nothing of them changes but the maps.
function cutOf(base, layered, cuts) {
  const name = JSON.stringify(cuts.filter((cut) => cut.enabled !== false).map((cut) => cut.region));
  const old = base.cut, isSame = old && (old.name ?? JSON.stringify(old.regions)) === name;
  if (isSame && layered.fits.every(({ key }) => old.sides.some((s) => bitsOf(s) === key))) return old;
  const raster = old ?? cutRaster(base), [, rows, columns] = raster.shape, { origin, spacing } = raster;
  const distances = isSame ? old.distances : cutDistances(layered.regions, { shape: [rows, columns], origin, spacing });
  const count = layered.regions.length, keys = new Set(layered.fits.map(({ key }) => key));
  for (let i = 0; i < rows * columns; i++) {
    let bits = 0;
    for (let c = 0; c < count; c++) if (distances[c * rows * columns + i] < 0) bits += 2 ** c;
    keys.add(bits);
  }
  if (keys.size > MOST_REGIONS) return null;
  const sides = [...keys].sort((a, b) => a - b).map((key) => layered.regions.map((_, c) => Boolean(key & (1 << c))));
  return { shape: [count, rows, columns], origin, spacing, distances, sides, name };
}

// Nodes around those of the maps.
function cutRaster({ shape: [, rows, columns], origin, spacing }) {
  const size = [(columns - 1) * spacing[0], (rows - 1) * spacing[1]], margin = CUT_MARGIN * Math.max(...size);
  const lengths = size.map((l) => l + 2 * margin), longest = Math.max(...lengths);
  const counts = lengths.map((l) => Math.max(8, Math.ceil((CUT_STEPS * l) / longest)));
  return { shape: [0, counts[1], counts[0]], origin: origin.map((o) => o - margin),
    spacing: lengths.map((l, i) => l / (counts[i] - 1)) };
}

/** Signed distances to each region at the nodes of a raster, one layer after the other. */
function cutDistances(regions, { shape: [rows, columns], origin, spacing }) {
  const out = new Float32Array(regions.length * rows * columns);
  const radius = 0.5 * CUT_TILE * Math.hypot(...spacing);
  for (let y = 0; y < rows; y += CUT_TILE) {
    for (let x = 0; x < columns; x += CUT_TILE) {
      const a = origin[0] + (x + CUT_TILE / 2) * spacing[0], b = origin[1] + (y + CUT_TILE / 2) * spacing[1];
      regions.forEach((region, c) => {
        const distance = region.near(a, b, radius), layer = c * rows * columns;
        for (let i = y; i < Math.min(y + CUT_TILE, rows); i++) {
          for (let k = x; k < Math.min(x + CUT_TILE, columns); k++) {
            out[layer + i * columns + k] = distance(origin[0] + k * spacing[0], origin[1] + i * spacing[1]);
          }
        }
      });
    }
  }
  return out;
}
