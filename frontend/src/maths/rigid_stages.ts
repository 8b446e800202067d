// Fits with rigid parts and in stages, equal to deformnb.rbf.rigid (Eq. 6) and deformnb.rbf.stages in the plane, and
// the evaluation of any fit, also of those that are blended at the tips of cuts as deformnb.rbf.slits does.

import { MOST_STAGES, SAME_MOTION } from "../generated.ts";
import type {
  Fit,
  FitSettings,
  Motion,
  Numbers2,
  Numbers3,
  PartData,
  PicturePoint,
  Point,
  Raster,
  ReadyPart,
  TipBlend,
  Vector,
  Vector2,
  Vector3,
} from "../types.ts";
import { exchangePoints, forwardAt, forwardFit, forwardOnRaster } from "./forward_fit.ts";
import { numberPoints } from "./point_names.ts";
import { placeBetween } from "./points.ts";
import {
  RbfError,
  rbfAt,
  rbfCheckPoints,
  rbfCheckSettings,
  rbfFit,
  rbfKernelOf,
  rbfLabel,
  rbfOnRaster,
  rbfSupport,
} from "./rbf.ts";
import { regionDistance } from "./regions.ts";
import { sampledAt, sampledOnRaster } from "./sampled_fit.ts";
import { movePlace } from "./shapes.ts";

// ---- fits with rigid parts ------------------------------------------------------------------------------------------

const RIGID_WEIGHTS: Record<string, (value: number) => number> = {
  saturated: (value) => {
    const t = Math.max(0, Math.min(1, value));
    return t * t * t * (t * (6 * t - 15) + 10);
  },
  distance: (value) => Math.max(0, value),
};

export function partLabel(part: PartData) {
  return part.name ? `the rigid part "${part.name}"` : "a rigid part";
}

/** A motion done t times along one screw, backward: from where tissue is to where it was. */
function backwardMotion(motion: Motion, t: number): ReadyPart["back"] {
  if (!motion) return { m: [1, 0, 0, 1], s: [0, 0], isStill: true };
  const path: (angle: number) => Vector2 = (angle) =>
    Math.abs(angle) < 1e-4
      ? [1 - (angle * angle) / 6, angle / 2]
      : [Math.sin(angle) / angle, (1 - Math.cos(angle)) / angle];
  const [[c, minus], [s]] = motion.matrix,
    turn = Math.atan2((s - minus) / 2, c);
  let shift = motion.shift,
    angle = turn;
  if (t !== 1) {
    const [p, q] = path(turn),
      size = p * p + q * q,
      [x, y] = shift;
    const rate: Vector2 = [(t * (p * x + q * y)) / size, (t * (p * y - q * x)) / size],
      [u, v] = path(t * turn);
    angle = t * turn;
    shift = [u * rate[0] - v * rate[1], v * rate[0] + u * rate[1]];
  }
  const e = Math.cos(angle),
    f = Math.sin(angle);
  return { m: [e, f, -f, e], s: [-e * shift[0] - f * shift[1], f * shift[0] - e * shift[1]], isStill: false };
}

/**
 * The motion L - id of a set of parts at a place, and the weight w of the smooth displacement. `out` gets [da, db, w].
 */
export function partsAt(rigid: ReadyPart[], a: number, b: number, out: Numbers3 | Vector3): Numbers3 | Vector3 {
  const { length } = rigid;
  let w = 1,
    least = Infinity;
  for (const part of rigid) {
    const { m, s } = part.back;
    part.pa = part.back.isStill ? a : m[0] * a + m[1] * b + s[0];
    part.pb = part.back.isStill ? b : m[2] * a + m[3] * b + s[1];
    part.d = Math.max(0, part.distance(part.pa, part.pb));
    w *= part.step(part.d / part.scale);
    least = Math.min(least, part.d);
  }
  out[2] = w;
  if (length === 1) {
    out[0] = rigid[0]!.pa - a;
    out[1] = rigid[0]!.pb - b;
    return out;
  }
  let total = 0,
    da = 0,
    db = 0;
  for (const part of rigid) {
    const share = part.d > least ? (least / part.d) ** 2 : 1;
    total += share;
    da += share * (part.pa - a);
    db += share * (part.pb - b);
  }
  out[0] = da / total;
  out[1] = db / total;
  return out;
}

function readyParts(parts: PartData[] | undefined, strength: number): ReadyPart[] {
  return (parts ?? [])
    .filter((part) => part.enabled !== false)
    .map((part) => ({
      part,
      scale: 1,
      back: backwardMotion(part.motion ?? null, strength),
      distance: regionDistance(part.region),
      step: RIGID_WEIGHTS[part.weight ?? "saturated"]!,
      pa: 0,
      pb: 0,
      d: 0,
    }));
}

/** Scale the displacements by the strength; points that a part carries follow its scaled motion. */
function scaleDisplacements(points: Point[], strength: number, parts: PartData[] = []) {
  if (strength === 1) return points;
  const turning = parts.filter((part) => part.motion),
    near = turning.length ? SAME_MOTION * sizeOf(points) : 0;
  const whole = readyParts(turning, 1),
    scaled = readyParts(turning, strength);
  return points.map((p) => {
    const k = p.active === false ? -1 : whole.findLastIndex((part) => isCarried(part, p, near));
    return {
      ...p,
      target: k >= 0 ? forward(scaled[k]!, p.source) : placeBetween(p.source, p.target, strength),
    };
  });
}

/** The image of a place under a part's motion. */
function forward({ back: { m, s } }: ReadyPart, [a, b]: Vector): Vector2 {
  const x = a - s[0],
    y = b - s[1];
  return [m[0] * x + m[2] * y, m[1] * x + m[3] * y];
}

/** Whether a part maps a point's source to its target. */
function isCarried(part: ReadyPart, point: Point, near: number) {
  const { isIn, gap } = pointInPart(part, point);
  return isIn && gap <= near;
}

/** The points in a part that require another displacement than the part's. */
export function findConflicts(points: Point[], parts: PartData[], strength: number = 1) {
  const ready = readyParts(parts, strength);
  return ready.length ? partitionPoints(scaleDisplacements(points, strength, parts), ready).refused : [];
}

/**
 * The points after a change of a part's motion: those that it carried, the active points in it that
 * require its displacement, follow it.
 */
export function carryPoints(points: PicturePoint[], before: PartData, after: PartData) {
  const [ready] = readyParts([before], 1),
    near = SAME_MOTION * sizeOf(points);
  if (!ready) return points;
  return points.map((p) =>
    p.active !== false && isCarried(ready, p, near) ? { ...p, target: movePlace(after.motion, p.source) } : p,
  );
}

/** The diagonal of the box of all sources and targets; 0 without points. */
function sizeOf(points: Point[]) {
  const all = points.flatMap((p) => [p.source, p.target]);
  return points.length
    ? Math.hypot(
        ...[0, 1].map((k) => {
          let low = Infinity,
            high = -Infinity;
          for (const p of all) {
            low = Math.min(low, p[k]!);
            high = Math.max(high, p[k]!);
          }
          return high - low;
        }),
      )
    : 0;
}

/** Whether a point is in a part, and the distance of its displacement from the part's. */
function pointInPart({ back: { m, s }, distance }: ReadyPart, { source, target: [a, b] }: Point) {
  const x = m[0] * a + m[1] * b + s[0],
    y = m[2] * a + m[3] * b + s[1];
  return { isIn: distance(x, y) <= 0, gap: Math.hypot(source[0] - x, source[1] - y) };
}

/** The active points outside all parts, notes on those that a part holds already, and the conflicting points. */
function partitionPoints(points: Point[], ready: ReadyPart[]) {
  const free: Point[] = [];
  const notes: string[] = [];
  const refused: { point: Point; part: PartData }[] = [];
  const size = sizeOf(points);
  for (const p of points) {
    if (p.active === false) continue;
    const holders = ready.map((r) => ({ r, ...pointInPart(r, p) })).filter(({ isIn }) => isIn);
    const other = holders.find(({ gap }) => gap > SAME_MOTION * size);
    if (other) refused.push({ point: p, part: other.r.part });
    else if (!holders.length) {
      free.push(p);
      const torn = ready.find((r) => r.distance(p.source[0], p.source[1]) < 0);
      if (torn) {
        notes.push(
          `${rbfLabel(p)} is dragged in ${partLabel(torn.part)}, which does not follow: its tissue is seen twice`,
        );
      }
    } else if (p.source.some((v, k) => v !== p.target[k])) {
      notes.push(`${rbfLabel(p)} is in ${partLabel(holders[0]!.r.part)}, which holds it already`);
    }
  }
  return { free, notes, refused };
}

/** The fit of control points with rigid parts; without parts as rbfFit. */
export function rigidFit(
  given: Point[],
  parts: PartData[] | undefined,
  settings: FitSettings & { previous?: Fit | null } = {},
): Fit {
  const points = numberPoints(given);
  const strength = settings.strength ?? 1,
    ready = readyParts(parts, strength);
  if (!ready.length) return rbfFit(points, settings);
  rbfCheckSettings(
    rbfKernelOf(settings),
    settings.trend ?? "affine",
    settings.smoothing ?? 0,
    strength,
    settings.support ?? null,
  );
  rbfCheckPoints(points);
  const { free, notes, refused } = partitionPoints(scaleDisplacements(points, strength, parts), ready),
    out: Vector3 = [0, 0, 1];
  const [first] = refused;
  if (first) {
    const { point, part } = first;
    const held = part.motion ? "has its own motion" : "is fixed";
    throw new RbfError(
      `${rbfLabel(point)} is in ${partLabel(part)}, which ${held}; move or remove the point, or change the part.`,
    );
  }
  for (const r of ready) r.scale = partScale(r, free);
  const required = free.map((p): Point => {
    const [x, y] = p.target,
      { 0: da, 1: db, 2: w } = partsAt(ready, x, y, out);
    return {
      ...p,
      source: [x + (p.source[0] - x - da) / w, y + (p.source[1] - y - db) / w],
      weight: (p.weight ?? 1) * w * w,
    };
  });
  const isRaw = ready.some(({ part }) => part.weight === "distance");
  const base = rbfFit(required, {
    ...settings,
    strength: 1,
    trend: isRaw ? "none" : (settings.trend ?? "affine"),
    support: rbfSupport(points, settings),
    previous: settings.previous?.base ?? settings.previous ?? null,
  });
  return { ...base, base, rigid: ready, notes: [...notes, ...base.notes] };
}

/**
 * The distance at which a part's weight is 1: the nearest control point's at the latest. The plain distance has none.
 */
function partScale({ part, back: { m, s }, distance }: ReadyPart, free: Point[]) {
  const found = free.map(({ target: [a, b] }) => distance(m[0] * a + m[1] * b + s[0], m[2] * a + m[3] * b + s[1]));
  if (part.weight === "distance") return Math.max(0, ...found) || 1;
  const scale = Math.min(part.reach || Infinity, ...found);
  return Number.isFinite(scale) ? scale : 1;
}

// ---- evaluation of any fit ------------------------------------------------------------------------------------------

const PARTS_WORK: Vector3 = [0, 0, 0];

/** Whether a fit displaces nothing at all. */
export function isStill(fit: Fit): boolean {
  if (fit.blend) return fit.blend.fits.every((one) => !one || isStill(one));
  if (fit.stages) return fit.stages.every(isStill);
  if (fit.rigid && !fit.rigid.every(({ back }) => back.isStill)) return false;
  const { count, coefficients, linear, constant, quadratic } = fit.base ?? fit;
  return (
    count === 0 ||
    (coefficients.every((v) => v === 0) &&
      constant.every((v) => v === 0) &&
      !quadratic &&
      linear.every((row) => row.every((v) => v === 0)))
  );
}

/** The backward displacement at a place, of any fit. */
export function fieldAt(fit: Fit, a: number, b: number): Vector2 {
  if (fit.sampled) return sampledAt(fit.sampled, a, b) ?? fieldAt(fit.sampled.fit, a, b);
  if (fit.blend) return blendAt(fit.blend, a, b);
  if (fit.stages) return stagedAt(fit.stages, a, b);
  if (fit.forward) return forwardAt(fit.forward, a, b);
  const { base, rigid } = fit;
  if (!base || !rigid) return rbfAt(fit, a, b);
  const { 0: da, 1: db, 2: w } = partsAt(rigid, a, b, PARTS_WORK);
  if (w === 0) return [da, db];
  const [u, v] = rbfAt(base, a, b);
  return [da + w * u, db + w * v];
}

/** The displacements at the pixels of a raster, of any fit, as of rbfOnRaster. */
export function fieldOnRaster(fit: Fit, raster: Raster, out: Float32Array | null = null): Float32Array {
  const [nv, nu] = raster.shape,
    map = out ?? new Float32Array(nv * nu * 2),
    plain = fit.base ?? fit;
  const { sampled } = fit;
  if (sampled) return sampledOnRaster(sampled, raster, map, (a, b) => fieldAt(sampled.fit, a, b));
  if (fit.blend) return blendOnRaster(fit.blend, raster, map);
  if (fit.stages) return stagedOnRaster(fit.stages, raster, map);
  if (fit.forward) return forwardOnRaster(fit.forward, raster, map);
  if (fit.rigid && plain.count === 0) map.fill(0, 0, nv * nu * 2);
  else rbfOnRaster(plain, raster, map);
  if (!fit.rigid) return map;
  const [du, dv] = raster.spacing,
    [a0, b0] = raster.origin,
    parts = PARTS_WORK;
  for (let i = 0, n = 0; i < nv; i++) {
    for (let j = 0; j < nu; j++, n += 2) {
      partsAt(fit.rigid, a0 + j * du, b0 + i * dv, parts);
      map[n] = parts[0] + parts[2] * map[n]!;
      map[n + 1] = parts[1] + parts[2] * map[n + 1]!;
    }
  }
  return map;
}

// ---- fits in stages -------------------------------------------------------------------------------------------------
// The points move from source to target in equal parts, and the maps are composed: a place of the result is looked
// up in the last stage first.

/** The fit of control points in `settings.stages` stages; with one as rigidFit. */
export function stagedFit(
  points: Point[],
  parts: PartData[] | undefined,
  settings: FitSettings & { previous?: Fit | null } = {},
): Fit {
  const count = settings.stages ?? 1;
  checkDirection(settings.direction ?? "backward", parts);
  if (count === 1) return directedFit(points, parts, settings);
  checkStages(count, parts);
  rbfCheckSettings(
    rbfKernelOf(settings),
    settings.trend ?? "affine",
    settings.smoothing ?? 0,
    settings.strength ?? 1,
    settings.support ?? null,
  );
  rbfCheckPoints(points);
  // The same for all stages: that of the points as dragged, at full strength.
  const support = rbfSupport(settings.direction === "forward" ? exchangePoints(points) : points, settings);
  const dragged = scaleDisplacements(points, settings.strength ?? 1);
  const stages = Array.from({ length: count }, (_, k) =>
    stageFit(
      stagePoints(dragged, k + 1, count),
      parts,
      { ...settings, strength: 1, support, previous: null },
      k + 1,
      count,
    ),
  );
  return {
    ...stages.at(-1)!,
    stages,
    count: stages.reduce((sum, fit) => sum + fit.count, 0),
    notes: [...new Set(stages.flatMap((fit) => fit.notes))],
  };
}

/** The fit in the direction of the settings, in one stage. */
function directedFit(
  points: Point[],
  parts: PartData[] | undefined,
  settings: FitSettings & { previous?: Fit | null },
) {
  return settings.direction === "forward" ? forwardFit(points, settings) : rigidFit(points, parts, settings);
}

function checkDirection(direction: string, parts: PartData[] | undefined) {
  if (direction !== "backward" && direction !== "forward") {
    throw new RbfError(`unknown direction '${direction}' of a fit; choose one of backward, forward.`);
  }
  const part = direction === "forward" ? (parts ?? []).find((one) => one.enabled !== false) : null;
  if (part) {
    throw new RbfError(
      `${partLabel(part)} cannot be held with a fit forward; set the direction of the step to ` +
        "backward, or switch the part off.",
    );
  }
}

function checkStages(count: number, parts: PartData[] | undefined) {
  if (!Number.isInteger(count) || count < 1 || count > MOST_STAGES) {
    throw new RbfError(`the stages of a step must be a whole number from 1 to ${MOST_STAGES}, got ${count}.`);
  }
  const moving = (parts ?? []).find((part) => part.enabled !== false && (part.motion ?? null) !== null);
  if (moving) {
    throw new RbfError(
      `${partLabel(moving)} has its own motion, which is not done in stages; hold it still, ` +
        "switch it off, or set the stages of the step back to 1.",
    );
  }
}

/** The points of stage j, from 1. */
export function stagePoints<V extends Vector>(points: Point<V>[], j: number, count: number) {
  return points.map((p) => {
    const way = (t: number) => placeBetween(p.source, p.target, t);
    return { ...p, source: way((j - 1) / count), target: j === count ? p.target : way(j / count) };
  });
}

/** The fit of stage j, with its number in error messages. */
function stageFit(
  points: Point[],
  parts: PartData[] | undefined,
  settings: FitSettings & { previous?: Fit | null },
  j: number,
  count: number,
) {
  try {
    return directedFit(points, parts, settings);
  } catch (error) {
    if (!(error instanceof RbfError)) throw error;
    throw new RbfError(`in stage ${j} of ${count}, on the straight paths of the points: ${error.message}`);
  }
}

function stagedAt(stages: Fit[], a: number, b: number): Vector2 {
  let x = a,
    y = b;
  for (let k = stages.length - 1; k >= 0; k--) {
    const [da, db] = fieldAt(stages[k]!, x, y);
    x += da;
    y += db;
  }
  return [x - a, y - b];
}

function stagedOnRaster(stages: Fit[], raster: Raster, map: Float32Array) {
  const [nv, nu] = raster.shape,
    [du, dv] = raster.spacing,
    [a0, b0] = raster.origin,
    before = stages.slice(0, -1);
  fieldOnRaster(stages[stages.length - 1]!, raster, map); // row by row, as far as its kernel reaches
  for (let i = 0, n = 0; i < nv; i++) {
    for (let j = 0; j < nu; j++, n += 2) {
      const [da, db] = stagedAt(before, a0 + j * du + map[n]!, b0 + i * dv + map[n + 1]!);
      map[n]! += da;
      map[n + 1]! += db;
    }
  }
  return map;
}

// ---- fits blended at the tips of cuts that stop ---------------------------------------------------------------------

const TIP_MOVES = new Float64Array(16) as Numbers2,
  TIP_OPENING = new Float64Array(3) as Numbers3;

/** The moves of the fits of a blend, two numbers each, become one: the first two numbers. */
function blendMoves({ openings }: TipBlend, moves: Numbers2, a: number, b: number) {
  const x = a + moves[0],
    y = b + moves[1]; // where the tissue comes from without these cuts
  for (let k = openings.length - 1; k >= 0; k--) {
    const w = openings[k]!(x, y, TIP_OPENING)[0],
      half = 2 << k;
    for (let j = 0; j < half; j++) moves[j]! += w * (moves[j + half]! - moves[j]!);
  }
}

function blendAt(blend: TipBlend, a: number, b: number): Vector2 {
  blend.fits.forEach((fit, k) => {
    TIP_MOVES.set(fit ? fieldAt(fit, a, b) : NO_WAY, 2 * k);
  });
  blendMoves(blend, TIP_MOVES, a, b);
  return [TIP_MOVES[0], TIP_MOVES[1]];
}

const NO_WAY: Vector2 = [0, 0];

/** Maps of the fits that several regions blend, while the same raster is sampled. */
const sharedMaps: WeakMap<Fit, { raster: Raster; map: Float32Array }> = new WeakMap();

function sharedMap(fit: Fit, raster: Raster, like: Float32Array) {
  const known = sharedMaps.get(fit),
    size = 2 * raster.shape[0] * raster.shape[1];
  if (known && known.raster === raster && known.map.constructor === like.constructor) return known.map;
  const map = fieldOnRaster(fit, raster, like.slice(0, size));
  sharedMaps.set(fit, { raster, map });
  return map;
}

function blendOnRaster(blend: TipBlend, raster: Raster, map: Float32Array) {
  const [nv, nu] = raster.shape,
    [du, dv] = raster.spacing,
    [a0, b0] = raster.origin;
  const maps = blend.fits.map((fit) => (fit ? sharedMap(fit, raster, map) : null)),
    v = TIP_MOVES;
  const count = maps.length;
  for (let i = 0, n = 0; i < nv; i++) {
    for (let j = 0; j < nu; j++, n += 2) {
      for (let k = 0; k < count; k++) {
        const one = maps[k];
        if (!one) {
          v[2 * k] = 0;
          v[2 * k + 1] = 0;
          continue;
        }
        v[2 * k] = one[n]!;
        v[2 * k + 1] = one[n + 1]!;
      }
      blendMoves(blend, v, a0 + j * du, b0 + i * dv);
      map[n] = v[0];
      map[n + 1] = v[1];
    }
  }
  return map;
}
