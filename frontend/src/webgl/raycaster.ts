// The ray caster: pictures of a volume from any side, of any part at any resolution.
// It has no widget and no pointer; all inputs are arrays and numbers.

import { perAxis } from "../maths/axes.ts";
import { type Clip, clipSides, leftOf } from "../maths/clipping.ts";
import type { Sides, Vector2, Vector3, Vector4 } from "../types.ts";
import { CELL, emptyCells, QUICK_CELL } from "./empty_space.ts";
import { type CastFields, FieldTextures } from "./field_textures.ts";
import { Gpu, type Target, UNITS, type Uniforms } from "./gpu.ts";
import { FRAGMENT, PRESENT, SIDE_SAMPLES, SIDES } from "./ray_shader.ts";
import type { CastVolume, ColorTable, Picture, RayCamera } from "./types.ts";
import { OPACITY_SHARE, opacityOfByte, STEEPEST } from "./volume_blocks.ts";
import { VoxelTextures } from "./voxel_textures.ts";

/**
 * Cells that rays may skip: their inputs, how many there are, the edges of one, and where they begin.
 */
export type Cells = { of: unknown[]; size: Vector3; edge: Vector3; low: Vector3 };

const LONG = 1.25; // a step of more voxels than this may lead so far below a surface that its slope differs
const OPAQUE = 0.97, // share of the light that is stopped, from which on a ray ends
  QUICK_OPAQUE = 0.9; // the same while something moves
const FEWEST_SEEN = 4; // samples of tissue beyond a side of the box that are no speck

export type Background = "dark" | "light" | "black" | "white";

export const BACKGROUNDS: Record<Background, { centre: Vector3; corner: Vector3; ink: Vector3 }> = {
  dark: { centre: [0.118, 0.126, 0.147], corner: [0.052, 0.056, 0.067], ink: [0.97, 0.96, 0.93] },
  // Of pictures without a ground, which is found by the difference.
  black: { centre: [0, 0, 0], corner: [0, 0, 0], ink: [0.97, 0.96, 0.93] },
  white: { centre: [1, 1, 1], corner: [1, 1, 1], ink: [0.97, 0.96, 0.93] },
  light: { centre: [0.957, 0.96, 0.965], corner: [0.85, 0.857, 0.87], ink: [0.09, 0.1, 0.13] },
};

/** The abilities that the shader needs, and no more: an unused one costs nothing. */
function definesOf(
  projection: string,
  { planar, space }: CastFields,
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

/** The cells that rays may skip, of the result and of the volume as it was. */
class SkippedCells {
  skips = true; // false: rays take every sample
  #found: Record<"cells" | "ownCells", Cells | null> = { cells: null, ownCells: null };

  constructor(
    readonly gpu: Gpu,
    readonly voxels: VoxelTextures,
  ) {}

  /**
   * The cells of a box of the result that rays may skip; recomputed only where something of it has changed.
   * @param voxels along the edge of a cell
   */
  find(
    volume: CastVolume,
    table: ColorTable,
    { planar, space }: CastFields,
    { isOriginal, isLargest, voxels }: { isOriginal: boolean; isLargest: boolean; voxels: number },
  ) {
    const { extremes, outside, shape, spacing } = volume,
      { skips } = this,
      { gl } = this.gpu;
    if (!extremes) throw new Error("nothing to draw");
    const name: "cells" | "ownCells" = isOriginal ? "ownCells" : "cells";
    const box = isOriginal ? volume.ownBox : volume.box,
      { pairs: all } = this.voxels,
      known = isLargest ? all.value : all.opacity;
    const of = [planar, space, box, known, skips, voxels],
      old = this.#found[name];
    if (old?.of.every((part, i) => part === of[i])) return { name, cells: old };
    const pairs = skips ? known : new Uint8Array(known.length).fill(255);
    const opacity = Math.min(255, Math.ceil((255 * opacityOfByte(table.rgba, outside)) / OPACITY_SHARE));
    const beyond = !skips ? 255 : isLargest ? outside : opacity;
    const found = emptyCells({ box, shape, spacing, extremes, pairs, beyond, isLargest, voxels }, { planar, space });
    this.gpu.texture(name, gl.TEXTURE_3D, false);
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.RG8, ...found.size, 0, gl.RG, gl.UNSIGNED_BYTE, found.cells);
    const cells = { of, size: found.size, edge: found.edge, low: box.low };
    this.#found[name] = cells;
    return { name, cells };
  }
}

export class RayCaster {
  readonly gpu: Gpu;
  readonly voxels: VoxelTextures;
  readonly fields: FieldTextures;
  readonly cells: SkippedCells;
  size: Vector2; // of the full picture; the canvas has fewer pixels while a quick one is shown
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
    this.gpu = new Gpu(canvas);
    this.voxels = new VoxelTextures(this.gpu);
    this.fields = new FieldTextures(this.gpu);
    this.cells = new SkippedCells(this.gpu, this.voxels);
    this.size = [canvas.width, canvas.height];
  }

  /** Give the context back. */
  dispose() {
    this.voxels.volume = null;
    this.gpu.dispose();
  }

  /** Set the size of the full picture in pixels, which empties the canvas. */
  resize(width: number, height: number) {
    this.size = [width, height];
    this.gpu.fit(width, height);
  }

  get isReady() {
    const { volume, table } = this.voxels;
    return Boolean(table && volume?.loaded);
  }

  /** True if the map folds somewhere and folds are shown. */
  get folds() {
    return this.showFolds && this.fields.folds;
  }

  /** Whatever pictures are made of, apart from their size and steps: pictures of equal inputs are the same. */
  inputsOf(pictures: Picture[]): unknown[] {
    const { volume, table } = this.voxels,
      { planar, space } = this.fields;
    const words = JSON.stringify([pictures, volume?.box, volume?.grey, this.clip, this.background]);
    return [volume, volume?.loaded, table, planar, space, words, this.projection, this.showFolds, this.occlusion];
  }

  #program(fields: CastFields) {
    const { folds, clip, occlusion } = this;
    return this.gpu.program(
      "cast",
      FRAGMENT,
      definesOf(this.projection, fields, { folds, clipped: Boolean(clip), occluded: occlusion }),
    );
  }

  /**
   * Cast rays into a picture of that name; only where it isReady. tile: [x, y, width, height] in pixels from the lower
   * left. pass: 0 replaces, n > 0 averages with the n passes before it.
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
    }: {
      tile?: Vector4 | null;
      pass?: number;
      coarseness?: number;
    } = {},
  ) {
    const { gpu, fields } = this,
      { gl } = gpu,
      { volume, table } = this.voxels,
      { camera, original } = picture;
    if (!volume || !table) throw new Error("nothing to draw");
    const shown: CastFields = original ? { planar: null, space: null } : fields,
      whole = picture.whole ?? picture;
    const target = gpu.target(name, width, height);
    const finest = Math.min(...volume.spacing),
      pixel = (2 * Math.hypot(...camera.up)) / height;
    const step = coarseness * Math.max(finest * 0.7, Math.min(pixel, 2 * finest));
    this.voxels.fitTable(table, step);
    const at = gpu.use(this.#program(shown), target);
    gpu.setSamplers(at);
    this.#setCamera(at, camera, whole.width, height, pass);
    gl.uniform2f(at("place"), whole.x, 0);
    this.#setVolumeNumbers(at, volume, table, step, original ? volume.ownBox : volume.box);
    const {
      name: unit,
      cells: { size, edge, low: corner },
    } = this.cells.find(volume, table, shown, {
      isOriginal: original,
      isLargest: this.projection === "mip",
      voxels: coarseness > 1 ? QUICK_CELL : CELL,
    });
    gl.uniform1i(at("cells"), UNITS[unit]);
    gl.uniform3fv(at("cellCount"), size);
    gl.uniform1f(at("layers"), step / table.unit);
    gl.uniform1f(at("opaque"), coarseness > 1 ? QUICK_OPAQUE : OPAQUE);
    gl.uniform3fv(
      at("toCells"),
      edge.map((e) => 1 / e),
    );
    gl.uniform3fv(
      at("toCells0"),
      perAxis((i) => -corner[i] / edge[i]),
    );
    fields.setNumbers(at, shown, volume.spacing);
    if (pass > 0) {
      gl.enable(gl.BLEND);
      gl.blendColor(0, 0, 0, 1 / (pass + 1));
      gl.blendFunc(gl.CONSTANT_ALPHA, gl.ONE_MINUS_CONSTANT_ALPHA);
    }
    const [tx, ty, tw, th] = tile ?? [picture.x, 0, picture.width, height];
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(tx, ty, tw, th);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.BLEND);
    gl.disable(gl.SCISSOR_TEST);
  }

  #setCamera(at: Uniforms, camera: RayCamera, width: number, height: number, pass: number) {
    const { gl } = this.gpu;
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
    const { gl } = this.gpu,
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
    const { gl } = this.gpu,
      left = this.clip && leftOf(box, clipSides(volume.box, this.clip));
    gl.uniform3fv(at("boxLow"), (left ?? box).low);
    gl.uniform3fv(at("boxHigh"), (left ?? box).high);
    if (!left) return;
    gl.uniform3fv(at("openLow"), left.openLow);
    gl.uniform3fv(at("openHigh"), left.openHigh);
    gl.uniform1f(at("bareDepth"), 2 * Math.max(step, Math.min(...volume.spacing)));
  }

  /**
   * The sides of the box (low x, high x, low y ...) beyond which there is deformed tissue, which is not seen.
   * @param looked values above `tissue`, from 0 to 1, this far beyond in shares of the box
   */
  exceededSides({ tissue, beyond }: { tissue: number; beyond: number[] }) {
    const { gpu, fields } = this,
      { gl, floats } = gpu,
      { volume, table } = this.voxels,
      width = 6 * SIDE_SAMPLES,
      height = SIDE_SAMPLES;
    if (!volume || !table) return [];
    const at = gpu.use(gpu.program("sides", SIDES, definesOf("", fields)), gpu.target("sides", width, height));
    gpu.setSamplers(at);
    this.#setVolumeNumbers(at, volume, table, 1, volume.box);
    fields.setNumbers(at, fields, volume.spacing);
    gl.uniform3fv(at("boxLow"), volume.box.low); // of all of it, clipped or not
    gl.uniform3fv(at("boxHigh"), volume.box.high);
    gl.uniform3fv(at("beyond"), beyond);
    gl.uniform1f(at("tissue"), tissue);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const seen = floats ? new Float32Array(4 * width * height) : new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, floats ? gl.FLOAT : gl.UNSIGNED_BYTE, seen);
    const counts = new Array<number>(6).fill(0);
    for (let i = 0; i < width * height; i++) if (seen[4 * i]! > 0) counts[Math.floor((i % width) / SIDE_SAMPLES)]! += 1;
    return counts.flatMap((count, side) => (count >= FEWEST_SEEN ? [side] : []));
  }

  /**
   * Show a picture on the canvas, over the background; one that has parts side by side has it behind each. What has
   * fewer pixels than the canvas is enlarged smoothly. `isQuick`: the canvas gets
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
    const { gpu } = this,
      { gl, targets } = gpu,
      ground = BACKGROUNDS[this.background];
    const [width, height] = name && isQuick ? [targets[name]!.width, targets[name]!.height] : this.size;
    gpu.fit(width, height);
    const nothing: Pick<Target, "width" | "height"> & { texture: WebGLTexture | null } = {
      texture: null,
      width,
      height,
    };
    const first = name ? targets[name]! : nothing,
      second = over ? targets[over]! : first,
      at = gpu.use(gpu.program("present", PRESENT), null);
    gpu.setPicture(at, "picture", first.texture);
    gl.uniform2f(at("extent"), first.width, first.height);
    gpu.setPicture(at, "second", second.texture);
    gl.uniform2f(at("secondExtent"), second.width, second.height);
    gl.uniform1f(at("share"), over ? share : 0);
    gl.uniform2f(at("resolution"), width, height);
    gl.uniform1f(at("parts"), parts);
    gl.uniform3fv(at("centre"), ground.centre);
    gl.uniform3fv(at("corner"), ground.corner);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}
