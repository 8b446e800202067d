// The map of the points of the editor in space, as far as the front end knows it: that of points alone. Cuts, rigid
// parts and fits forward are known to Python.

import { added, difference, scaled } from "../maths/camera.ts";
import { RBF_KERNELS, RbfError } from "../maths/rbf.ts";
import type { SpaceFits } from "../maths/space.ts";
import { type IsTissueAt, leastDetInSpace, sourceOfFits, tissueOfMask } from "../maths/space_folds.ts";
import { spaceFits } from "../maths/space_stages.ts";
import { settingsOf } from "../sync/bus.ts";
import type { FitSettings, SpaceMask, SpacePoint, Vector3 } from "../types.ts";
import type { SpaceParts } from "./parts.ts";

const KNOWN_FITS = 4; // those that are shown and checked during a movement
const WORK = 6e4; // evaluations of a kernel for the lattice of one check of folds

export class SpaceMap {
  #made: { points: SpacePoint[]; settings: FitSettings; fits: SpaceFits | null; error: RbfError | null }[] = [];
  #mask: { data: SpaceMask; isTissue: IsTissueAt } | null = null;

  constructor(readonly editor: SpaceParts<"model" | "points" | "cursor">) {}

  get settings(): FitSettings {
    return settingsOf(this.editor.model);
  }

  /** Whether the map is that of the points alone. */
  get isKnown() {
    return this.editor.model.get("tissue") !== null && this.settings.direction !== "forward";
  }

  /** The fits of the points that are shown; null where it is not known, or nothing moves. */
  get currentFits(): SpaceFits | null {
    const { model, points } = this.editor;
    if (!this.isKnown || model.get("shows_original") || !points.list.some((p) => p.active)) return null;
    try {
      return this.fitsOf(points.list);
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      return null; // Python reports why
    }
  }

  /**
   * The fits of points with the settings of the step, or with others.
   * @throws {RbfError} where there are none
   */
  fitsOf(points: SpacePoint[], change: Partial<FitSettings> = {}): SpaceFits {
    const settings: FitSettings = { ...this.settings, ...change },
      names = Object.keys(settings) as (keyof FitSettings)[];
    let made = this.#made.find(
      (one) => one.points === points && names.every((name) => one.settings[name] === settings[name]),
    );
    if (!made) {
      made = { points, settings, fits: null, error: null };
      try {
        made.fits = spaceFits(points, { ...settings, previous: this.#made[0]?.fits?.[0] ?? null });
      } catch (error) {
        if (!(error instanceof RbfError)) throw error;
        made.error = error;
      }
      this.#made = [made, ...this.#made.slice(0, KNOWN_FITS - 1)];
    }
    if (!made.fits) throw made.error;
    return made.fits;
  }

  /** The reach of a point; 0 where that is not known. */
  get reach() {
    const fit = this.currentFits?.at(-1);
    if (!fit?.count) return 0;
    const { order } = RBF_KERNELS[fit.kernel]!; // as on a picture
    return order >= 2 || fit.kernel === "linear" ? 0 : fit.support;
  }

  /** The source of a point at a place that moves nothing. As drags are magnified by the strength, its displacement is not. */
  sourceOf(points: SpacePoint[]): (target: Vector3) => Vector3 {
    const fits = points.some((p) => p.active) ? this.fitsOf(points) : [],
      strength = this.settings.strength || 1;
    return (target) => added(target, scaled(difference(sourceOfFits(fits, target), target), 1 / strength));
  }

  /** A test whether tissue is at a place of the volume as it was. */
  get isTissue(): IsTissueAt {
    const data: Partial<SpaceMask> = this.editor.model.get("tissue") ?? {};
    if (!data.bits) return () => true;
    if (this.#mask?.data !== data) this.#mask = { data: data as SpaceMask, isTissue: tissueOfMask(data as SpaceMask) };
    return this.#mask.isTissue;
  }

  /** The smallest det J of points where there is tissue; minus infinity where they cannot be fitted. */
  leastOf(points: SpacePoint[], change: Partial<FitSettings> = {}) {
    try {
      return leastDetInSpace(this.fitsOf(points, change), this.editor.cursor.panes[0]!, this.isTissue, WORK);
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      return -Infinity;
    }
  }
}
