// The ray caster: textures and programs on one WebGL2 context, pictures of any part at any resolution.
// It has no widget and no pointer; all inputs are arrays and numbers.

import type { PlaneData } from "../generated.ts";
import { AMBIENT_CELL } from "../generated.ts";
import { perAxis } from "../maths/axes.ts";
import { dot } from "../maths/camera.ts";
import { type Clip, clipSides, leftOf } from "../maths/clipping.ts";
import type { Sides, Vector2, Vector3, Vector4 } from "../types.ts";
import { blockPairs, CELL, emptyCells, QUICK_CELL, SpaceRanges } from "./empty_space.ts";
import { planarFolds, spaceFolds } from "./fold_mesh.ts";
import { FRAGMENT, MERGE, PRESENT, SIDE_SAMPLES, SIDES, VERTEX } from "./ray_shader.ts";
import { bitsOf } from "./region_bits.ts";
import type {
  CastPlanar,
  CastSpace,
  CastVolume,
  ColorTable,
  Picture,
  PlanarField,
  PlaneCut,
  RayCamera,
  SpaceField,
  ToTexture,
  VolumeData,
} from "./types.ts";
import {
  ambientLight,
  blockExtremes,
  blockOpacities,
  GradientSlabs,
  OPACITY_SHARE,
  opacityOfByte,
  planarSlopes,
  STEEPEST,
  spaceSlope,
} from "./volume_blocks.ts";

/** The location of a program's uniform; null where the program has none of that name. */
export type Uniforms = (name: string) => WebGLUniformLocation | null;
export type Program = { program: WebGLProgram; at: Uniforms };
/**
 * A picture to draw into. `extent`: its pixels that are shown, which may be a fraction; `start`: where they begin.
 */
export type Target = {
  width: number;
  height: number;
  texture: WebGLTexture;
  buffer: WebGLFramebuffer;
  extent: Vector2;
  start: number;
};
/**
 * One of the four pictures that, pixel by pixel in turn, make a picture of half the stride: it has every stride-th pixel
 * along both axes, from x, y (0 or 1) times half the stride.
 */
export type Quarter = { stride: number; x: number; y: number };
export type Unit = keyof typeof UNITS;
/**
 * Cells that rays may skip: their inputs, how many there are, the edges of one, and where they begin.
 */
export type Cells = { of: unknown[]; size: Vector3; edge: Vector3; low: Vector3 };

// ---- programs: compiled, and chosen by the settings -----------------------------------------------------------------

function compileShader(gl: WebGL2RenderingContext, type: GLenum, source: string) {
  const shader = gl.createShader(type) as WebGLShader; // null only where the context is lost
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
    throw new Error(`shader: ${gl.getShaderInfoLog(shader)}`);
  }
  return shader;
}

export function linkProgram(gl: WebGL2RenderingContext, fragment: string): Program {
  const program = gl.createProgram();
  gl.attachShader(program, compileShader(gl, gl.VERTEX_SHADER, VERTEX));
  gl.attachShader(program, compileShader(gl, gl.FRAGMENT_SHADER, fragment));
  gl.bindAttribLocation(program, 0, "corner");
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(`program: ${gl.getProgramInfoLog(program)}`);
  }
  const locations = new Map<string, WebGLUniformLocation | null>();
  const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) || 0;
  for (let i = 0; i < count; i++) {
    const { name } = gl.getActiveUniform(program, i) as WebGLActiveInfo;
    locations.set(name, gl.getUniformLocation(program, name));
  }
  return { program, at: (name) => locations.get(name) ?? null };
}

/** From places in the volume's frame to texture coordinates over a plane. */
function toTextures({ origin, u, v, n }: PlaneData, starts: Vector3, lengths: Vector3): ToTexture {
  const axes = [u, v, n] as const,
    scale = perAxis((i) => (lengths[i] > 0 ? 1 / lengths[i] : 0));
  return {
    matrix: perAxis((j) => perAxis((i) => axes[i][j] * scale[i])),
    offset: perAxis((i) => (scale[i] ? (-dot(axes[i], origin) - starts[i]) * scale[i] : 0.5)),
  };
}

/** The abilities that the shader needs, and no more: an unused one costs nothing. */
function definesOf(
  projection: string,
  planar: CastPlanar | null,
  space: CastSpace | null,
  { folds = false, clipped = false, occluded = false } = {},
) {
  const cut = planar?.cut,
    early = space?.cut;
  const isPaper = (c: { rule?: string } | null | undefined) => c?.rule === "paper";
  const needed: Record<string, unknown> = {
    PLANAR: planar,
    WEIGHTED: planar && !planar.isReplicated,
    SPACE: space,
    WARPED: planar || space,
    MIP: projection === "mip",
    SHADED: projection === "shaded",
    CUT: cut || early,
    PLANE_CUT: cut,
    BY_PLACE: isPaper(cut),
    SPACE_CUT: early,
    SPACE_BY_PLACE: isPaper(early),
    FOLDS: folds && (planar || space),
    CLIPPED: clipped && projection === "shaded",
    OCCLUDED: occluded && projection === "shaded",
  };
  const cuts = Array.from({ length: cut?.shape[0] ?? 0 }, (_, c) => `F(${c})`);
  return [...Object.keys(needed).filter((name) => needed[name]), ...(cut ? [`EACH_CUT(F) ${cuts.join(" ")}`] : [])];
}

// ---- the ray caster -------------------------------------------------------------------------------------------------

const UNITS = {
  volume: 0,
  cells: 1,
  ambience: 2,
  table: 3,
  maps: 4,
  weights: 5,
  space: 6,
  picture: 7,
  distances: 8,
  depths: 9,
  second: 10,
  ownCells: 11,
};

const FINEST = 2047; // entries of the table that is looked up without interpolation: 2048 fit into any texture
const LONG = 1.25; // a step of more voxels than this may lead so far below a surface that its slope differs
const FEWEST_SEEN = 4; // samples of tissue beyond a side of the box that are no speck
const FACE_VOXELS = 3; // a cut face is lit this deep, half on each side of it

export type Background = "dark" | "light";

export const BACKGROUNDS: Record<Background, { centre: Vector3; corner: Vector3; ink: Vector3 }> = {
  dark: { centre: [0.118, 0.126, 0.147], corner: [0.052, 0.056, 0.067], ink: [0.97, 0.96, 0.93] },
  light: { centre: [0.957, 0.96, 0.965], corner: [0.85, 0.857, 0.87], ink: [0.09, 0.1, 0.13] },
};

export class MemoryError extends Error {}
export const NOT_HELD = "The graphics memory does not hold this volume.";

export class RayCaster {
  gl: WebGL2RenderingContext;
  canvas: HTMLCanvasElement;
  size: Vector2;
  floats: boolean;
  smoothFloats: boolean;
  name: string;
  isSoftware: boolean;
  largest: number;
  programs: Record<string, Program> = {};
  textures: { [unit in Unit]?: WebGLTexture } = {};
  targets: Record<string, Target> = {};
  volume: CastVolume | null = null;
  table: ColorTable | null = null;
  planar: CastPlanar | null = null;
  space: CastSpace | null = null;
  givenSpace: SpaceField | null = null; // the field that `space` was made of
  pairs: Record<"opacity" | "value", Uint8Array>;
  empty: Record<"cells" | "ownCells", Cells | null>;
  skips = true; // false: rays take every sample
  distances: Float32Array | null = null; // of the cuts that the texture was made of
  projection = "shaded";
  background: Background = "dark";
  showFolds = true;
  occlusion = true; // whether hollows and deep tissue get less light
  clip: Clip | null = null; // the shares of the volume's box that are seen, see maths/clipping.js; null: all

  /**
   * Throws an Error with a readable reason if there is no WebGL2.
   * @param canvas a canvas without a context
   */
  constructor(canvas: HTMLCanvasElement) {
    const gl = canvas.getContext("webgl2", {
      antialias: false,
      alpha: false,
      depth: false,
      stencil: false,
      powerPreference: "high-performance",
    });
    if (!gl) throw new Error("this browser offers no WebGL2 here");
    this.gl = gl;
    this.canvas = canvas; // has fewer pixels than `size` while a quick picture is shown
    this.size = [canvas.width, canvas.height];
    this.floats = Boolean(gl.getExtension("EXT_color_buffer_float") || gl.getExtension("EXT_color_buffer_half_float"));
    this.smoothFloats = Boolean(gl.getExtension("OES_texture_float_linear"));
    const info = gl.getExtension("WEBGL_debug_renderer_info");
    this.name = String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER) || "");
    this.isSoftware = /swiftshader|llvmpipe|software|basic render/i.test(this.name);
    this.largest = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE);
    this.pairs = { opacity: new Uint8Array(), value: new Uint8Array() }; // of the volume's blocks: see empty_space.js
    this.empty = { cells: null, ownCells: null }; // of the result and of the volume as it was
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.disable(gl.DITHER);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 3, -1, -1, 3]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    this.#plain();
  }

  /** Set the size of the full picture in pixels, which empties the canvas. */
  resize(width: number, height: number) {
    this.size = [width, height];
    this.#fit(width, height);
  }

  #fit(width: number, height: number) {
    const { canvas } = this;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  }

  /** True if the map folds somewhere and folds are shown. */
  get folds() {
    return this.showFolds && Boolean(this.planar?.folds || this.space?.folds);
  }

  get isReady() {
    return Boolean(this.volume && this.table && this.volume.loaded);
  }

  // A program reads every sampler it declares, so each unit holds something of its kind from the start.
  #plain() {
    const gl = this.gl;
    for (const name of ["volume", "cells", "ownCells", "ambience", "space", "depths"] as const) {
      this.#texture(name, gl.TEXTURE_3D, true);
      gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGBA8, 1, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    }
    for (const name of ["maps", "distances"] as const) {
      this.#texture(name, gl.TEXTURE_2D_ARRAY, true);
      gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RGBA8, 1, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    }
    for (const name of ["table", "weights", "picture"] as const) {
      this.#texture(name, gl.TEXTURE_2D, true);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    }
  }

  /** Create a texture again, bound to its unit. */
  #texture(name: Unit, target: GLenum, linear: boolean) {
    const gl = this.gl;
    gl.deleteTexture(this.textures[name] || null);
    const texture = gl.createTexture();
    this.textures[name] = texture;
    gl.activeTexture(gl.TEXTURE0 + UNITS[name]);
    gl.bindTexture(target, texture);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) {
      gl.texParameteri(target, side, gl.CLAMP_TO_EDGE);
    }
    for (const kind of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
      gl.texParameteri(target, kind, linear ? gl.LINEAR : gl.NEAREST);
    }
  }

  /**
   * Take a volume of bytes [z][y][x]. `tick` is awaited between slabs so that the page stays alive. Returns false if
   * another volume came in meanwhile.
   */
  async setVolume(values: Uint8Array, info: VolumeData, tick?: (share: number) => Promise<void>) {
    const gl = this.gl,
      [nx, ny, nz] = info.shape;
    const volume: CastVolume = { ...info, values, extremes: null, loaded: false };
    this.volume = volume;
    this.#texture("volume", gl.TEXTURE_3D, !info.isLabels);
    gl.texStorage3D(gl.TEXTURE_3D, 1, gl.RGBA8, nx, ny, nz);
    this.#checkMemory();
    const slab = Math.max(1, Math.round(2 ** 20 / (nx * ny))); // 10 to 20 ms of work
    const gradients = new GradientSlabs(values, info.shape, info.spacing, info.outside);
    for (let z = 0; z < nz; z += slab) {
      const last = Math.min(nz, z + slab);
      const voxels = gradients.slab(z, last);
      gl.activeTexture(gl.TEXTURE0 + UNITS.volume);
      gl.texSubImage3D(gl.TEXTURE_3D, 0, 0, 0, z, nx, ny, last - z, gl.RGBA, gl.UNSIGNED_BYTE, voxels);
      if (tick) await tick(last / nz);
      if (this.volume !== volume) return false;
    }
    this.#checkMemory(); // some GPUs take the memory only when they get its values
    volume.extremes = blockExtremes(values, info.shape);
    volume.loaded = true;
    if (this.table) this.setTable(this.table.rgba, this.table.unit);
    return true;
  }

  /** Free the memory and throw a MemoryError, where the GPU has not enough for the volume. */
  #checkMemory() {
    const { gl } = this;
    if (gl.getError() !== gl.OUT_OF_MEMORY) return;
    this.volume = null;
    this.#texture("volume", gl.TEXTURE_3D, true);
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGBA8, 1, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    throw new MemoryError(NOT_HELD);
  }

  /**
   * Take colours and opacities: (255 k + 1) x 4 floats, every k-th for a byte; opacities of a thickness of `unit`.
   */
  setTable(rgba: Float32Array, unit: number) {
    this.table = { rgba, unit, step: 0 };
    if (!this.volume?.extremes) return;
    const gl = this.gl,
      { extremes, values, shape, spacing } = this.volume;
    const alphas = Float32Array.from({ length: rgba.length / 4 }, (_, i) => rgba[4 * i + 3]!);
    this.pairs = {
      opacity: blockPairs(blockOpacities(extremes, alphas), extremes.size),
      value: blockPairs(extremes.high, extremes.size),
    };
    const light = ambientLight(values, shape, alphas, (AMBIENT_CELL * Math.min(...spacing)) / unit);
    this.#texture("ambience", gl.TEXTURE_3D, true);
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.R8, ...light.size, 0, gl.RED, gl.UNSIGNED_BYTE, light.values);
  }

  /**
   * Fit the table to a step. Opacities hold for one thickness: they are recomputed for the step of this picture rather
   * than with a power at every sample.
   */
  #fitTable(table: ColorTable, step: number) {
    const { rgba, unit } = table,
      gl = this.gl;
    if (table.step === step) return;
    table.step = step;
    const entries = rgba.length / 4 - 1,
      finer = Math.max(1, Math.floor(FINEST / entries));
    const fitted = new Float32Array(4 * (finer * entries + 1));
    for (let i = 0; i < fitted.length; i++) {
      const at = Math.floor(i / 4) / finer,
        k = Math.min(entries - 1, Math.floor(at)),
        from = 4 * k + (i % 4);
      const value = rgba[from]! + (at - k) * (rgba[from + 4]! - rgba[from]!);
      fitted[i] = i % 4 === 3 ? 1 - (1 - Math.min(value, 0.9999)) ** (step / unit) : value;
    }
    this.#texture("table", gl.TEXTURE_2D, false);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, fitted.length / 4, 1, 0, gl.RGBA, gl.FLOAT, fitted);
  }

  /** Take displacement maps over a plane, or null. */
  setPlanar(planar: PlanarField | null) {
    if (!planar) {
      this.planar = null;
      return;
    }
    const gl = this.gl,
      { maps, shape, origin, spacing, weights, plane } = planar,
      [layers, rows, columns] = shape;
    const regions = planar.cut ? planar.cut.sides.length : 1,
      count = layers / regions,
      knots = weights.length / count;
    const [ofMaps, ofWeights] = this.smoothFloats ? ([gl.RG32F, gl.R32F] as const) : ([gl.RG16F, gl.R16F] as const);
    this.#texture("maps", gl.TEXTURE_2D_ARRAY, true);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, ofMaps, columns, rows, layers, 0, gl.RG, gl.FLOAT, maps);
    this.#texture("weights", gl.TEXTURE_2D, true);
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
    const gl = this.gl,
      { origin, distances } = cut,
      [count, rows, columns] = cut.shape,
      [da, db] = cut.spacing;
    const lengths: Vector3 = [columns * da, rows * db, 0];
    if (this.distances !== distances) {
      // they change when a cut is drawn, not when points move
      this.distances = distances;
      this.#texture("distances", gl.TEXTURE_2D_ARRAY, true);
      gl.texImage3D(
        gl.TEXTURE_2D_ARRAY,
        0,
        this.smoothFloats ? gl.R32F : gl.R16F,
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
    if (given === this.givenSpace) return;
    this.givenSpace = given;
    this.space = given && {
      ...given,
      ...this.#castSpace(given),
      ranges: new SpaceRanges(given),
      toSpace: perAxis((i) => 1 / (given.shape[i] * given.spacing[i])),
      toSpace0: perAxis((i) => (0.5 * given.spacing[i] - given.origin[i]) / (given.shape[i] * given.spacing[i])),
    };
  }

  #castSpace({ shape, spacing, values, depths, cut }: SpaceField) {
    const gl = this.gl;
    this.#texture("space", gl.TEXTURE_3D, true);
    if (cut) {
      const [nx, ny, nz] = shape,
        deep = nz * cut.regions; // one region behind the other
      gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGBA16F, nx, ny, deep, 0, gl.RGBA, gl.HALF_FLOAT, values);
      this.#texture("depths", gl.TEXTURE_3D, true);
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
    const kind = this.smoothFloats ? gl.RGBA32F : gl.RGBA16F;
    gl.texImage3D(gl.TEXTURE_3D, 0, kind, ...shape, 0, gl.RGBA, gl.FLOAT, padded);
    return { folds: spaceSlope(floats, shape, spacing) >= 1 && spaceFolds(floats, shape, spacing) };
  }

  /**
   * The cells of a box of the result that rays may skip; recomputed only where something of it has changed.
   * @param voxels along the edge of a cell
   */
  #cells(
    volume: CastVolume,
    table: ColorTable,
    { planar, space }: { planar: CastPlanar | null; space: CastSpace | null },
    isOriginal: boolean,
    voxels: number,
  ) {
    const { extremes, outside, shape, spacing } = volume,
      { gl, skips } = this;
    if (!extremes) throw new Error("nothing to draw");
    const name: "cells" | "ownCells" = isOriginal ? "ownCells" : "cells";
    const isLargest = this.projection === "mip",
      box = isOriginal ? volume.ownBox : volume.box;
    const known = isLargest ? this.pairs.value : this.pairs.opacity;
    const of = [planar, space, box, known, skips, voxels],
      old = this.empty[name];
    if (old?.of.every((part, i) => part === of[i])) return { name, cells: old };
    const pairs = skips ? known : new Uint8Array(known.length).fill(255);
    const opacity = Math.min(255, Math.ceil((255 * opacityOfByte(table.rgba, outside)) / OPACITY_SHARE));
    const beyond = !skips ? 255 : isLargest ? outside : opacity;
    const found = emptyCells({ box, shape, spacing, extremes, pairs, beyond, isLargest, voxels }, { planar, space });
    this.#texture(name, gl.TEXTURE_3D, false);
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.RG8, ...found.size, 0, gl.RG, gl.UNSIGNED_BYTE, found.cells);
    const cells = { of, size: found.size, edge: found.edge, low: box.low };
    this.empty[name] = cells;
    return { name, cells };
  }

  #program({ planar, space }: { planar: CastPlanar | null; space: CastSpace | null }) {
    const defines = definesOf(this.projection, planar, space, {
      folds: this.folds,
      clipped: Boolean(this.clip),
      occluded: this.occlusion,
    });
    const key = defines.join(" ");
    const lines = defines.map((d) => `#define ${d}\n`).join("");
    this.programs[key] ??= linkProgram(this.gl, FRAGMENT.replace("#version 300 es\n", `#version 300 es\n${lines}`));
    return this.programs[key];
  }

  /** A picture to draw into, created again when its size changes. With a stride it holds quarters, side by side. */
  #target(name: string, width: number, height: number, stride = 1) {
    const gl = this.gl,
      old = this.targets[name];
    const side = (n: number) => (stride > 1 ? 2 * Math.ceil(n / stride) : n),
      [w, h] = [side(width), side(height)];
    const shown: Pick<Target, "extent" | "start"> = {
      extent: [width / stride, height / stride],
      start: 0.5 - 0.5 / stride,
    };
    if (old && old.width === w && old.height === h) return Object.assign(old, shown);
    if (old) {
      gl.deleteTexture(old.texture);
      gl.deleteFramebuffer(old.buffer);
    }
    const target = { width: w, height: h, texture: gl.createTexture(), buffer: gl.createFramebuffer(), ...shown };
    gl.activeTexture(gl.TEXTURE0 + UNITS.picture);
    gl.bindTexture(gl.TEXTURE_2D, target.texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, this.floats ? gl.RGBA16F : gl.RGBA8, w, h);
    for (const kind of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, kind, gl.LINEAR);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.buffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target.texture, 0);
    this.targets[name] = target;
    return target;
  }

  /**
   * Cast rays into a picture of that name; only where it isReady. tile: [x, y, width, height] in pixels from the lower
   * left, of the quarter where one is drawn. pass: 0 replaces, n > 0 averages with the n passes before it. A quarter has
   * the rays of the whole picture, each as it is there.
   * @param width of the whole picture
   */
  cast(
    name: string,
    width: number,
    height: number,
    picture: Picture,
    {
      tile = null,
      pass = 0,
      coarseness = 1,
      quarter = null,
    }: {
      tile?: Vector4 | null;
      pass?: number;
      coarseness?: number;
      quarter?: Quarter | null;
    } = {},
  ) {
    const { gl, volume, table } = this,
      { camera, original } = picture;
    if (!volume || !table) throw new Error("nothing to draw");
    const { planar, space } = original ? { planar: null, space: null } : this,
      whole = picture.whole ?? picture;
    const { stride, x, y } = quarter ?? { stride: 1, x: 0, y: 0 };
    const target = this.#target(name, width, height, stride),
      { program, at } = this.#program({ planar, space });
    const finest = Math.min(...volume.spacing),
      pixel = (2 * Math.hypot(...camera.up)) / height;
    const step = coarseness * Math.max(finest * 0.7, Math.min(pixel, 2 * finest));
    this.#fitTable(table, step);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.buffer);
    gl.viewport(0, 0, target.width, target.height);
    gl.useProgram(program);
    for (const [sampler, unit] of Object.entries(UNITS)) gl.uniform1i(at(sampler), unit);
    this.#setCamera(at, camera, whole.width, height, pass);
    const [left, low] = [x * (target.width / 2), y * (target.height / 2)];
    // A pixel at (n + 1/2, m + 1/2) of the quarter is the one at (stride n + x stride / 2 + 1/2, ...) of the whole.
    const before = (from: number, part: number) => (from + 0.5) * stride - (part * stride) / 2 - 0.5;
    gl.uniform1f(at("stride"), stride);
    gl.uniform2f(at("place"), whole.x + before(left, x), before(low, y));
    this.#setVolumeNumbers(at, volume, table, step, original ? volume.ownBox : volume.box);
    const {
      name: unit,
      cells: { size, edge, low: corner },
    } = this.#cells(volume, table, { planar, space }, original, coarseness > 1 ? QUICK_CELL : CELL);
    gl.uniform1i(at("cells"), UNITS[unit]);
    gl.uniform3fv(at("cellCount"), size);
    gl.uniform1f(at("layers"), step / table.unit);
    gl.uniform3fv(
      at("toCells"),
      edge.map((e) => 1 / e),
    );
    gl.uniform3fv(
      at("toCells0"),
      perAxis((i) => -corner[i] / edge[i]),
    );
    this.#setFieldNumbers(at, planar, space, volume.spacing);
    if (pass > 0) {
      gl.enable(gl.BLEND);
      gl.blendColor(0, 0, 0, 1 / (pass + 1));
      gl.blendFunc(gl.CONSTANT_ALPHA, gl.ONE_MINUS_CONSTANT_ALPHA);
    }
    const [tx, ty, tw, th] = tile ?? [picture.x, 0, picture.width, height];
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(left + tx, low + ty, tw, th);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.BLEND);
    gl.disable(gl.SCISSOR_TEST);
  }

  #setCamera(at: Uniforms, camera: RayCamera, width: number, height: number, pass: number) {
    const gl = this.gl;
    for (const name of ["eye", "right", "up", "ahead"] as const) gl.uniform3fv(at(name), camera[name]);
    gl.uniform1f(at("bend"), camera.bend || 0);
    gl.uniform2f(at("resolution"), width, height);
    // Later passes sample other places of each pixel, spread by the fractional parts of two irrational numbers.
    const spread = (x: number) => x - Math.floor(x) - 0.5;
    gl.uniform2f(at("shift"), pass ? spread(0.5 + pass * 0.7548777) : 0, pass ? spread(0.5 + pass * 0.5698403) : 0);
    gl.uniform1f(at("phase"), (pass * 0.618034) % 1);
    const unit = (v: Vector3) => perAxis((i) => v[i] / Math.hypot(...v));
    const [r, u, n] = [unit(camera.right), unit(camera.up), camera.ahead];
    const mixed = (a: number, b: number, c: number) => unit(perAxis((i) => a * r[i] + b * u[i] + c * n[i]));
    // A lamp above the viewer's left shoulder: light from the eye alone appears flat. A weak one from the other side.
    const lamp = mixed(-0.42, 0.55, -0.72);
    gl.uniform3fv(at("lamp"), lamp);
    gl.uniform3fv(at("halfway"), unit(perAxis((i) => lamp[i] - n[i])));
    gl.uniform3fv(at("fillLamp"), mixed(0.7, -0.25, -0.5));
  }

  #setVolumeNumbers(at: Uniforms, volume: CastVolume, table: ColorTable, step: number, box: Sides) {
    const gl = this.gl,
      { shape, spacing } = volume;
    gl.uniform1f(at("reach"), Math.hypot(...perAxis((i) => box.high[i] - box.low[i])) || 1);
    gl.uniform3fv(
      at("middle"),
      perAxis((i) => (box.low[i] + box.high[i]) / 2),
    );
    this.#setBox(at, volume, step, box);
    gl.uniform3fv(
      at("toTexture"),
      perAxis((i) => 1 / (shape[i] * spacing[i])),
    );
    gl.uniform3fv(
      at("toTexture0"),
      shape.map((n) => 0.5 / n),
    );
    gl.uniform1f(at("stepLength"), step);
    gl.uniform1f(at("steep"), step > LONG * Math.min(...spacing) ? 0.08 : 2);
    gl.uniform1f(at("outside"), volume.outside / 255);
    gl.uniform1f(at("outsideOpacity"), opacityOfByte(table.rgba, volume.outside));
    // Below two hundredths of the range per voxel a slope is noise; bytes of the gradient count 1/127 of the steepest.
    gl.uniform1f(at("certain"), ((volume.share ?? 1) * STEEPEST) / 127 / (0.012 * 255)); // of the range of all values
    gl.uniform2fv(at("grey"), volume.grey || [0, 1]);
    gl.uniform3fv(at("ink"), BACKGROUNDS[this.background].ink);
  }

  #setBox(at: Uniforms, volume: CastVolume, step: number, box: Sides) {
    const gl = this.gl,
      left = this.clip && leftOf(box, clipSides(volume.box, this.clip));
    gl.uniform3fv(at("boxLow"), (left ?? box).low);
    gl.uniform3fv(at("boxHigh"), (left ?? box).high);
    if (!left) return;
    gl.uniform3fv(at("openLow"), left.openLow);
    gl.uniform3fv(at("openHigh"), left.openHigh);
    gl.uniform1f(at("bareDepth"), 2 * Math.max(step, Math.min(...volume.spacing)));
  }

  /** @param spacing of the voxels */
  #setFieldNumbers(at: Uniforms, planar: CastPlanar | null, space: CastSpace | null, spacing: Vector3) {
    const gl = this.gl,
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
    const gl = this.gl;
    gl.uniformMatrix3fv(at("toCut"), false, cut.toCut.matrix.flat());
    gl.uniform3fv(at("toCut0"), cut.toCut.offset);
    gl.uniform2fv(at("cutScale"), cut.scale);
    gl.uniform1i(at("regionCount"), cut.bits.length);
    gl.uniform1iv(at("sides[0]"), cut.bits);
  }

  /**
   * The sides of the box (low x, high x, low y ...) beyond which there is deformed tissue, which is not seen.
   * @param looked values above `tissue`, from 0 to 1, this far beyond in shares of the box
   */
  exceededSides({ tissue, beyond }: { tissue: number; beyond: number[] }) {
    const { gl, volume, table, planar, space } = this,
      width = 6 * SIDE_SAMPLES,
      height = SIDE_SAMPLES;
    if (!volume || !table) return [];
    const defines = definesOf("", planar, space),
      key = `sides ${defines.join(" ")}`;
    const lines = defines.map((d) => `#define ${d}\n`).join("");
    this.programs[key] ??= linkProgram(gl, SIDES.replace("#version 300 es\n", `#version 300 es\n${lines}`));
    const { program, at } = this.programs[key],
      { buffer } = this.#target("sides", width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    gl.viewport(0, 0, width, height);
    gl.useProgram(program);
    for (const [sampler, unit] of Object.entries(UNITS)) gl.uniform1i(at(sampler), unit);
    this.#setVolumeNumbers(at, volume, table, 1, volume.box);
    this.#setFieldNumbers(at, planar, space, volume.spacing);
    gl.uniform3fv(at("boxLow"), volume.box.low); // of all of it, clipped or not
    gl.uniform3fv(at("boxHigh"), volume.box.high);
    gl.uniform3fv(at("beyond"), beyond);
    gl.uniform1f(at("tissue"), tissue);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const seen = this.floats ? new Float32Array(4 * width * height) : new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, this.floats ? gl.FLOAT : gl.UNSIGNED_BYTE, seen);
    const counts = new Array<number>(6).fill(0);
    for (let i = 0; i < width * height; i++) if (seen[4 * i]! > 0) counts[Math.floor((i % width) / SIDE_SAMPLES)]! += 1;
    return counts.flatMap((count, side) => (count >= FEWEST_SEEN ? [side] : []));
  }

  /**
   * Put four quarters together: the first of the quarters of half the stride, or the whole picture.
   * @param width of the whole picture
   * @param stride of the quarters
   */
  merge(from: string, to: string, width: number, height: number, stride: number) {
    const gl = this.gl,
      { texture, ...quarters } = this.targets[from]!,
      next = stride / 2;
    this.programs.merge ??= linkProgram(gl, MERGE);
    const target = this.#target(to, width, height, next),
      { program, at } = this.programs.merge;
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.buffer);
    gl.viewport(0, 0, Math.ceil(width / next), Math.ceil(height / next));
    gl.useProgram(program);
    this.#show(at, texture);
    gl.uniform2i(at("size"), quarters.width / 2, quarters.height / 2);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  #show(at: Uniforms, texture: WebGLTexture | null) {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0 + UNITS.picture);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.uniform1i(at("picture"), UNITS.picture);
  }

  /**
   * Show a picture on the canvas, over the background; one that has parts side by side has it behind each. What has
   * fewer pixels than the canvas is enlarged smoothly, and of quarters the first is shown. `isQuick`: the canvas gets
   * the size of the picture, and the browser enlarges it: without a GPU that takes a tenth of the time.
   * @param name null: the background alone
   * @param options `over` is another picture, `share` how much of it is laid over the first
   */
  present(
    name: string | null,
    {
      parts = 1,
      over = null,
      share = 0,
      isQuick = false,
    }: { parts?: number; over?: string | null; share?: number; isQuick?: boolean } = {},
  ) {
    const gl = this.gl,
      ground = BACKGROUNDS[this.background];
    const [width, height] = name && isQuick ? (this.targets[name]!.extent.map(Math.ceil) as Vector2) : this.size;
    this.#fit(width, height);
    this.programs.present ??= linkProgram(gl, PRESENT);
    const { program, at } = this.programs.present;
    const nothing: Pick<Target, "extent" | "start"> & { texture: WebGLTexture | null } = {
      texture: this.textures.picture ?? null,
      extent: [width, height],
      start: 0,
    };
    const first = name ? this.targets[name]! : nothing,
      second = over ? this.targets[over]! : first;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.useProgram(program);
    this.#show(at, first.texture);
    gl.uniform2f(at("extent"), ...first.extent);
    gl.uniform1f(at("start"), first.start);
    gl.activeTexture(gl.TEXTURE0 + UNITS.second);
    gl.bindTexture(gl.TEXTURE_2D, second.texture);
    gl.uniform1i(at("second"), UNITS.second);
    gl.uniform2f(at("secondExtent"), ...second.extent);
    gl.uniform1f(at("secondStart"), second.start);
    gl.uniform1f(at("share"), over ? share : 0);
    gl.uniform2f(at("resolution"), width, height);
    gl.uniform1f(at("parts"), parts);
    gl.uniform3fv(at("centre"), ground.centre);
    gl.uniform3fv(at("corner"), ground.corner);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** Give the context back: a page has only about sixteen. */
  dispose() {
    this.volume = null;
    const lose = this.gl.getExtension("WEBGL_lose_context");
    if (lose && !this.gl.isContextLost()) lose.loseContext();
  }
}
