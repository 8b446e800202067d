// The voxels of a volume and their colours and opacities, on the GPU.

import { AMBIENT_CELL } from "../generated.ts";
import { blockPairs } from "./empty_space.ts";
import { type Gpu, UNITS } from "./gpu.ts";
import type { CastVolume, ColorTable, VolumeData } from "./types.ts";
import { ambientLight, blockExtremes, blockOpacities, GradientSlabs } from "./volume_blocks.ts";

const FINEST = 2047; // entries of the table that is looked up without interpolation: 2048 fit into any texture

export class MemoryError extends Error {}
export const NOT_HELD = "The graphics memory does not hold this volume.";

export class VoxelTextures {
  volume: CastVolume | null = null;
  table: ColorTable | null = null;
  /** Of the volume's blocks: see empty_space.js */
  pairs: Record<"opacity" | "value", Uint8Array> = { opacity: new Uint8Array(), value: new Uint8Array() };

  constructor(readonly gpu: Gpu) {}

  /**
   * Take a volume of bytes [z][y][x]. `tick` is awaited between slabs so that the page stays alive. Returns false if
   * another volume came in meanwhile.
   */
  async setVolume(values: Uint8Array, info: VolumeData, tick?: (share: number) => Promise<void>) {
    const { gl } = this.gpu,
      [nx, ny, nz] = info.shape;
    const volume: CastVolume = { ...info, values, extremes: null, loaded: false };
    this.volume = volume;
    this.gpu.texture("volume", gl.TEXTURE_3D, !info.isLabels);
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
    const { gl } = this.gpu;
    if (gl.getError() !== gl.OUT_OF_MEMORY) return;
    this.volume = null;
    this.gpu.texture("volume", gl.TEXTURE_3D, true);
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGBA8, 1, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    throw new MemoryError(NOT_HELD);
  }

  /**
   * Take colours and opacities: (255 k + 1) x 4 floats, every k-th for a byte; opacities of a thickness of `unit`.
   */
  setTable(rgba: Float32Array, unit: number) {
    this.table = { rgba, unit, step: 0 };
    if (!this.volume?.extremes) return;
    const { gl } = this.gpu,
      { extremes, values, shape, spacing } = this.volume;
    const alphas = Float32Array.from({ length: rgba.length / 4 }, (_, i) => rgba[4 * i + 3]!);
    this.pairs = {
      opacity: blockPairs(blockOpacities(extremes, alphas), extremes.size),
      value: blockPairs(extremes.high, extremes.size),
    };
    const light = ambientLight(values, shape, alphas, (AMBIENT_CELL * Math.min(...spacing)) / unit);
    this.gpu.texture("ambience", gl.TEXTURE_3D, true);
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.R8, ...light.size, 0, gl.RED, gl.UNSIGNED_BYTE, light.values);
  }

  /**
   * Fit the table to a step. Opacities hold for one thickness: they are recomputed for the step of this picture rather
   * than with a power at every sample.
   */
  fitTable(table: ColorTable, step: number) {
    const { rgba, unit } = table,
      { gl } = this.gpu;
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
    this.gpu.texture("table", gl.TEXTURE_2D, false);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, fitted.length / 4, 1, 0, gl.RGBA, gl.FLOAT, fitted);
  }
}
