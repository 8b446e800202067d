// The part of a value axis that is seen, and values that are stretched from one window to another. Pure functions; no DOM.

const FINEST = 1 / 500; // share of the whole axis that is seen at most enlarged
const WHEEL_STEP = 0.0022; // of the logarithm of the scale, for a pixel of the wheel

// [low, high] with a value kept where it is, within the whole axis; null where all of it is seen.
function zoomedAxis([low, high], [first, last], factor, at) {
  const span = last - first, width = Math.max(FINEST * span, (high - low) / factor);
  if (width >= span * (1 - 1e-9)) return null;
  return keptInside([at - (at - low) * width / (high - low), width], [first, last]);
}

// The axis moved along, within the whole axis.
function pannedAxis([low, high], whole, by) { return keptInside([low + by, high - low], whole); }

function keptInside([low, width], [first, last]) {
  const from = Math.max(first, Math.min(last - width, low));
  return [from, from + width];
}

// As TransferFunction.windowed does: both ends are met exactly.
function stretchedValue(value, [first, last], [low, high]) {
  return value === last ? high : Math.min(high, low + (value - first) / (last - first) * (high - low));
}

function windowOf(nodes, stops) {
  const values = [...nodes, ...stops].map(([value]) => value);
  return [Math.min(...values), Math.max(...values)];
}

// What a drag of one end ("low", "high") or of the whole ("level") makes of a window: at least this wide, within limits.
function movedWindow([low, high], part, by, least, [first, last]) {
  if (part === "low") return [Math.max(Math.min(first, low), Math.min(high - least, low + by)), high];
  if (part === "high") return [low, Math.min(Math.max(last, high), Math.max(low + least, high + by))];
  const shift = Math.max(Math.min(first - low, 0), Math.min(Math.max(last - high, 0), by));
  return [low + shift, high + shift];
}
