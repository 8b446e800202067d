// Shapes of the data that several modules share, as Python sends them and as the documents hold them.

import type { AnyModel } from "@anywidget/types";

/** A model of a widget: anywidget's, or one of sync/host_model.js. */
export type Model = AnyModel<any>;

/** A place or a displacement: (a, b) in a picture. */
export type Vector2 = [number, number];

/** A place or a displacement in space: (x, y, z) in the volume's unit. */
export type Vector3 = [number, number, number];

/** Two rows of a matrix. */
export type Matrix2 = [Vector2, Vector2];

/** A control point of a picture (two coordinates) or of a volume (three). */
export interface Point {
  id: number;
  name: string;
  source: number[];
  target: number[];
  active: boolean;
  weight: number;
  locked?: boolean;
  /** A support radius of its own, or null. */
  radius: number | null;
}

/** A region of a picture, by its kind: line, polygon, half space, mask. */
export interface RegionData {
  kind: string;
  [key: string]: any;
}

/** A cut: what lies in the region is deformed by its own points alone. */
export interface CutData {
  name: string;
  enabled: boolean;
  region: RegionData;
}

/** A forward motion y = matrix x + shift; null is at rest. */
export type Motion = { matrix: Matrix2; shift: Vector2 } | null;

/** A rigid part. */
export interface PartData extends CutData {
  weight: string;
  reach: number;
  motion: Motion;
}

/** A cut or a rigid part. */
export type ShapeData = CutData | PartData;

/** Settings of a fit; each may be left out. */
export interface FitSettings {
  kernel?: string;
  support?: number | string | null;
  chosen_support?: number | null;
  trend?: string;
  smoothing?: number;
  strength?: number;
  lone_support?: number | null;
  stages?: any;
  cuts?: CutData[];
  parts?: PartData[];
  cut_rule?: string;
  previous?: any;
}

/** Pixels of a picture: [rows, columns], and the distances between and the place of the first. */
export interface Raster {
  shape: [number, number];
  spacing: Vector2;
  origin: Vector2;
}
