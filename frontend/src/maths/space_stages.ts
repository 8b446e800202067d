// Fits of points in space in stages, equal to deformnb.rbf.stages: the points move from source to target in equal parts.

import type { FitSettings, RbfFit, SpacePoint } from "../types.ts";
import { placeBetween } from "./points.ts";
import { rbfFit, rbfSupport } from "./rbf.ts";
import { stagePoints } from "./rigid_stages.ts";
import type { SpaceFits } from "./space.ts";

/**
 * The fits of the stages of the settings.
 * @throws {RbfError}
 */
export function spaceFits(points: SpacePoint[], settings: FitSettings & { previous?: RbfFit | null } = {}): SpaceFits {
  const count = settings.stages ?? 1;
  if (count === 1) return [rbfFit(points, settings, 3)];
  // The same for all stages: that of the points as dragged, at full strength.
  const support = rbfSupport(points, settings),
    strength = settings.strength ?? 1,
    dragged = points.map((p) => ({ ...p, target: placeBetween(p.source, p.target, strength) }));
  return Array.from({ length: count }, (_, k) =>
    rbfFit(stagePoints(dragged, k + 1, count), { ...settings, strength: 1, support, previous: null }, 3),
  );
}
