// The map that the points and shapes of a view are fitted by, and its folds.

import { layeredFit, placeOf } from "../maths/cuts.ts";
import { foldsOf, probesOf } from "../maths/folds.ts";
import { samePoints } from "../maths/points.ts";
import { RBF_KERNELS, RbfError } from "../maths/rbf.ts";
import { maskPixels } from "../maths/regions.ts";
import { publishPoints, settingsOf } from "../sync/bus.ts";
import type { FitSettings, LayeredFit, MaskData, PicturePoint, Vector, Vector2 } from "../types.ts";
import type { PictureSource } from "./painter.ts";
import type { EditorParts } from "./parts.ts";

/** isRough: found while something moved. */
export type Folds = ReturnType<typeof foldsOf> & { probes: ReturnType<typeof probesOf>; isRough: boolean };

const KNOWN_FITS = 6; // those of the checks of one movement that a fold stops

/** Dependencies of the map on the editor. */
export type MapEditor = EditorParts<"model" | "bus" | "frames" | "points" | "picture" | "viewport">;

export class EditedMap {
  origin = Math.random().toString(36).slice(2); // of the points that are published: this view

  isDirty = true; // whether the points are to be fitted again

  isFollowing = false; // whether another view has published the points

  error = ""; // the reason why the points cannot be fitted

  /** The last fits, and their input: a stopped drag shows one that was made before the last. */
  #made: { points: PicturePoint[]; settings: FitSettings; layered: LayeredFit }[] = [];

  /** The last good fit that is shown. */
  layered: LayeredFit | null = null;

  folds: Folds | null = null;

  #mask: Silhouette | null = null;

  constructor(readonly editor: MapEditor) {}

  /** @returns of a fit, with the shapes as they are during a drag */
  get settings(): FitSettings {
    return { ...settingsOf(this.editor.model), ...this.editor.points.shapes };
  }

  get strength(): number {
    return this.settings.strength ?? 1;
  }

  /** The fit where there are no cuts, for tests and for debugging. */
  get fit() {
    return this.layered?.fit ?? null;
  }

  /**
   * The map under which a place of the view is seen; null where that is the original.
   * @param at CSS pixels
   */
  fitAt([x]: number[]) {
    const { picture, viewport } = this.editor;
    return picture.isOriginal || x! < picture.original.share * viewport.view.width ? null : this.layered;
  }

  /**
   * A function of places of the picture: the source of a point there that moves nothing, null in a gap. As drags are
   * magnified by the strength, a feature must come from target + D / strength to be seen at the target.
   */
  sourcesOf(layered: LayeredFit | null): (target: Vector) => Vector2 | null {
    const strength = this.strength || 1;
    return (target) => {
      const [da, db, opacity] = layered ? placeOf(layered, target[0], target[1], 1e-9) : ([0, 0, 1] as const);
      return opacity < 0.5 ? null : [target[0] + da / strength, target[1] + db / strength];
    };
  }

  /** The place of the original picture that is visible at a place, null in a gap. */
  visiblePlace([a, b]: Vector2): Vector2 | null {
    const layered = this.editor.picture.isComparing ? null : this.layered;
    const [da, db, opacity] = layered ? placeOf(layered, a, b, 1e-9) : ([0, 0, 1] as const);
    return opacity < 0.5 ? null : [a + da, b + db];
  }

  /** Mark the fit as stale: points or settings have changed. */
  invalidate(isMoving = false) {
    this.isDirty = true;
    if (isMoving) this.editor.frames.markMoving();
    else this.editor.frames.invalidate();
  }

  /**
   * The fit of points, and of shapes, with the present settings; the cached one if its input is the same. So a drag
   * that a check of folds let pass, and its drop, are fitted once.
   * @throws {RbfError} where there is none
   */
  fitOf(points: PicturePoint[], shapes?: Partial<FitSettings>): LayeredFit {
    const settings: FitSettings = { ...this.settings, ...shapes };
    const known = this.#made.find((made) => {
      const names = Object.keys({ ...settings, ...made.settings }) as (keyof FitSettings)[];
      return names.every((name) => made.settings[name] === settings[name]) && samePoints(made.points, points);
    });
    if (known) return known.layered;
    const layered = layeredFit(points, { ...settings, previous: this.layered });
    this.#made = [{ points, settings, layered }, ...this.#made.slice(0, KNOWN_FITS - 1)];
    return layered;
  }

  /** Fit the points that are shown, and publish them with their fit. */
  refit() {
    const { bus, points } = this.editor,
      { settings } = this;
    this.isDirty = false;
    try {
      this.layered = this.fitOf(points.list);
      this.error = "";
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      this.error = error.message; // the last good picture stays
    }
    this.folds = null; // of these points, computed once more when they rest
    const layered = this.error ? null : this.layered;
    if (!this.isFollowing) {
      publishPoints(bus, {
        origin: this.origin,
        points: points.list,
        settings,
        fit: layered?.fit ?? null,
        layered,
        phase: points.isDragging ? "move" : "end",
      });
    }
    this.isFollowing = false;
  }

  /** The reach of a point in units of the picture; 0 where that is not known. */
  get reach() {
    const fit = this.layered?.fits.map((one) => one.fit).find((one) => one.count > 0);
    if (!fit) return 0;
    const { order } = RBF_KERNELS[fit.kernel]!; // with cuts, every region has its own reach: this is the first one's
    return order >= 2 || fit.kernel === "linear" ? 0 : fit.support; // those kernels have no radius
  }

  // ---- folds --------------------------------------------------------------------------------------------------------

  /**
   * Find the folds of the map, if they are not known; only at rest as finely as the status line reports them.
   * @param known at the nodes of the picture while something moves
   */
  findFolds(known: LayeredFit | null) {
    const { layered, folds } = this,
      { isMoving } = this.editor.frames;
    const isDue = !folds || (folds.isRough && !isMoving);
    if (layered && isDue) this.folds = this.#measureFolds(known ?? layered);
  }

  #measureFolds(known: LayeredFit) {
    const { isMoving } = this.editor.frames,
      probes = probesOf(known, isMoving ? 5e4 : 4e5);
    const nodes = known.count > 200 ? 9 : isMoving ? 17 : 33;
    return {
      ...foldsOf(known, this.editor.picture.box, nodes, probes, this.tissueTest(known)),
      probes,
      isRough: isMoving,
    };
  }

  /** The mask of tissue at any depth, null where Python has sent none. */
  get #silhouette() {
    const data: Partial<MaskData> = this.editor.model.get("tissue") ?? {};
    if (!data.bits) return null;
    if (this.#mask?.data !== data) this.#mask = { data: data as MaskData, pixels: maskPixels(data as MaskData) };
    return this.#mask;
  }

  /** A test whether tissue is there at a place, at any depth where that is known, else seen there; undefined where the picture does not show it. */
  tissueTest(layered: LayeredFit) {
    const { source } = this.editor.picture.painter,
      air = this.editor.model.get("air"),
      silhouette = this.#silhouette;
    if (silhouette) return silhouetteTest(layered, silhouette);
    return source?.grey && typeof air === "number" ? tissueTest(layered, source, air) : undefined;
  }
}

type Silhouette = { data: MaskData; pixels: Uint8Array };

/** Whether tissue of any depth is at a place, there or within a pixel of the mask, which is coarser than the picture. */
function silhouetteTest(
  layered: LayeredFit,
  {
    data: {
      shape: [nv, nu],
      spacing: [du, dv],
      origin: [a0, b0],
    },
    pixels,
  }: Silhouette,
) {
  const steps = [-1, 0, 1];
  return (a: number, b: number) => {
    const [da, db] = placeOf(layered, a, b, du),
      j = Math.round((a + da - a0) / du),
      i = Math.round((b + db - b0) / dv);
    return steps.some((p) =>
      steps.some((q) => i + p >= 0 && i + p < nv && j + q >= 0 && j + q < nu && pixels[(i + p) * nu + j + q] === 1),
    );
  };
}

/**
 * Whether the body is seen at a place, there or within two pixels.
 * @param air the value of the picture up to which nothing is seen
 */
function tissueTest(layered: LayeredFit, source: PictureSource, air: number) {
  const {
      spacing: [du, dv],
    } = source.raster,
    steps = [-2, 0, 2];
  return (a: number, b: number) => {
    const [da, db] = placeOf(layered, a, b, du);
    return steps.some((i) => steps.some((j) => source.isBody([a + da + j * du, b + db + i * dv], air)));
  };
}
