// The map of the points of the editor in space, as far as the front end knows it: that of points alone. Cuts, rigid
// parts, stages and fits forward are known to Python.

import { RbfError, rbfFit } from "../maths/rbf.ts";
import { type IsTissueAt, leastDetInSpace, tissueOfMask } from "../maths/space_folds.ts";
import { settingsOf } from "../sync/bus.ts";
import type { FitSettings, RbfFit, SpaceMask, SpacePoint } from "../types.ts";
import type { SpaceParts } from "./parts.ts";

const KNOWN_FITS = 4; // those that are shown and checked during a movement
const WORK = 6e4; // evaluations of a kernel for the lattice of one check of folds

export class SpaceMap {
  #made: { points: SpacePoint[]; settings: FitSettings; fit: RbfFit | null; error: RbfError | null }[] = [];
  #mask: { data: SpaceMask; isTissue: IsTissueAt } | null = null;

  constructor(readonly editor: SpaceParts<"model" | "points" | "cursor">) {}

  get settings(): FitSettings {
    return settingsOf(this.editor.model);
  }

  /** Whether the map is that of the points alone. */
  get isKnown() {
    const { stages, direction } = this.settings;
    return this.editor.model.get("tissue") !== null && !(stages! > 1) && direction !== "forward";
  }

  /** The fit of the points that are shown; null where it is not known, or nothing moves. */
  get currentFit(): RbfFit | null {
    const { model, points } = this.editor;
    if (!this.isKnown || model.get("shows_original") || !points.list.some((p) => p.active)) return null;
    try {
      return this.fitOf(points.list);
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      return null; // Python reports why
    }
  }

  /**
   * The fit of points with the settings of the step, or with others.
   * @throws {RbfError} where there is none
   */
  fitOf(points: SpacePoint[], change: Partial<FitSettings> = {}): RbfFit {
    const settings: FitSettings = { ...this.settings, ...change },
      names = Object.keys(settings) as (keyof FitSettings)[];
    let made = this.#made.find(
      (one) => one.points === points && names.every((name) => one.settings[name] === settings[name]),
    );
    if (!made) {
      made = { points, settings, fit: null, error: null };
      try {
        made.fit = rbfFit(points, { ...settings, previous: this.#made[0]?.fit ?? null }, 3);
      } catch (error) {
        if (!(error instanceof RbfError)) throw error;
        made.error = error;
      }
      this.#made = [made, ...this.#made.slice(0, KNOWN_FITS - 1)];
    }
    if (!made.fit) throw made.error;
    return made.fit;
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
      return leastDetInSpace(this.fitOf(points, change), this.editor.cursor.panes[0]!, this.isTissue, WORK);
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      return -Infinity;
    }
  }
}
