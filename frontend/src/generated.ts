// Written by: python -m deformnb.widgets.generate. Change the modules of the package that it names.

// deformnb/checks.py
export const LARGEST_COORDINATE = 1000000000000000.0;

// deformnb/volume/volume.py
export const ORTHONORMAL_TOLERANCE = 0.0002;
export const SPACING_LIMITS = [1e-12, 1000000000000.0] as const;
export const ONE_VALUE = "every voxel has the value {n}: there is nothing to see in this volume; check how it was made or read, or open another";
export const NO_VALUE = "no voxel is a finite number: there is nothing to see in this volume; check how it was made or read, or open another";

// deformnb/volume/units.py
export const UNIT_METRES = {"Ym": 1e+24, "Zm": 1e+21, "Em": 1e+18, "Pm": 1000000000000000.0, "Tm": 1000000000000.0, "Gm": 1000000000.0, "Mm": 1000000.0, "km": 1000.0, "hm": 100.0, "m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "\u00b5m": 1e-06, "nm": 1e-09, "pm": 1e-12, "fm": 1e-15, "am": 1e-18, "zm": 1e-21, "ym": 1e-24, "\u00c5": 1e-10, "in": 0.0254, "ft": 0.3048, "yd": 0.9144, "mi": 1609.344, "pc": 3.085677581491367e+16};
export const UNIT_WORDS = {"Ym": "Ym", "yottameter": "Ym", "yottameters": "Ym", "yottametre": "Ym", "yottametres": "Ym", "Zm": "Zm", "zettameter": "Zm", "zettameters": "Zm", "zettametre": "Zm", "zettametres": "Zm", "Em": "Em", "exameter": "Em", "exameters": "Em", "exametre": "Em", "exametres": "Em", "Pm": "Pm", "petameter": "Pm", "petameters": "Pm", "petametre": "Pm", "petametres": "Pm", "Tm": "Tm", "terameter": "Tm", "terameters": "Tm", "terametre": "Tm", "terametres": "Tm", "Gm": "Gm", "gigameter": "Gm", "gigameters": "Gm", "gigametre": "Gm", "gigametres": "Gm", "Mm": "Mm", "megameter": "Mm", "megameters": "Mm", "megametre": "Mm", "megametres": "Mm", "km": "km", "kilometer": "km", "kilometers": "km", "kilometre": "km", "kilometres": "km", "hm": "hm", "hectometer": "hm", "hectometers": "hm", "hectometre": "hm", "hectometres": "hm", "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m", "dm": "dm", "decimeter": "dm", "decimeters": "dm", "decimetre": "dm", "decimetres": "dm", "cm": "cm", "centimeter": "cm", "centimeters": "cm", "centimetre": "cm", "centimetres": "cm", "mm": "mm", "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm", "\u00b5m": "\u00b5m", "micrometer": "\u00b5m", "micrometers": "\u00b5m", "um": "\u00b5m", "\u03bcm": "\u00b5m", "\ufffdm": "\u00b5m", "\u00c2\u00b5m": "\u00b5m", "micron": "\u00b5m", "microns": "\u00b5m", "mcm": "\u00b5m", "micrometre": "\u00b5m", "micrometres": "\u00b5m", "nm": "nm", "nanometer": "nm", "nanometers": "nm", "nanometre": "nm", "nanometres": "nm", "pm": "pm", "picometer": "pm", "picometers": "pm", "picometre": "pm", "picometres": "pm", "fm": "fm", "femtometer": "fm", "femtometers": "fm", "femtometre": "fm", "femtometres": "fm", "am": "am", "attometer": "am", "attometers": "am", "attometre": "am", "attometres": "am", "zm": "zm", "zeptometer": "zm", "zeptometers": "zm", "zeptometre": "zm", "zeptometres": "zm", "ym": "ym", "yoctometer": "ym", "yoctometers": "ym", "yoctometre": "ym", "yoctometres": "ym", "\u00c5": "\u00c5", "angstrom": "\u00c5", "angstroms": "\u00c5", "\u212b": "\u00c5", "A": "\u00c5", "ang": "\u00c5", "in": "in", "inch": "in", "inches": "in", "\"": "in", "ft": "ft", "foot": "ft", "feet": "ft", "yd": "yd", "yard": "yd", "yards": "yd", "mi": "mi", "mile": "mi", "miles": "mi", "pc": "pc", "parsec": "pc", "parsecs": "pc"};
export const UNIT_LOWER_WORDS = {"parsecs": "pc", "parsec": "pc", "miles": "mi", "mile": "mi", "yards": "yd", "yard": "yd", "feet": "ft", "foot": "ft", "inches": "in", "inch": "in", "ang": "\u00c5", "angstroms": "\u00c5", "angstrom": "\u00c5", "yoctometres": "ym", "yoctometre": "ym", "yoctometers": "ym", "yoctometer": "ym", "zeptometres": "zm", "zeptometre": "zm", "zeptometers": "zm", "zeptometer": "zm", "attometres": "am", "attometre": "am", "attometers": "am", "attometer": "am", "femtometres": "fm", "femtometre": "fm", "femtometers": "fm", "femtometer": "fm", "picometres": "pm", "picometre": "pm", "picometers": "pm", "picometer": "pm", "nanometres": "nm", "nanometre": "nm", "nanometers": "nm", "nanometer": "nm", "nm": "nm", "micrometres": "\u00b5m", "micrometre": "\u00b5m", "mcm": "\u00b5m", "microns": "\u00b5m", "micron": "\u00b5m", "\u00e2\u00b5m": "\u00b5m", "um": "\u00b5m", "micrometers": "\u00b5m", "micrometer": "\u00b5m", "millimetres": "mm", "millimetre": "mm", "millimeters": "mm", "millimeter": "mm", "mm": "mm", "centimetres": "cm", "centimetre": "cm", "centimeters": "cm", "centimeter": "cm", "cm": "cm", "decimetres": "dm", "decimetre": "dm", "decimeters": "dm", "decimeter": "dm", "metres": "m", "metre": "m", "meters": "m", "meter": "m", "hectometres": "hm", "hectometre": "hm", "hectometers": "hm", "hectometer": "hm", "kilometres": "km", "kilometre": "km", "kilometers": "km", "kilometer": "km", "megametres": "Mm", "megametre": "Mm", "megameters": "Mm", "megameter": "Mm", "gigametres": "Gm", "gigametre": "Gm", "gigameters": "Gm", "gigameter": "Gm", "terametres": "Tm", "terametre": "Tm", "terameters": "Tm", "terameter": "Tm", "petametres": "Pm", "petametre": "Pm", "petameters": "Pm", "petameter": "Pm", "exametres": "Em", "exametre": "Em", "exameters": "Em", "exameter": "Em", "zettametres": "Zm", "zettametre": "Zm", "zettameters": "Zm", "zettameter": "Zm", "yottametres": "Ym", "yottametre": "Ym", "yottameters": "Ym", "yottameter": "Ym"};
export const NO_UNITS = ["", "pixel", "pixels", "px", "voxel", "voxels", "vx", "unknown", "none", "null", "?", "arbitrary", "reference frame", "referenceframe", "unitless", "dimensionless", "index"];

// deformnb/volume/transfer.py
export const HISTOGRAM_SLICES = 64;
export const BINS = 256;
export const OUTLIERS = 0.0001;
export const AIR_SHARE = 0.97;
export const NEAR_AIR = 0.2;
export const NEAR_TISSUE = 0.3;
export const STRETCH = 16;
export const FEW_VOXELS = 512;
export const AIR_HU = -700.0;
export const BONE_HU = 300.0;
export const NOTHING_HU = -1100.0;
export const RESAMPLED = 0.02;
export const FINEST = 8;

// deformnb/rbf/conditioning.py
export const LARGEST_SET = 2000;
export const SAME_PLACE = 1e-06;
export const SAME_DISPLACEMENT = 1e-09;
export const LONGEST_SHARE = 100.0;
export const COLLAPSED = 1e-06;
export const FAR_BEHIND = 12;
export const SAME_DISTANCE = 1e-06;
export const NEAREST = 4;
export const NEAREST_AND_EQUAL = 12;

// deformnb/rbf/cross_validation.py
export const MOST_LEFT_OUT = 512;

// deformnb/rbf/exactness.py
export const RESIDUAL = 1e-07;
export const ROUNDING = 1e-10;
export const MOST_MISSED = 0.0001;

// deformnb/rbf/interpolant.py
export const MOST_GAIN = 100000.0;
export const STEEP = 10.0;

// deformnb/rbf/kernels.py
export const TINY = 1e-30;

// deformnb/rbf/trends.py
export const NO_ANGLE = 1e-06;
export const FLAT = 1e-07;
export const THIN = 0.25;
export const THIN_BEND = 0.0625;
export const SOFTNESS = 0.5;
export const LEAST_SPREAD = 0.0001;

// deformnb/rbf/regions.py
export const LARGEST_SHAPE = 512;

// deformnb/rbf/rigid.py
export const SAME_MOTION = 1e-06;

// deformnb/rbf/slits.py
export const MOST_SLITS = 3;

// deformnb/rbf/stages.py
export const MOST_STAGES = 64;

// deformnb/rbf/newton.py
export const SHORTEST_STEP = 0.0001;

// deformnb/rbf/forward.py
export const AIM = 1e-12;
export const FOUND = 1e-09;
export const MOST_NEWTON_STEPS = 50;
export const SEEDS = {"2": 64, "3": 16} as const;
export const SEEDS_AROUND = 0.5;
export const TRIED = 4;

// deformnb/analysis/folds.py
export const NEARLY_FOLDED = 0.05;

// deformnb/warping/foreground.py
export const LEAVES = 0.01;
export const PICTURE_SIDES = ["left side", "right side", "top", "bottom"];
export const CUT_OFF = "Tissue leaves the box at the {sides}, and is cut off there.";
export const LARGER_BOX = "Make the box larger";
export const LARGER_BOX_TIP = "As large as needed, now and after every edit: then nothing is cut off";

// deformnb/imaging/occlusion.py
export const AMBIENT_CELL = 4;
export const AMBIENT_NEAR = [1, 1.0] as const;
export const AMBIENT_FAR = [3, 4.0] as const;
export const AMBIENT_AHEAD = 3.0;
export const AMBIENT_EVEN = 0.04;

// deformnb/imaging/demo.py
export const SUBJECT_LEVEL = 0.08;
export const SUBJECT_SHARE = 0.01;

// deformnb/imaging/picking.py
export const FAINT_VALUE = 0.02;

// deformnb/imaging/projection.py
export const SATURATED = 0.005;
export const METAL = 3000.0;

// deformnb/io/files/streams.py
export const MOST_PACKED = 1040;

// deformnb/io/volumes/headers.py
export const HEADER_BYTES = 1048576;
export const MOST_SKIPPED = 67108864;

// deformnb/io/volumes/nifti.py
export const FIRST_VOXEL = 352;
export const LABEL_INTENT = 1002;
export const MOST_EXTENSIONS = 67108864;

// deformnb/session/inputs.py
export const SILHOUETTE_SMOOTHING = 0.01;

// deformnb/widgets/camera.py
export const VIEW_AIR = 1.02;
export const SMALLEST_SHARE = 0.62;

// deformnb/widgets/packed_volume.py
export const MOST_VOXELS_SENT = 16777216;
export const PACKED_CHUNK_BYTES = 2097152;

// deformnb/widgets/textures.py
export const MAP_SIZE = 192;
export const MOST_REGIONS = 32;
export const CUT_MARGIN = 0.125;
export const CUT_STEPS = 512;

// deformnb/widgets/vtk/folds.py
export const MOST_BENDS = 64;

// deformnb/widgets/messages/record.py
export const LONGEST_EDIT = 1048576;

// deformnb/widgets/messages/editors.py
export const LONGEST_KIND = 80;
export const MOST_CHANGES = 50;
export const MOST_NAMED = 64;
export const WINDOWS_AROUND = 16;

// deformnb/widgets/messages/shapes.py
export const MOST_PARTS = 32;

// deformnb/widgets/messages/inputs.py
export const LONGEST_ROW_NAME = 100;
export const MOST_KEYS = 64;

// deformnb/widgets/messages/views.py
export const LARGEST_SIDE = 4096;
export const MOVIE_PIECE = 262144;

// Kernels and trends in their order, without the formulas: deformnb/rbf/kernels.py, trends.py
export const KERNEL_FACTS = {
  wendland_c2: { title: "Wendland C2", order: 0, compact: true, share: 1.0, gaps: 16.0 },
  wendland_c0: { title: "Wendland C0", order: 0, compact: true, share: 1.0, gaps: Infinity },
  wendland_c4: { title: "Wendland C4", order: 0, compact: true, share: 1.0, gaps: 8.0 },
  thin_plate: { title: "Thin-plate spline", order: 2, compact: false, share: 1.0, gaps: Infinity },
  gaussian: { title: "Gaussian", order: 0, compact: false, share: 0.25, gaps: 2.0 },
  multiquadric: { title: "Multiquadric", order: 1, compact: false, share: 0.25, gaps: 1.0 },
  inverse_multiquadric: { title: "Inverse multiquadric", order: 0, compact: false, share: 0.25, gaps: 1.0 },
  inverse_quadratic: { title: "Inverse quadratic", order: 0, compact: false, share: 0.25, gaps: 1.0 },
  cubic: { title: "Cubic", order: 2, compact: false, share: 1.0, gaps: Infinity },
  quintic: { title: "Quintic", order: 3, compact: false, share: 1.0, gaps: Infinity },
  linear: { title: "Linear", order: 1, compact: false, share: 1.0, gaps: Infinity },
};
export const TREND_FACTS = {
  affine: { title: "Affine", order: 2 },
  similarity: { title: "Similarity (turn, scale, shift)", order: 1 },
  rigid: { title: "Rigid (turn, shift)", order: 1 },
  translation: { title: "Translation", order: 1 },
  none: { title: "None", order: 0 },
  affine_exact: { title: "Affine, exact across a row of points too", order: 2 },
  quadratic: { title: "Quadratic", order: 3 },
};

// Names that the registries of the package have.
export const KERNELS = ["cubic", "gaussian", "inverse_multiquadric", "inverse_quadratic", "linear", "multiquadric", "quintic", "thin_plate", "wendland_c0", "wendland_c2", "wendland_c4"] as const;
export type Kernel = (typeof KERNELS)[number];
export const TRENDS = ["affine", "similarity", "rigid", "translation", "none", "affine_exact", "quadratic"] as const;
export type Trend = (typeof TRENDS)[number];
export const DIRECTIONS = ["backward", "forward"] as const;
export type Direction = (typeof DIRECTIONS)[number];
export const EXTRUSIONS = ["replicate", "modulate", "interpolate"] as const;
export type Extrusion = (typeof EXTRUSIONS)[number];
export const CUT_RULES = ["source", "paper"] as const;
export type CutRule = (typeof CUT_RULES)[number];
export const MODES = ["compose", "blend"] as const;
export type Mode = (typeof MODES)[number];
export const LOOPS = ["once", "loop", "swing"] as const;
export type Loop = (typeof LOOPS)[number];
export const OVERLAYS = ["none", "folds", "area", "strain", "uncertainty"] as const;
export type Overlay = (typeof OVERLAYS)[number];
export const SHOWS = ["deformed", "original", "side_by_side", "flicker", "wipe", "fade"] as const;
export type Shows = (typeof SHOWS)[number];
export const COMPARISONS = ["wipe", "fade"] as const;
export type Comparison = (typeof COMPARISONS)[number];

// Bounds of numbers that a user sets: deformnb/widgets/parameters.py
export const PARAMETER_BOUNDS = {
  depth: { low: 0.0, high: 1.0, step: 0.005, digits: 2 },
  density: { low: 0, high: 64, step: 1, digits: 0 },
  support: { low: 0.02, high: 4.0, step: 0.01, digits: 3 },
  smoothing: { low: 0.0, high: 2.0, step: 0.01, digits: 2 },
  strength: { low: -1.0, high: 3.0, step: 0.01, digits: 2 },
  stages: { low: 1, high: 64, step: 1, digits: 0 },
} as const;
export type ParameterName = "view" | "method" | "depth" | "colour_map" | "density" | "show_grid" | "drag_grid" | "show_radius" | "overlay" | "kernel" | "trend" | "support" | "automatic_support" | "smoothing" | "strength" | "stages" | "direction" | "keep_chosen" | "keep_free" | "extrusion" | "mode" | "cut_rule" | "projection" | "shows" | "movie_renderer" | "slices" | "ambient_occlusion" | "plane_frame" | "show_folds";

// Messages: deformnb/widgets/messages

/** A new front end; done answers it: Python receives. */
export interface Greeting {
  type: "greet";
  /** Id of the window; 1 to 40 characters. */
  sender: string;
  /** Number of the message, counted by the sender; from 0. */
  seq: number;
}

/** A control point, with two coordinates on a picture and three in space. */
export interface PointData {
  /** From 0. */
  id: number;
  /** At most 200 characters. */
  name: string;
  /** 2 to 3 items. */
  source: [number, number, ...number[]];
  /** 2 to 3 items. */
  target: [number, number, ...number[]];
  /** Whether it takes part in the fit. */
  active: boolean;
  /** How much it counts where the fit smooths. */
  weight: number;
  /** Whether tools leave it where it is. */
  locked: boolean;
  /** Support radius; null is the one of all points. */
  radius: number | null;
}

/** A forward motion y = matrix x + shift. */
export interface MotionData {
  /** Two rows, in space three; 2 to 3 items. */
  matrix: [[number, number], [number, number]];
  /** 2 to 3 items. */
  shift: [number, number];
}

/** A rigid part that is being dragged. */
export interface MovedPart {
  /** Its place among the parts; from 0. */
  index: number;
  /** Null at rest. */
  motion: MotionData | null;
}

/** Settings of the fit that an edit of points changes with them. */
export interface FitChange {
  /** Null is chosen by the points; from 0. */
  support?: number | null;
  /** Their number; 1 to 64. */
  stages?: number;
}

/** Control points that are being dragged or were edited. */
export interface PointsEdit {
  type: "edit";
  /** Id of the window; 1 to 40 characters. */
  sender: string;
  /** Number of the message, counted by the sender; from 0. */
  seq: number;
  /** "move" while something is dragged. */
  phase: "move" | "end";
  /** Kind of the edit. */
  kind: "move" | "nudge" | "add" | "remove" | "rename" | "switch" | "reset" | "undo" | "redo" | "several" | "lock" | "turn" | "scale" | "brush" | "open" | "straighten" | "apart";
  /** Whether it is one step of an undo with the edit before it. */
  joins?: boolean;
  /** Least id that was never given; from 0. */
  next_id?: number;
  /** All points after the edit. */
  points: PointData[];
  /** A rigid part that is being dragged. */
  part?: MovedPart | null;
  /** Settings of the fit that the edit changes too. */
  fit?: FitChange | null;
  /** Hz, pictures per second of the drag that ends, and ms, milliseconds to a picture. */
  drawn?: Record<string, number>;
}

/** A request to undo or redo, where Python owns the history. */
export interface HistoryRequest {
  type: "history";
  /** Id of the window; 1 to 40 characters. */
  sender: string;
  /** Number of the message, counted by the sender; from 0. */
  seq: number;
  way: "undo" | "redo";
}

/** The region within a closed outline. */
export interface PolygonData {
  kind: "polygon";
  vertices: [number, number][];
}

/** The region on the left of an open line, which continues without end. */
export interface LineData {
  kind: "line";
  vertices: [number, number][];
  /** Whether a cut along it stops at its first and at its last vertex; left out for neither; 2 items. */
  stops?: [boolean, boolean];
}

/** A half plane, or a half of space; the normal points out of it. */
export interface HalfSpaceData {
  kind: "half_space";
  /** 2 to 3 items. */
  point: [number, number];
  /** 2 to 3 items. */
  normal: [number, number];
}

/** The pixels or voxels of a region. */
export interface MaskData {
  kind: "mask";
  /** Rows and columns; 2 to 3 items. */
  shape: [number, number];
  spacing: [number, number];
  origin: [number, number];
  direction?: number[];
  /** Base64 of zlib of eight pixels to a byte, the first in the highest bit. */
  bits: string;
}

/** A rigid part. */
export interface PartData {
  /** At most 200 characters. */
  name: string;
  enabled: boolean;
  region: PolygonData | LineData | HalfSpaceData | MaskData;
  /** Name of the weight; at most 200 characters. */
  weight: string;
  /** Of its motion into its surroundings; null is automatic. */
  reach: number | null;
  /** Null is at rest. */
  motion: MotionData | null;
  /** Place about which it is turned, before its motion; null is the middle of its region; 2 to 3 items. */
  pivot?: [number, number] | null;
}

/** Cuts or rigid parts that were edited. */
export interface ShapesEdit {
  type: "shapes";
  /** Id of the window; 1 to 40 characters. */
  sender: string;
  /** Number of the message, counted by the sender; from 0. */
  seq: number;
  what: "cuts" | "parts";
  /** Name of the edit, such as "add cut"; 1 to 80 characters. */
  kind: string;
  /** All shapes of that sort. */
  shapes: (CutData | PartData)[];
  /** All points, where the edit has changed them. */
  points?: PointData[] | null;
  /** Whether such edits in quick succession are one step of an undo. */
  joins?: boolean;
}

/** A cut or rigid part that was chosen. */
export interface ShapeChoice {
  type: "choose";
  /** Id of the window; 1 to 40 characters. */
  sender: string;
  /** Number of the message, counted by the sender; from 0. */
  seq: number;
  /** Null for none. */
  what: "cuts" | "parts" | null;
  /** Place in the front end's list; from 0. */
  index?: number;
  /** The shape without the pixels of a mask: its place may be another one by now. */
  shape?: object;
}

/** A use of the wand; the trait wand has the answer. */
export interface WandRequest {
  type: "wand";
  /** What becomes of it. */
  what: "preview" | "part" | "cut" | "stop";
  /** That was clicked, of the original picture. */
  place: [number, number];
  /** In the unit of the picture's values; from 0. */
  tolerance: number;
  /** Which values are selected. */
  rule: "near" | "brighter" | "darker";
  /** Whether in the volume instead of in the picture. */
  through: boolean;
  /** Whether holes are filled. */
  fill?: boolean;
  /** How often the outline is smoothed; 0 to 50. */
  smooth?: number;
  /** Pixels by which it grows, or shrinks below 0; -50 to 50. */
  grow?: number;
  /** Whether only the largest piece is kept. */
  largest?: boolean;
}

/** The pointer of a window, which all windows that show the editor receive. */
export interface WindowPointer {
  type: "pointer";
  /** Id of the window; 1 to 40 characters. */
  window: string;
  /** On the picture; null away from it. */
  at: [number, number] | null;
  /** Ids of the points that it is dragging; at most 64 items. */
  drags: number[];
  /** Ids of the points that it has moved now; at most 64 items. */
  moved: number[];
  /** Whether it is being closed. */
  leaves: boolean;
}

/** A request for a box of the result that holds all tissue. */
export interface LargerBoxRequest {
  type: "larger_box";
}

/** Confirmation of a message, after all callbacks have run. */
export interface EditDone {
  type: "done";
  /** Id of the window; 1 to 40 characters. */
  sender: string;
  /** Number of the message, counted by the sender; from 0. */
  seq: number;
}

/** A refusal or a failure. */
export interface EditRefused {
  type: "error";
  /** Why. */
  message: string;
}

/** Start drawing a shape. */
export interface DrawShape {
  type: "draw";
  tool: "cut" | "part" | "fixed";
}

/** Other rigid parts that control points contradict: the user decides what to do with those. */
export interface ProposedParts {
  type: "parts";
  /** All parts. */
  parts: PartData[];
  /** Name of the edit. */
  kind: string;
}

/** Show a part of the picture, or all of it. */
export interface ShowPart {
  type: "see";
  /** Place in the middle of the view; null for all of it. */
  middle: number[] | null;
  /** CSS pixels of a unit of length. */
  scale: number;
}

/** Center a point. */
export interface ShowPoint {
  type: "look";
  /** Of the point; from 0. */
  id: number;
}

/** A rigid part that was drawn in the slices; the traits parts and chosen_shape have it then. */
export interface DrawnPart {
  type: "part";
  /** Id of the window; 1 to 40 characters. */
  sender: string;
  /** Number of the message, counted by the sender; from 0. */
  seq: number;
  /** Of its region. */
  form: "ellipsoid" | "box";
  /** Of its region, (x, y, z). */
  middle: [number, number, number];
  /** Half its lengths along u, v and n of the first of panes. */
  radii: [number, number, number];
}

/** A new front end, which needs all pictures. */
export interface PicturesWanted {
  type: "hello";
  /** Id of the front end; at most 40 characters. */
  view: string;
}

/** The place or the contents of the slices were changed. */
export interface SlicesMoved {
  type: "look";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** (x, y, z). */
  cursor?: [number, number, number];
  projection?: "slice" | "mip" | "composite" | "shaded";
  /** Whether the volume is shown without deformation. */
  original?: boolean;
  /** Values that are black and white; empty for the automatic ones; at most 2 items. */
  window?: [number, number] | [];
  /** Whether the movement continues: with fewer pixels. */
  moving?: boolean;
}

/** Confirmation that the item of this number is shown or being drawn, so that the next may come. */
export interface Seen {
  type: "seen";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Number; from 1. */
  seq: number;
}

/** The slices or projections that have changed. */
export interface Pictures {
  type: "pictures";
  /** Number, to be confirmed by seen unless it is 0. */
  seq: number;
  /** Id of the one front end, or null for all. */
  view: string | null;
  panes: PaneContent[];
  /** Note, isBad, the folds of the map: folds, worst; the values that are black and white: window. */
  facts: Record<string, unknown>;
}

/** Part of a message whose buffers are too large for one. */
export interface Fragment {
  type: "fragment";
  /** Of the part; the others of its message come right after; from 0. */
  index: number;
  /** Bytes of each of its buffers. */
  sizes: number[];
  /** The message, with its last part. */
  message: Record<string, unknown> | null;
}

/** A value that is being changed or was changed. */
export interface ValueEdit {
  type: "edit";
  /** Number, counted by the front end. */
  seq: number;
  /** Id of the front end; at most 40 characters. */
  view?: string;
  /** "move" while something is dragged. */
  phase: "move" | "end";
  /** Of the widget, which checks it. */
  value?: unknown;
}

/** Confirmation of a value. */
export interface ValueTaken {
  type: "done";
  /** Number, counted by the front end. */
  seq: number;
  /** Id of the front end; at most 40 characters. */
  view: string;
}

/** Refusal of a value. */
export interface ValueRefused {
  type: "error";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Why. */
  message: string;
}

/** A command for a row. */
export interface RowCommand {
  type: "act";
  what: "choose" | "switch" | "rename" | "up" | "down" | "double" | "remove";
  /** Of the row; from 0. */
  index: number;
  /** Whether it is on, for "switch"; a name, for "rename"; at most 100 characters. */
  value?: string | boolean | null;
  /** Of the rows: a command for an earlier one is dropped; from 0. */
  version: number;
}

/** The answer to a command: done or refused. */
export interface CommandDone {
  type: "done";
}

/** A command for points, or an edit of a cell. */
export interface PointsCommand {
  type: "act";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Number, counted by the front end. */
  seq: number;
  /** "seen" is whether the table is visible. */
  what: "cell" | "add" | "remove" | "reset" | "lock" | "switch" | "look" | "paste" | "undo" | "redo" | "seen";
  /** Of the points; at most 2000 items. */
  ids: number[];
  /** Of the cell. */
  field?: "name" | "active" | "locked" | "source" | "target" | "weight" | "radius" | "";
  /** Of the cell; 0 to 2. */
  axis?: number;
  /** Whether a switch is on or the table visible; else the text. */
  value?: string | boolean | null;
}

/** The answer: done or refused. */
export interface PointsCommandDone {
  type: "done";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Number, counted by the front end. */
  seq: number;
  /** Whether it was done. */
  ok: boolean;
  /** A report of it. */
  text: string;
}

/** Put a text on the clipboard. */
export interface CopyText {
  type: "copy";
  text: string;
  /** Purpose. */
  note: string;
}

/** Offer a file to the browser. */
export interface Download {
  type: "download";
  /** Of the file. */
  name: string;
}

/** A file that was chosen or dropped. */
export interface UploadBegin {
  type: "begin";
  /** Id of the upload; 1 to 64 characters. */
  id: string;
  /** Of the file. */
  name: string;
  /** In bytes; from 0. */
  size: number;
}

/** The piece that was requested. */
export interface UploadPiece {
  type: "piece";
  /** Id of the upload; 1 to 64 characters. */
  id: string;
  /** Of its first byte; from 0. */
  offset: number;
}

/** An upload that the user has cancelled. */
export interface UploadCancel {
  type: "cancel";
  /** Id of the upload; 1 to 64 characters. */
  id: string;
}

/** A request for the next piece. */
export interface PieceRequest {
  type: "next";
  /** Id of the upload; 1 to 64 characters. */
  id: string;
  /** Of its first byte. */
  offset: number;
  /** In bytes. */
  length: number;
}

/** A file that has arrived and is being read. */
export interface UploadReading {
  type: "reading";
  /** Id of the upload; 1 to 64 characters. */
  id: string;
  /** That is done, 0 to 1. */
  share: number;
}

/** The end of an upload: taken, cancelled or refused. */
export interface UploadDone {
  type: "done";
  /** Id of the upload; 1 to 64 characters. */
  id: string;
}

/** A pressed button. */
export interface RestoreCommand {
  type: "act";
  /** Which. */
  what: "restore" | "skip" | "delete";
  /** Of the offer: a command for an earlier one is dropped; from 0. */
  version: number;
}

/** The session that a page has shown until its Python ended, and wants to go on with. */
export interface ResumeRequest {
  type: "resume";
  /** Name of its autosave; 1 to 100 characters. */
  session: string;
}

/** The press of the button. */
export interface SaveRequest {
  type: "save";
}

/** An opened menu. */
export interface MenuRequest {
  type: "menu";
  name: "history" | "examples" | "export";
}

/** A chosen tab, or a section opened or closed. */
export interface BoxChoice {
  type: "choose";
  /** Number of the tabs or the section; from 0. */
  box: number;
  /** Of the tab; 0 for a section that was opened, null for a closed one; from 0. */
  index: number | null;
}

/** The greeting of a new front end. */
export interface LiveHello {
  type: "hello";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Side of the largest 3D texture; 0 where it cannot draw; 0 to 65536. */
  largest: number;
  /** Name of the GPU; at most 1000 characters. */
  renderer?: string;
  /** Whether the CPU draws. */
  software?: boolean;
  background?: "dark" | "light";
  /** That fit into its memory, as far as known; from 1. */
  voxels?: number;
}

/** A request for a piece of the volume. */
export interface ChunkRequest {
  type: "chunk";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Of the volume; at most 200 characters. */
  id: string;
  /** Of the piece; from 0. */
  index: number;
}

/** The front end follows the points of an editor in space: it computes their displacement itself while they move. */
export interface PointsFollowed {
  type: "follows";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Of the edits of its window; at most 40 characters. */
  sender: string;
}

/** A camera, as the trait; the entries that are missing are those of the home view. */
export interface CameraData {
  direction?: [number, number, number] | null;
  up?: [number, number, number] | null;
  zoom?: number | null;
  pan?: [number, number] | null;
  perspective?: boolean | null;
}

/** The wish to edit the picture that the camera sees. */
export interface EditView {
  type: "edit_view";
  /** Id of the front end; at most 40 characters. */
  view: string;
  camera: CameraData;
  /** Place in space in the middle of the view. */
  middle?: [number, number, number];
  /** CSS pixels of a unit of length. */
  scale?: number;
}

/** A request to draw in Python, without WebGL. */
export interface StillRequest {
  type: "still";
  /** Id of the front end; at most 40 characters. */
  view: string;
  background?: "dark" | "light";
}

/** The greeting of a new front end. */
export interface ServedHello {
  type: "hello";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Pixels; 1 to 4096. */
  width: number;
  /** Pixels; 1 to 4096. */
  height: number;
  background?: "dark" | "light";
  /** Address of the page, where frames come from a server; at most 2048 characters. */
  origin?: string;
}

/** The new size of a front end. */
export interface Resized {
  type: "size";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Pixels; 1 to 4096. */
  width: number;
  /** Pixels; 1 to 4096. */
  height: number;
  background?: "dark" | "light";
  /** Address of the page, where frames come from a server; at most 2048 characters. */
  origin?: string;
}

/** A camera that the user has changed. */
export interface CameraMoved {
  type: "camera";
  /** Id of the front end; at most 40 characters. */
  view: string;
  camera: CameraData;
  /** Of the change; from 0. */
  number: number;
}

/** A request for the first visible surface along a ray in space. */
export interface SurfaceRequest {
  type: "surface";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Number of the request; from 1. */
  id: number;
  start: [number, number, number];
  /** Its direction, away from the viewer. */
  ray: [number, number, number];
}

/** The end of a front end. */
export interface Closed {
  type: "bye";
  /** Id of the front end; at most 40 characters. */
  view: string;
}

/** A message to Python's renderer. */
export interface ToServerRenderer {
  type: "drawn";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** As of a VolumeView. */
  say: ServedHello | Resized | CameraMoved | EditView | SurfaceRequest | Seen | Closed;
}

/** The picture. */
export interface Screenshot {
  type: "screenshot";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Number of the request; from 1. */
  id: number;
}

/** A part of a frame. */
export interface MoviePiece {
  type: "movie_piece";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Id of the movie; at most 40 characters. */
  id: string;
  /** Of the frame; from 0. */
  index: number;
  /** Of its first byte; from 0. */
  offset: number;
  /** Bytes of the whole frame; 1 to 67108864. */
  size: number;
}

/** A frame that cannot be drawn. */
export interface MovieFailed {
  type: "movie_failed";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Id of the movie; at most 40 characters. */
  id: string;
  /** Why. */
  message: string;
}

/** Measurements of the front end; those that it has not made are left out. */
export interface Measurements {
  type: "stats";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Median of quick pictures. */
  drag_ms?: number | null;
  /** Of the full picture. */
  full_ms?: number | null;
  /** Of the full picture. */
  passes?: number | null;
  /** That were drawn. */
  frames?: number | null;
  /** Share of the full width that quick pictures have. */
  scale?: number | null;
  /** Pixels. */
  width?: number | null;
  /** Pixels. */
  height?: number | null;
  /** Bytes. */
  received?: number | null;
  /** Fits in the front end. */
  edits?: number | null;
  /** Of a fit in the front end. */
  edit_ms?: number | null;
  /** Of a page without Python: sides of the box that tissue exceeds. */
  sides?: unknown;
}

/** A piece of the volume. */
export interface Chunk {
  type: "chunk";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Of the volume. */
  id: string;
  /** Of the piece. */
  index: number;
  /** Its first voxel. */
  start: number;
  /** Voxels after the first so many are differences from those so many before. */
  lag?: number;
}

/** A box along the axes of a volume, in its own frame. */
export interface BoxData {
  low: [number, number, number];
  high: [number, number, number];
}

/** Cuts of a plane, but for the distances to them, which are a buffer. */
export interface PlaneCutData {
  /** Cuts, rows, columns. */
  shape: [number, number, number];
  origin: [number, number];
  spacing: [number, number];
  /** Of each region, whether it is inside of each cut. */
  sides: boolean[][];
  /** A name of CUT_RULES. */
  rule: string;
  regions: RegionData[];
  /** Of the distances, which seldom change. */
  id: string;
}

/** A plane in the volume's frame: its origin, two directions and the normal. */
export interface PlaneData {
  origin: [number, number, number];
  u: [number, number, number];
  v: [number, number, number];
  n: [number, number, number];
}

/** Maps of an extrusion. */
export interface PlanarData {
  /** Layers, rows, columns; the layers of a region are neighbours. */
  shape: [number, number, number];
  /** Of the maps in the plane. */
  origin: [number, number];
  spacing: [number, number];
  /** First and last depth that the weights are for. */
  depth: [number, number];
  /** Whether the weights are 1 at every depth. */
  isReplicated: boolean;
  cut: PlaneCutData | null;
  /** Width of the ramp of opacity at a cut. */
  softness: number;
  plane: PlaneData;
}

/** Cuts of an earlier step, sampled in space. */
export interface SpaceCutData {
  regions: number;
  /** A name of CUT_RULES. */
  rule: string;
  softness: number;
  /** Largest change of the displacement over a length. */
  slope: number;
}

/** Samples of a field in space. */
export interface SpaceData {
  /** Along x, y, z. */
  shape: [number, number, number];
  origin: [number, number, number];
  spacing: [number, number, number];
  cut?: SpaceCutData | null;
}

/** Moments of an animation. */
export interface FramesData {
  count: number;
  /** In seconds. */
  duration: number;
}

/** The moving part of a field that follows an editor. */
export interface FollowData {
  /** Of the map. */
  index: number;
  /** That the maps are of. */
  points: PointData[];
  /** That they are of. */
  shapes?: { cuts: CutData[]; parts: PartData[] };
}

/** Points in space whose fit a field is. */
export interface MovedData {
  points: PointData[];
  /** Nodes of the field while they move. */
  shape: [number, number, number];
}

/** The deformation as textures. */
export interface FieldMaps {
  type: "field";
  /** Of the result. */
  box: BoxData;
  /** Maps of an extrusion. */
  planar: PlanarData | null;
  /** Samples of a field that is no extrusion. */
  space: SpaceData | null;
  /** Whether it is coarser than it could be. */
  coarse: boolean;
  /** Of an animation. */
  frames?: FramesData;
  /** Names of the buffers. */
  buffers: string[];
  /** Id of the one front end, or null for all. */
  view: string | null;
  /** Number, to be confirmed by seen unless it is 0. */
  seq: number;
  /** What an editor moves. */
  follow: FollowData | null;
  /** Data of a fit in the front end while it moves; null where Python fits. */
  moved: MovedData | null;
}

/** Notice that Python draws for this front end. */
export interface DrawnByPython {
  type: "drawn";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Of the volume, as the trait volume_info. */
  info: Record<string, unknown>;
}

/** Notice of another volume, drawn by Python. */
export interface VolumeInfo {
  type: "info";
  /** Of the volume, as the trait volume_info. */
  info: Record<string, unknown>;
}

/** A request for the picture that is shown. */
export interface ScreenshotRequest {
  type: "screenshot";
  /** Number of the request; from 1. */
  id: number;
}

/** A request for a frame of a movie, with the deformation of its moment as textures. */
export interface MovieFrame {
  type: "movie_frame";
  /** Of the result. */
  box: BoxData;
  /** Maps of an extrusion. */
  planar: PlanarData | null;
  /** Samples of a field that is no extrusion. */
  space: SpaceData | null;
  /** Whether it is coarser than it could be. */
  coarse: boolean;
  /** Of an animation. */
  frames?: FramesData;
  /** Names of the buffers. */
  buffers: string[];
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Id of the movie; at most 40 characters. */
  id: string;
  /** Of the frame. */
  index: number;
  /** Width and height in pixels. */
  size: [number, number];
  /** Camera, projection and the like, as the traits. */
  looks: Record<string, unknown>;
}

/** The end of a movie: no more frames are needed. */
export interface MovieEnd {
  type: "movie_end";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Id of the movie; at most 40 characters. */
  id: string;
}

/** A picture. */
export interface FrameSent {
  type: "frame";
  /** Number. */
  seq: number;
  /** Whether in full resolution. */
  full: boolean;
  /** Number of the change that it shows. */
  camera: number;
  /** Id of the front end that made it. */
  by: string;
}

/** The first visible surface along a ray. */
export interface SurfaceFound {
  type: "surface";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Number of the request. */
  id: number;
  /** In space; null where nothing is seen. */
  place: [number, number, number] | null;
}

/** A text over the picture. */
export interface Notice {
  type: "notice";
  /** Empty for none. */
  text: string;
}

/** A remark about folds. */
export interface Badge {
  type: "badge";
  /** Empty for none. */
  text: string;
}

/** The address of a server of trame, where frames come from. */
export interface TrameAddress {
  type: "trame";
  /** Id of the front end; at most 40 characters. */
  view: string;
  /** Of its page. */
  url: string;
}

/** One of the three pictures. */
export interface PaneContent {
  /** Which. */
  index: number;
  /** Rows and columns. */
  shape: [number, number];
  spacing: [number, number];
  origin: [number, number];
  /** 1 for grey values, 3 for colours. */
  channels: number;
  /** Whether a buffer with depths follows the pixels. */
  hasDepths: boolean;
  /** Rows and columns of the buffer of cuts. */
  cuts: [number, number] | null;
  /** Rows and columns of the buffer of det J; null where nothing folds or the front end knows. */
  dets: [number, number] | null;
}

/** A cut: the region is deformed by its own points alone. */
export interface CutData {
  /** At most 200 characters. */
  name: string;
  enabled: boolean;
  region: PolygonData | LineData | HalfSpaceData | MaskData;
}

/** PolygonData or LineData or HalfSpaceData or MaskData. */
export type RegionData = PolygonData | LineData | HalfSpaceData | MaskData;

/** Any message of Editor. */
export type EditorToPython = Greeting | PointsEdit | HistoryRequest | ShapesEdit | ShapeChoice | WandRequest | WindowPointer | LargerBoxRequest;

/** Any message of Editor. */
export type EditorToFrontEnd = EditDone | EditRefused | DrawShape | ProposedParts | ShowPart | ShowPoint | WindowPointer;

/** Any message of SpaceEditor. */
export type SpaceEditorToPython = Greeting | PointsEdit | HistoryRequest | ShapesEdit | ShapeChoice | DrawnPart | PicturesWanted | SlicesMoved | Seen;

/** Any message of SpaceEditor. */
export type SpaceEditorToFrontEnd = EditDone | EditRefused | ShowPoint | Pictures | Fragment;

/** Any message of CurveEditor, TransferEditor, DepthKeys, GridDrawing. */
export type CurveEditorToPython = ValueEdit;

/** Any message of CurveEditor, TransferEditor, DepthKeys, GridDrawing. */
export type CurveEditorToFrontEnd = ValueTaken | ValueRefused;

/** Any message of ItemList. */
export type ItemListToPython = RowCommand;

/** Any message of ItemList. */
export type ItemListToFrontEnd = CommandDone;

/** Any message of PointsTable. */
export type PointsTableToPython = PointsCommand;

/** Any message of PointsTable. */
export type PointsTableToFrontEnd = PointsCommandDone;

/** Any message of FileTransfer. */
export type FileTransferToFrontEnd = CopyText | Download | Fragment;

/** Any message of FileInput. */
export type FileInputToPython = UploadBegin | UploadPiece | UploadCancel;

/** Any message of FileInput. */
export type FileInputToFrontEnd = PieceRequest | UploadReading | UploadDone;

/** Any message of RestoreBar. */
export type RestoreBarToPython = RestoreCommand | ResumeRequest;

/** Any message of RestoreBar. */
export type RestoreBarToFrontEnd = CommandDone;

/** Any message of StudioHead. */
export type StudioHeadToPython = SaveRequest | MenuRequest;

/** Any message of Boxes. */
export type BoxesToPython = BoxChoice;

/** Any message of LiveView. */
export type LiveViewToPython = LiveHello | ChunkRequest | Seen | PointsFollowed | EditView | StillRequest | ToServerRenderer | Screenshot | MoviePiece | MovieFailed | Measurements | Closed;

/** Any message of LiveView. */
export type LiveViewToFrontEnd = Chunk | FieldMaps | DrawnByPython | VolumeInfo | ScreenshotRequest | MovieFrame | MovieEnd | Fragment;

/** Any message of VolumeView. */
export type VolumeViewToPython = ServedHello | Resized | CameraMoved | EditView | SurfaceRequest | Seen | Closed;

/** Any message of VolumeView. */
export type VolumeViewToFrontEnd = FrameSent | SurfaceFound | Notice | Badge | TrameAddress | Fragment;
