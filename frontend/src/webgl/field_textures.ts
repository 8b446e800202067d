// The displacement fields that a volume is deformed by, on the GPU.

import type { PlaneData } from "../generated.ts";
import { perAxis } from "../maths/axes.ts";
import { dot } from "../maths/camera.ts";
import type { Vector3 } from "../types.ts";
import { SpaceRanges } from "./empty_space.ts";
import { planarFolds, spaceFolds } from "./fold_mesh.ts";
import type { Gpu, Uniforms } from "./gpu.ts";
import { bitsOf } from "./region_bits.ts";
import type { CastPlanar, CastSpace, PlanarField, PlaneCut, SpaceField, ToTexture } from "./types.ts";
import { planarSlopes, spaceSlope } from "./volume_blocks.ts";

const FACE_VOXELS = 3; // a cut face is lit this deep, half on each side of it

/** The fields of one picture. */
export type CastFields = Pick<FieldTextures, "planar" | "space">;

/** From places in the volume's frame to texture coordinates over a plane. */
function toTextures({ origin, u, v, n }: PlaneData, starts: Vector3, lengths: Vector3): ToTexture {
  const axes = [u, v, n] as const,
    scale = perAxis((i) => (lengths[i] > 0 ? 1 / lengths[i] : 0));
  return {
    matrix: perAxis((j) => perAxis((i) => axes[i][j] * scale[i])),
    offset: perAxis((i) => (scale[i] ? (-dot(axes[i], origin) - starts[i]) * scale[i] : 0.5)),
  };
}

export class FieldTextures {
  planar: CastPlanar | null = null;
  space: CastSpace | null = null;
  #given: SpaceField | null = null; // the field that `space` was made of
  #distances: Float32Array | null = null; // of the cuts that the texture was made of

  constructor(readonly gpu: Gpu) {}

  /** True if the map folds somewhere. */
  get folds() {
    return Boolean(this.planar?.folds || this.space?.folds);
  }

  /** Take displacement maps over a plane, or null. */
  setPlanar(planar: PlanarField | null) {
    if (!planar) {
      this.planar = null;
      return;
    }
    const { gl } = this.gpu,
      { maps, shape, origin, spacing, weights, plane } = planar,
      [layers, rows, columns] = shape;
    const regions = planar.cut ? planar.cut.sides.length : 1,
      count = layers / regions,
      knots = weights.length / count;
    const [ofMaps, ofWeights] = this.gpu.smoothFloats ? ([gl.RG32F, gl.R32F] as const) : ([gl.RG16F, gl.R16F] as const);
    this.gpu.texture("maps", gl.TEXTURE_2D_ARRAY, true);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, ofMaps, columns, rows, layers, 0, gl.RG, gl.FLOAT, maps);
    this.gpu.texture("weights", gl.TEXTURE_2D, true);
    gl.texImage2D(gl.TEXTURE_2D, 0, ofWeights, knots, count, 0, gl.RED, gl.FLOAT, weights);
    const [c0, c1] = planar.depth;
    const lengths: Vector3 = [spacing[0] * columns, spacing[1] * rows, ((c1 - c0) * knots) / Math.max(1, knots - 1)];
    const starts: Vector3 = [
      origin[0] - spacing[0] / 2,
      origin[1] - spacing[1] / 2,
      c0 - (c1 - c0) / Math.max(1, knots - 1) / 2,
    ];
    this.planar = {
      ...planar,
      count,
      folds: planarFolds(planar, count, planarSlopes(maps, shape, spacing)),
      toMap: toTextures(plane, starts, lengths),
      cut: planar.cut && this.#castCut(planar.cut, plane),
    };
  }

  #castCut(cut: PlaneCut, plane: PlaneData): NonNullable<CastPlanar["cut"]> {
    const { gl } = this.gpu,
      { origin, distances } = cut,
      [count, rows, columns] = cut.shape,
      [da, db] = cut.spacing;
    const lengths: Vector3 = [columns * da, rows * db, 0];
    if (this.#distances !== distances) {
      // they change when a cut is drawn, not when points move
      this.#distances = distances;
      this.gpu.texture("distances", gl.TEXTURE_2D_ARRAY, true);
      gl.texImage3D(
        gl.TEXTURE_2D_ARRAY,
        0,
        this.gpu.smoothFloats ? gl.R32F : gl.R16F,
        columns,
        rows,
        count,
        0,
        gl.RED,
        gl.FLOAT,
        distances,
      );
    }
    return {
      ...cut,
      toCut: toTextures(plane, [origin[0] - da / 2, origin[1] - db / 2, 0], lengths),
      scale: [1 / lengths[0], 1 / lengths[1]],
      bits: cut.sides.map(bitsOf),
    };
  }

  /**
   * Take a displacement sampled in space, or null; the same one again costs nothing. Values are [z][y][x][3]. With a
   * cut they are numbers of half precision: values [region][z][y][x][4] with the depth of the place that the sample
   * leads to, and depths [region][z][y][x][2] with the depth of the sample and the share of it that is seen.
   */
  setSpace(given: SpaceField | null) {
    if (given === this.#given) return;
    this.#given = given;
    this.space = given && {
      ...given,
      ...this.#castSpace(given),
      ranges: new SpaceRanges(given),
      toSpace: perAxis((i) => 1 / (given.shape[i] * given.spacing[i])),
      toSpace0: perAxis((i) => (0.5 * given.spacing[i] - given.origin[i]) / (given.shape[i] * given.spacing[i])),
    };
  }

  #castSpace({ shape, spacing, values, depths, cut }: SpaceField) {
    const { gl } = this.gpu;
    this.gpu.texture("space", gl.TEXTURE_3D, true);
    if (cut) {
      const [nx, ny, nz] = shape,
        deep = nz * cut.regions; // one region behind the other
      gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGBA16F, nx, ny, deep, 0, gl.RGBA, gl.HALF_FLOAT, values);
      this.gpu.texture("depths", gl.TEXTURE_3D, true);
      gl.texImage3D(gl.TEXTURE_3D, 0, gl.RG16F, nx, ny, deep, 0, gl.RG, gl.HALF_FLOAT, depths ?? null);
      return { folds: cut.slope >= 1 }; // at least it may
    }
    const floats = values as Float32Array,
      padded = new Float32Array((floats.length / 3) * 4);
    for (let i = 0, j = 0; i < floats.length; i += 3, j += 4) {
      padded[j] = floats[i]!;
      padded[j + 1] = floats[i + 1]!;
      padded[j + 2] = floats[i + 2]!;
    }
    const kind = this.gpu.smoothFloats ? gl.RGBA32F : gl.RGBA16F;
    gl.texImage3D(gl.TEXTURE_3D, 0, kind, ...shape, 0, gl.RGBA, gl.FLOAT, padded);
    return { folds: spaceSlope(floats, shape, spacing) >= 1 && spaceFolds(floats, shape, spacing) };
  }

  /**
   * Set what the shader needs of fields.
   * @param spacing of the voxels
   */
  setNumbers(at: Uniforms, { planar, space }: CastFields, spacing: Vector3) {
    const { gl } = this.gpu,
      finest = Math.min(...spacing);
    const axes = planar ? planar.plane : { u: [1, 0, 0], v: [0, 1, 0], n: [0, 0, 1] };
    gl.uniform3fv(at("axisU"), axes.u);
    gl.uniform3fv(at("axisV"), axes.v);
    gl.uniform3fv(at("axisN"), axes.n);
    if (planar) {
      gl.uniform1i(at("mapCount"), planar.count);
      gl.uniformMatrix3fv(at("toMap"), false, planar.toMap.matrix.flat());
      gl.uniform3fv(at("toMap0"), planar.toMap.offset);
    }
    if (planar?.cut) this.#setCutNumbers(at, planar.cut);
    const needed = planar?.cut ? planar.softness : space?.cut?.softness;
    if (needed !== undefined) {
      const softness = Math.max(needed, finest);
      gl.uniform1f(at("softness"), softness);
      gl.uniform1f(at("faceWidth"), FACE_VOXELS * softness);
    }
    if (space?.cut) {
      gl.uniform1i(at("spaceRegions"), space.cut.regions);
      gl.uniform1f(at("spaceEdge"), 0.5 / space.shape[2]);
    }
    if (space) {
      gl.uniform3fv(at("toSpace"), space.toSpace);
      gl.uniform3fv(at("toSpace0"), space.toSpace0);
    }
    gl.uniform1f(
      at("slopeStep"),
      Math.max(finest, space ? Math.min(...space.spacing) / 2 : 0, planar ? Math.min(...planar.spacing) : 0),
    );
  }

  #setCutNumbers(at: Uniforms, cut: NonNullable<CastPlanar["cut"]>) {
    const { gl } = this.gpu;
    gl.uniformMatrix3fv(at("toCut"), false, cut.toCut.matrix.flat());
    gl.uniform3fv(at("toCut0"), cut.toCut.offset);
    gl.uniform2fv(at("cutScale"), cut.scale);
    gl.uniform1i(at("regionCount"), cut.bits.length);
    gl.uniform1iv(at("sides[0]"), cut.bits);
  }
}
