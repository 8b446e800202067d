// Fits in stages, equal to deformnb.rbf.stages in the plane. Needs rigid_fits.js. No DOM.
//
//   stagedFit(points, parts, settings)  -> as rigidFit; with settings.stages > 1 also {stages}: the fits, first to last
//   stagedAt(fit, a, b), stagedOnRaster(fit, raster, out)    for fieldAt and fieldOnRaster
//
// The points go from source to target in equal parts, and the maps follow one another: a place of the result is looked
// up in the last stage first.

const MOST_STAGES = 64;

function stagedFit(points, parts, settings = {}) {
  const count = settings.stages ?? 1;
  if (count === 1) return rigidFit(points, parts, settings);
  checkStages(count, parts);
  rbfCheckSettings(settings.kernel ?? "wendland_c2", settings.trend ?? "affine", settings.smoothing ?? 0,
    settings.strength ?? 1, settings.support ?? null);
  rbfCheckPoints(points);
  // The same for all stages: that of the points as dragged, at full strength.
  const support = rbfSupport(points, settings);
  const dragged = draggedPoints(points, settings.strength ?? 1);
  const stages = Array.from({ length: count }, (_, k) => stageFit(partOfWay(dragged, k + 1, count), parts,
    { ...settings, strength: 1, support, previous: null }, k + 1, count));
  const united = (name) => [...new Set(stages.flatMap((fit) => fit[name] ?? []))];
  return { ...stages[count - 1], stages, count: stages.reduce((sum, fit) => sum + fit.count, 0), notes: united("notes"),
    doubts: united("doubts") };
}

function checkStages(count, parts) {
  if (!Number.isInteger(count) || count < 1 || count > MOST_STAGES) {
    throw new RbfError(`the stages of a step must be a whole number from 1 to ${MOST_STAGES}, got ${count}.`);
  }
  const moving = (parts ?? []).find((part) => part.enabled !== false && (part.motion ?? null) !== null);
  if (moving) {
    throw new RbfError(`${partLabel(moving)} has a motion of its own, which is not done in stages; hold it still, switch ` +
      "it off, or set the stages of the step back to 1.");
  }
}

function partOfWay(points, j, count) {
  return points.map((p) => {
    const way = (t) => p.source.map((value, k) => value + t * (p.target[k] - value));
    return { ...p, source: way((j - 1) / count), target: j === count ? p.target : way(j / count) };
  });
}

function stageFit(points, parts, settings, j, count) {
  try {
    return rigidFit(points, parts, settings);
  } catch (error) {
    if (!(error instanceof RbfError)) throw error;
    throw new RbfError(`in stage ${j} of ${count}, on the straight ways of the points: ${error.message}`);
  }
}

// ---- evaluation -----------------------------------------------------------------------------------------------------

function stagedAt({ stages }, a, b) {
  let x = a, y = b;
  for (let k = stages.length - 1; k >= 0; k--) {
    const [da, db] = fieldAt(stages[k], x, y);
    x += da;
    y += db;
  }
  return [x - a, y - b];
}

function stagedOnRaster({ stages }, raster, map) {
  const [nv, nu] = raster.shape, [du, dv] = raster.spacing, [a0, b0] = raster.origin, before = { stages: stages.slice(0, -1) };
  fieldOnRaster(stages[stages.length - 1], raster, map); // row by row, as far as its kernel reaches
  for (let i = 0, n = 0; i < nv; i++) {
    for (let j = 0; j < nu; j++, n += 2) {
      const [da, db] = stagedAt(before, a0 + j * du + map[n], b0 + i * dv + map[n + 1]);
      map[n] += da;
      map[n + 1] += db;
    }
  }
  return map;
}
