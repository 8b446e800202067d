// Types of the ray caster's inputs and of its results. Lengths are physical, along the index axes of the
// volume, from its first voxel (its own frame).

import type { PlanarData, PlaneCutData, SpaceData } from "../generated.ts";
import type { Matrix3, Sides, Vector2, Vector3 } from "../types.ts";
import type { SpaceRanges } from "./empty_space.ts";

/** Smallest and largest value of every block of voxels. */
export interface Extremes {
  size: Vector3;
  low: Uint8Array;
  high: Uint8Array;
}

/** The voxels of a volume, apart from their values. */
export interface VolumeData {
  shape: Vector3;
  spacing: Vector3;
  /** The value beyond the volume, 0 to 255. */
  outside: number;
  isLabels: boolean;
  /** The window of a projection of largest values. */
  grey?: Vector2;
  /** The share of the range of all values that the bytes cover. */
  share?: number;
  /** The box of the result, which is shown. */
  box: Sides;
  /** The box of the volume itself. */
  ownBox: Sides;
}

/** A volume that the ray caster holds; it has extremes as soon as all of it is on the GPU. */
export interface CastVolume extends VolumeData {
  values: Uint8Array;
  extremes: Extremes | null;
  loaded: boolean;
}

/** Colours and opacities, `rgba` with four numbers for each entry. */
export interface ColorTable {
  rgba: Float32Array;
  /** The thickness that the opacities hold for. */
  unit: number;
  /** The thickness that the texture was made for. */
  step: number;
}

/** The cuts of a planar field. */
export interface PlaneCut extends Omit<PlaneCutData, "rule" | "id" | "regions"> {
  /** Signed distances to each cut, negative inside. */
  distances: Float32Array;
  /** It may be missing of cuts that have just been drawn. */
  rule?: string;
  /** Id of the distances that Python has sent. */
  id?: string;
  /** The regions of the cuts in words: as Python sends them, or as one text. */
  regions?: unknown;
  name?: string;
}

/** Backward displacement by maps over a plane, [layer][row][column][2]. */
export interface PlanarField extends Omit<PlanarData, "cut"> {
  maps: Float32Array;
  /** [map of a region][knot] */
  weights: Float32Array;
  cut: PlaneCut | null;
}

/** Backward displacement sampled in space, [z][y][x][3]; at cuts in half precision, see FieldTextures.setSpace. */
export interface SpaceField extends SpaceData {
  values: Float32Array | Uint16Array;
  depths?: Float32Array | Uint16Array;
}

/** Map to texture coordinates: a matrix, column by column, and an offset. */
export interface ToTexture {
  matrix: Matrix3;
  offset: Vector3;
}

/** A planar field with the metadata for the shader. */
export interface CastPlanar extends PlanarField {
  /** Maps of each region. */
  count: number;
  folds: boolean;
  toMap: ToTexture;
  cut: (PlaneCut & { toCut: ToTexture; scale: Vector2; bits: number[] }) | null;
}

/** A displacement in space with the metadata for the shader. */
export interface CastSpace extends SpaceField {
  folds: boolean;
  ranges: SpaceRanges;
  toSpace: Vector3;
  toSpace0: Vector3;
}

/** A camera in the volume's frame: right and up are half of the picture's extent; ahead has length 1. */
export interface RayCamera {
  eye: Vector3;
  right: Vector3;
  up: Vector3;
  ahead: Vector3;
  /** Strength of the perspective, per length; 0 is parallel. */
  bend: number;
}

/** The picture in some columns of a canvas. */
export interface Picture {
  /** The layer that alternates with others, or 0. */
  layer: number;
  /** The first column and how many there are. */
  x: number;
  width: number;
  /** The columns of the larger picture that it is a part of; its camera is that of the whole. */
  whole?: { x: number; width: number };
  /** Whether the displacement is left out. */
  original: boolean;
  camera: RayCamera;
}
