// Shapes of the data that several modules share. What messages and documents hold is described in generated.ts.

import type { AnyModel } from "@anywidget/types";
import type { BoxData, CutData, LineData, MotionData, PartData, PointData, PolygonData } from "./generated.ts";
import type { PlayClock } from "./inputs/player.ts";
import type { Sender } from "./sync/edits.ts";

export type { CutData, HalfSpaceData, LineData, MaskData, PartData, PolygonData, RegionData } from "./generated.ts";

/** A model of a widget: anywidget's, or one of sync/host_model.js. */
export type Model = AnyModel;

/** Values by their names, as Python sends and receives them: traits of a model, or the content of a message. */
// biome-ignore lint/suspicious/noExplicitAny: JSON enters here
export type Values = Record<string, any>;

/** A message without the fields that are added where all messages of a widget are sent. */
export type Without<Message, Field extends PropertyKey> = Message extends unknown ? Omit<Message, Field> : never;

/** A handler of a model's event; its arguments depend on the event. */
export type ModelHandler = Parameters<Model["on"]>[1];

/** The handlers of a widget, by the events of its model. */
export type Handlers = [name: string, handler: ModelHandler][];

/** A place or a displacement: (a, b) in a picture. */
export type Vector2 = [number, number];

/** A place or a displacement in space: (x, y, z) in the volume's unit. */
export type Vector3 = [number, number, number];

/** Four numbers, such as two rows of a matrix in one. */
export type Vector4 = [number, number, number, number];

/** A place or a displacement of a picture or in space. */
export type Vector = [number, number, ...number[]];

/** Typed arrays of so many numbers. */
export type Numbers2 = Float64Array & Record<0 | 1, number>;
export type Numbers3 = Numbers2 & Record<2, number>;
export type Numbers6 = Numbers3 & Record<3 | 4 | 5, number>;

/** Two rows of a matrix. */
export type Matrix2 = [Vector2, Vector2];

/** Three rows, or columns, of a matrix. */
export type Matrix3 = [Vector3, Vector3, Vector3];

/** Rows of a matrix of two or three rows and columns. */
export type Matrix = [Vector, Vector, ...Vector[]];

/** A control point of a picture (two coordinates) or of a volume (three). */
export interface Point<V extends Vector = Vector> extends PointData {
  source: V;
  target: V;
  /** In the list that people see, from 1: only within a fit, of whose points some may be left out */
  number?: number;
}

export type PicturePoint = Point<Vector2>;
export type SpacePoint = Point<Vector3>;

export type OutlineData = PolygonData | LineData;

/** A forward motion; null is at rest. */
export type Motion = MotionData | null;

/** A cut or a rigid part. */
export type ShapeData = CutData | PartData;

/** A motion in space: y = matrix x + shift. */
export interface SpaceMotion {
  matrix: Matrix3;
  shift: Vector3;
}

/** A region in space. */
export type SpaceRegion = { kind: "half_space"; point: Vector3; normal: Vector3 } | ({ kind: "mask" } & SpaceMask);

/** A rigid part of a step in space, for which messages have the type of one on a picture. */
export interface SpacePart extends Omit<PartData, "region" | "motion" | "pivot"> {
  region: SpaceRegion;
  motion: SpaceMotion | null;
  pivot?: Vector3 | null;
}

/** A kernel that was registered in Python, as deformnb/widgets/kernel_table.py writes it. */
export interface KernelTable {
  name: string;
  title: string;
  order: number;
  compact: boolean;
  share: number;
  /** Null is without a limit. */
  gaps: number | null;
  pieces: number;
  numbers: string;
}

/** Settings of a fit; each may be left out. */
export interface FitSettings {
  kernel?: string;
  /** Of a kernel that is registered in Python. */
  kernel_table?: KernelTable;
  support?: number | "box_diagonal" | null;
  chosen_support?: number | null;
  trend?: string;
  smoothing?: number;
  strength?: number;
  lone_support?: number | null;
  stages?: number | null;
  direction?: string;
  cuts?: CutData[];
  parts?: PartData[];
  cut_rule?: string;
}

/** Pixels of a picture: [rows, columns], and the distances between and the place of the first. */
export interface Raster {
  shape: [number, number];
  spacing: Vector2;
  origin: Vector2;
}

/** Nodes in space along x, y and z, and the distances between and the place of the first. */
export interface Lattice {
  shape: Vector3;
  spacing: Vector3;
  origin: Vector3;
}

/** The voxels of a region in space, as MaskData has the pixels of one in a picture: [z, y, x], its axes by columns. */
export interface SpaceMask extends Lattice {
  direction: number[];
  bits: string;
}

/** The raster of a picture, and what its pixels mean: see picture_png in editor.py. */
export interface PictureRaster extends Raster {
  channels?: number;
  /** What is beyond a picture in colour: a grey from 0, black, to 255; default is 0 */
  beyond?: number;
  range?: Vector2;
  window?: Vector2;
  unit?: string;
  lengths?: string;
}

/** A region made ready for use. */
export interface Region {
  kind: string;
  /** Signed distance to the boundary, negative inside. */
  distance: (a: number, b: number) => number;
  /** A quicker distance for all places not farther than `radius` from (a, b). */
  near: (a: number, b: number, radius: number) => (a: number, b: number) => number;
  /** The pixels of a mask. */
  isSet?: Uint8Array;
  /** The number of edges of an outline. */
  edges?: number;
  /** Of a line that stops: how far a cut is open at a place before the deformation, and its slopes: [w, wa, wb]. */
  opening?: (a: number, b: number, out: Numbers3) => Numbers3;
}

/** A fit of control points; coordinates in it are relative to `origin`, in units of `support`. */
export interface RbfFit {
  count: number;
  /** Support / radius of each point, or null where all points share one radius. */
  scales: Float64Array | null;
  centers: Float64Array;
  coefficients: Float64Array;
  linear: Matrix;
  constant: Vector;
  /** Symmetric matrices of the trend "quadratic", one for each component; null for the others. */
  quadratic: [Matrix, Matrix, ...Matrix[]] | null;
  origin: Vector;
  support: number;
  kernel: string;
  trend: string;
  ids: number[];
  /** Remarks for the user. */
  notes: string[];
}

/** A rigid part made ready for evaluation. The last three fields are scratch values of the place evaluated last. */
export interface ReadyPart {
  part: PartData;
  scale: number;
  /** The backward motion: x -> m x + s, m row by row. */
  back: { m: Vector4; s: Vector2; isStill: boolean };
  distance: (a: number, b: number) => number;
  /** The weight of the smooth displacement as a function of the relative distance. */
  step: (value: number) => number;
  pa: number;
  pb: number;
  d: number;
}

/** The fits of a region with and without each cut that stops; bit k of a place is set where cut k parts the points. */
export interface TipBlend {
  /** Null where there are no points. */
  fits: (Fit | null)[];
  openings: NonNullable<Region["opening"]>[];
}

/**
 * Any fit: a plain one, one with rigid parts (`base` and `rigid`), the inverse of one `forward`, one in stages, or one
 * blended at tips of cuts.
 */
export interface Fit extends RbfFit {
  base?: RbfFit;
  rigid?: ReadyPart[];
  stages?: Fit[];
  forward?: RbfFit;
  blend?: TipBlend;
  /** While something moves: the displacements that replace those of the fit. */
  sampled?: Sampled;
}

/** The displacements of a fit at the nodes of a raster, the component last. */
export interface Sampled {
  raster: Raster;
  values: ArrayLike<number>;
  fit: Fit;
  /** Whether nobody looks beyond the nodes: the displacement of the nearest one will do there */
  isClamped?: boolean;
}

/** Fits separated by cuts. */
export interface LayeredFit {
  /** `key`: the sides of the cuts as one number, bit k is set inside cut k. */
  fits: { key: number; sides: boolean[]; fit: Fit }[];
  regions: Region[];
  rule: string;
  /** The only fit where there are no cuts, else null. */
  fit: Fit | null;
  /** The index in `fits` of each key. */
  byKey: Map<number, number>;
  notes: string[];
  count: number;
  /** Whether there are regions without points. */
  hasRest: boolean;
}

/** A plane in space: a place on it, the directions of rows and columns of pictures, and its normal. */
export interface Plane {
  origin: Vector3;
  u: Vector3;
  v: Vector3;
  n: Vector3;
}

/** The geometry of a picture of a volume: a and b run to the right and down in it, c into it, in the volume's unit. */
export interface PaneInfo extends Plane {
  name: string;
  /** [a0, a1, b0, b1, c0, c1] */
  box: [...Vector4, number, number];
  /** The first and the last depth of a slice. */
  depths: Vector2;
  spacing: Vector3;
  /** The unit of lengths, as it is shown. */
  lengths?: string;
  /** Whether the sides of a patient are known. */
  anatomical?: boolean;
}

/** A point of a volume as it is drawn in a picture; `away` is its distance behind the slice. */
export interface FlatPoint {
  id: number;
  name: string;
  active: boolean;
  locked?: boolean;
  source: Vector2;
  target: Vector2;
  away: number;
  isFar: boolean;
  whole: SpacePoint;
}

/** A mirror: in a picture the coordinate that changes its sign, in space the normal of its plane; `at` along that. */
export interface Mirror {
  on: boolean;
  axis?: string;
  normal?: Vector3;
  at: number;
}

/** A box, or the sides of one, along the axes of a volume. */
export type Sides = BoxData;

/** The detail of the event "deformnb:points" of a bus. */
export interface PointsDetail {
  /** The id of the view that published them. */
  origin: string;
  points: Point[];
  settings: FitSettings;
  /** The result of layeredFit, null where the points cannot be fitted; editors of volumes leave it out. */
  layered?: LayeredFit | null;
  /** While something moves the same at the nodes of the picture, from when the picture is drawn; views take it. */
  sampled?: LayeredFit | null;
  fit: Fit | null;
  phase: "move" | "end";
}

/** The detail of the event "deformnb:time" of a bus. */
export interface TimeDetail {
  time: number;
  isPlaying: boolean;
}

/** The details of the events of a bus. */
export interface BusEvents {
  "deformnb:points": PointsDetail;
  "deformnb:time": TimeDetail;
}

/** The event target that all views of one editor or player share in a window. */
/** A tool's stroke from a view of the volume; places are those of the editor. */
export interface ViewStroke {
  move(place: Vector, event: PointerEvent): void;
  end(isCancelled: boolean): void;
}

/**
 * The tools of an editor that is drawn in the window, for its points in a view of the volume. Places and displacements
 * are the editor's: in its picture, or in space.
 */
export interface EditorTools {
  /** Whether a press adds a point. */
  readonly isAdding: boolean;
  /** Whether a tool is on, such as a brush, to which a press belongs. */
  readonly hasTool: boolean;
  /** Radius of the brush that is on; 0 for none. */
  readonly radius: number;
  /** Begin a drag of points; false where nothing may be moved. */
  begin(): boolean;
  move(ids: number[], way: Vector, what: "target" | "source" | "both", id: number, isLoose: boolean): void;
  end(isCancelled: boolean): void;
  /** Add a point that holds the tissue at a place; null, and a hint, where there is none. */
  add(place: Vector): number | null;
  remove(ids: number[]): void;
  nudge(ids: number[], way: Vector): void;
  /** Begin a stroke of the tool that is on, or null. */
  press(place: Vector, isFinger: boolean): ViewStroke | null;
  /** A key of the editor; true if it was taken. */
  key(event: KeyboardEvent): boolean;
}

export interface Bus extends EventTarget {
  latest: PointsDetail | null;
  owners: number;
  /** The tools of the editor's views in the window, the newest last. */
  tools?: EditorTools[];
  sender?: Sender<Vector> | null;
  /** The number of open views of an editor. */
  views?: number;
  /** Whether a view that follows is drawn on the processors that the editor needs too */
  isShared?: boolean;
  clock?: PlayClock;
  moment?: TimeDetail;
  addEventListener(type: "deformnb:points", listener: (event: CustomEvent<PointsDetail>) => void): void;
  addEventListener(type: "deformnb:time", listener: (event: CustomEvent<TimeDetail>) => void): void;
  addEventListener(
    type: string,
    listener: EventListenerOrEventListenerObject | null,
    options?: boolean | AddEventListenerOptions,
  ): void;
  removeEventListener(type: "deformnb:points", listener: (event: CustomEvent<PointsDetail>) => void): void;
  removeEventListener(type: "deformnb:time", listener: (event: CustomEvent<TimeDetail>) => void): void;
  removeEventListener(
    type: string,
    listener: EventListenerOrEventListenerObject | null,
    options?: boolean | EventListenerOptions,
  ): void;
}

/** The cuts and the rigid parts of an editor. */
export interface Shapes {
  cuts: CutData[];
  parts: PartData[];
}

export type ShapeKind = keyof Shapes;
