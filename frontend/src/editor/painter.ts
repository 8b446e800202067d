// Painting of a warped picture and its grid on a 2D canvas.

import { mapVector } from "../maths/camera.ts";
import { chosenPlace, coverage, marginOf } from "../maths/cuts.ts";
import { fieldOnRaster, isStill } from "../maths/rigid_stages.ts";
import { sampledFits } from "../maths/sampled_fit.ts";
import type { LayeredFit, PictureRaster, Raster, Vector2, Vector3, Vector4 } from "../types.ts";
import { HIDDEN_PIXELS, hidesPixels } from "../ui/canvas_pixels.ts";

/**
 * The visible part of the picture plane: a place (a, b) is at (k a + x, k b + y) CSS pixels; the size in CSS
 * pixels, and the ratio of the canvas's pixels to those.
 */
export type View = { k: number; x: number; y: number; width: number; height: number; ratio: number };

export type Bytes = Uint8Array | Uint8ClampedArray;
export type Buffered = ArrayBuffer | ArrayBufferView<ArrayBuffer>;
/** The pixels of a picture at one size */
export type Level = { pixels: Bytes; width: number; height: number };
/**
 * The part of the original next to the deformed picture: left of a share of the canvas's width, and over all of it.
 */
export type Original = { share: number; opacity: number };
/** Of the canvas, in its own pixels */
export type Part = { x: number; y: number; width: number; height: number };
/** Places of nodes in the picture. */
export type Lattice = { rows: number; columns: number; a0: number; b0: number; step: number };
export type NearRegion = { distance: (a: number, b: number) => number };
/** p = (a - origin) * scale + shift, in pixels of a level. */
export type LevelPlaces = { origin: Vector2; scale: Vector2; shift: number };

const NO_ORIGINAL: Original = { share: 0, opacity: 0 };
const LATTICE_PIXELS = 8; // nodes of the map while something moves: 0.06 px of error for a drag of 60 px over 400
const EVALUATIONS = 6e6; // kernel evaluations of the full picture at most: 40 ms, after the pointer has come to rest
const MOVING_EVALUATIONS = 1.5e6; // the same while something moves: 6 ms
const FINEST_LAYERS = 4; // pixels between the nodes of maps with cuts, whose pixels are decided by distances
const BUDGET_MS = 9; // for the picture of one frame; the rest of 16 ms belongs to fit, grid, handles and the browser

/**
 * The grey of each of the equally spaced values of a range, from black to white of a window.
 * @param most the number of the last one
 * @param range the values of number 0 and of the last one
 */
export function greyTable(most: number, [first, last]: Vector2, [low, high]: Vector2) {
  const table = new Uint8Array(most + 1);
  for (let k = 0; k <= most; k++) {
    // Uint8Array.from takes ten times as long
    const share = (first + ((last - first) * k) / most - low) / (high - low);
    table[k] = Math.floor(255 * Math.max(0, Math.min(1, share)) + 0.5);
  }
  return table;
}

/** The grey values of a picture, as numbers of equally spaced values of a range. */
class GreyValues {
  most: number;
  range: Vector2;
  window: Vector2;
  unit: string;
  least: number;

  constructor(
    readonly numbers: Uint8Array<ArrayBufferLike> | Uint16Array<ArrayBufferLike>,
    { range, window, unit = "" }: PictureRaster,
  ) {
    this.most = numbers instanceof Uint8Array ? 255 : 65535;
    this.range = range ?? [0, this.most];
    this.window = window ?? this.range; // the automatic one
    this.unit = unit;
    this.least = this.most;
    for (const number of numbers) this.least = Math.min(this.least, number);
  }

  value(at: number) {
    return this.range[0] + ((this.range[1] - this.range[0]) * this.numbers[at]!) / this.most;
  }
}

const OPAQUE = 0xff000000;
const GREYS = Uint32Array.from({ length: 256 }, (_, g) => OPAQUE | (g * 0x010101));

/**
 * The pixels that show the 256 numbers from black to white of a window.
 * @param colours red, green and blue of each; none or empty for greys
 */
export function colourTable(colours: ArrayLike<number> | null | undefined) {
  if (colours?.length !== 768) return GREYS;
  return GREYS.map((_, g) => OPAQUE | (colours[3 * g + 2]! << 16) | (colours[3 * g + 1]! << 8) | colours[3 * g]!);
}

/** The pixels of a picture, at all sizes in use. */
export class PictureSource {
  grey: GreyValues | null;
  channels: number;

  fill = 0; // beyond the picture: its smallest value, as for a volume

  /** The air around the body, and the value up to which that is air. */
  around: { air: number; pixels: Uint8Array } | null = null;

  levels: Level[] = [];

  /** @param pixels grey, or height * width * 4 */
  constructor(
    pixels: Bytes | GreyValues,
    readonly raster: PictureRaster,
  ) {
    const [height, width] = raster.shape;
    this.grey = pixels instanceof GreyValues ? pixels : null;
    this.channels = this.grey ? 1 : 4;
    if (pixels instanceof GreyValues) this.setWindow(pixels.window);
    else {
      this.levels = [{ pixels, width, height }];
      this.fill = raster.beyond ?? 0;
    }
  }

  /**
   * Show grey values from black to white of a window. The pixels are made here, once, so that warping takes no longer.
   */
  setWindow(window: Vector2) {
    if (!this.grey) return;
    const { numbers, most, range, least } = this.grey,
      table = greyTable(most, range, window);
    const [height, width] = this.raster.shape,
      pixels = new Uint8Array(numbers.length);
    for (let k = 0; k < pixels.length; k++) pixels[k] = table[numbers[k]!]!;
    this.levels = [{ pixels, width, height }];
    this.fill = table[least]!;
  }

  /** The grey value of the pixel at a place of the picture; null outside, and in a picture in colour. */
  valueAt([a, b]: Vector2) {
    const {
      raster: {
        shape: [nv, nu],
        spacing: [du, dv],
        origin,
      },
      grey,
    } = this;
    const j = Math.round((a - origin[0]) / du),
      i = Math.round((b - origin[1]) / dv);
    return grey && i >= 0 && j >= 0 && i < nv && j < nu ? grey.value(i * nu + j) : null;
  }

  /**
   * Whether a place of the picture is in the body: not in the air around it, which reaches the rim of the picture.
   * @param air the value up to which there is air
   */
  isBody([a, b]: Vector2, air: number) {
    const {
      raster: {
        shape: [nv, nu],
        spacing: [du, dv],
        origin,
      },
    } = this;
    const j = Math.round((a - origin[0]) / du),
      i = Math.round((b - origin[1]) / dv);
    if (!(i >= 0 && j >= 0 && i < nv && j < nu)) return false;
    if (this.around?.air !== air) this.around = { air, pixels: this.#airAround(air) };
    return this.around.pixels[i * nu + j] === 0;
  }

  /** 1 at the pixels of the air that is connected to the rim of the picture. */
  #airAround(air: number) {
    const {
        raster: {
          shape: [nv, nu],
        },
        grey,
      } = this,
      found = new Uint8Array(nv * nu);
    const waiting: number[] = [];
    const look = (n: number) => {
      if (found[n] || !grey || !(grey.value(n) <= air)) return;
      found[n] = 1;
      waiting.push(n);
    };
    for (let j = 0; j < nu; j++) {
      look(j);
      look((nv - 1) * nu + j);
    }
    for (let i = 0; i < nv; i++) {
      look(i * nu);
      look(i * nu + nu - 1);
    }
    for (let n = waiting.pop(); n !== undefined; n = waiting.pop()) {
      const j = n % nu;
      if (j > 0) look(n - 1);
      if (j + 1 < nu) look(n + 1);
      if (n >= nu) look(n - nu);
      if (n + nu < nv * nu) look(n + nu);
    }
    return found;
  }

  get box(): Vector4 {
    const {
      shape: [nv, nu],
      spacing: [du, dv],
      origin: [a, b],
    } = this.raster;
    return [a - du / 2, a + (nu - 0.5) * du, b - dv / 2, b + (nv - 0.5) * dv];
  }

  /** The picture averaged to half its size, `level` times: a minified picture must not alias. */
  level(level: number) {
    while (this.levels.length <= level) this.levels.push(halve(this.levels[this.levels.length - 1]!, this.channels));
    return this.levels[level];
  }
}

/** The bytes of a PNG as a source for the painter. */
export async function decodePicture(bytes: Buffered, raster: PictureRaster) {
  if (hidesPixels()) throw new Error(HIDDEN_PIXELS);
  const view = bytesOf(bytes);
  const bitmap = await createImageBitmap(new Blob([view], { type: "image/png" }), {
    colorSpaceConversion: "none",
    premultiplyAlpha: "none",
  });
  const [height, width] = raster.shape;
  if (bitmap.width !== width || bitmap.height !== height) throw new Error("its size is not that of its raster");
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  const context = context2d(canvas, { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  const rgba = context.getImageData(0, 0, width, height).data;
  const { channels = 3 } = raster;
  if (channels > 2) return new PictureSource(rgba, raster);
  const numbers = new (channels === 1 ? Uint8Array : Uint16Array)(width * height);
  for (let k = 0; k < numbers.length; k++)
    numbers[k] = channels === 1 ? rgba[4 * k]! : 256 * rgba[4 * k]! + rgba[4 * k + 1]!;
  return new PictureSource(new GreyValues(numbers, raster), raster);
}

/** The bytes of a trait: a front end has a view of its buffer, or the buffer. */
export function bytesOf(bytes: Buffered) {
  if (!ArrayBuffer.isView(bytes)) return new Uint8Array(bytes);
  return new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength);
}

export function context2d(canvas: HTMLCanvasElement, settings?: CanvasRenderingContext2DSettings) {
  const context = canvas.getContext("2d", settings);
  if (!context) throw new Error("this browser has no 2D canvas");
  return context;
}

/** A picture averaged to half its size. */
export function halve({ pixels, width, height }: Level, channels: number): Level {
  const w = Math.max(1, width >> 1),
    h = Math.max(1, height >> 1),
    out = new Uint8Array(w * h * channels);
  for (let y = 0; y < h; y++) {
    const up = Math.min(2 * y, height - 1) * width,
      down = Math.min(2 * y + 1, height - 1) * width;
    for (let x = 0; x < w; x++) {
      const left = Math.min(2 * x, width - 1),
        right = Math.min(2 * x + 1, width - 1);
      for (let c = 0; c < channels; c++) {
        const at = (row: number, column: number) => pixels[(row + column) * channels + c];
        out[(y * w + x) * channels + c] =
          (at(up, left)! + at(up, right)! + at(down, left)! + at(down, right)! + 2) >> 2;
      }
    }
  }
  return { pixels: out, width: w, height: h };
}

/** Painter of a warped picture on a canvas. */
export class Painter {
  context: CanvasRenderingContext2D;
  scratch: HTMLCanvasElement;
  scratchContext: CanvasRenderingContext2D;
  colours: Uint32Array<ArrayBuffer>;
  source: PictureSource | null = null;
  image: ImageData;
  paper: number[] = [0, 0, 0]; // red, green and blue around the picture
  /** The places of the nodes under each fit, in pixels of a level. */
  maps: Float32Array[] = [];
  /** The fit that was painted, known at those nodes while something moves. */
  sampled: LayeredFit | null = null;
  cost = 15e-6; // milliseconds per pixel, measured from then on

  constructor(readonly canvas: HTMLCanvasElement) {
    this.context = context2d(canvas, { alpha: false });
    this.scratch = document.createElement("canvas");
    this.scratchContext = context2d(this.scratch, { alpha: false });
    this.colours = GREYS; // of grey values
    this.image = new ImageData(1, 1);
  }

  /** Give the canvas a size, which empties it; false if it has that size. */
  resize(width: number, height: number, ratio: number) {
    const w = Math.max(1, Math.round(width * ratio)),
      h = Math.max(1, Math.round(height * ratio));
    if (this.canvas.width === w && this.canvas.height === h) return false;
    Object.assign(this.canvas, { width: w, height: h });
    return true;
  }

  /**
   * Paint the picture, as far as `sheet` reaches.
   * @param fit null for the picture as it is
   */
  paint(
    view: View,
    fit: LayeredFit | null,
    {
      isMoving,
      paper,
      sheet = this.source?.box,
      original = NO_ORIGINAL,
      deformed = null,
    }: {
      isMoving: boolean;
      paper: string;
      sheet?: Vector4;
      original?: Original;
      /** In place of the picture under the fit */
      deformed?: PictureSource | null;
    },
  ) {
    const start = performance.now(),
      { context: c, canvas, source } = this;
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.fillStyle = paper;
    c.fillRect(0, 0, canvas.width, canvas.height);
    this.sampled = fit;
    const hex = String(c.fillStyle); // #rrggbb for any colour that was set
    this.paper = [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) || 0);
    if (!source || !sheet) return;
    const whole = this.visible(view, sheet),
      isFaded = original.opacity > 0;
    if (whole.width <= 0 || whole.height <= 0) return;
    const line = Math.round(original.share * canvas.width); // left of which the original is seen
    const cut = Math.max(0, Math.min(whole.width, line - whole.x));
    const pixels = whole.height * (whole.width * (isFaded ? 2 : 1) + (isMoving ? cut : 0));
    const step = isMoving && pixels * this.cost > BUDGET_MS ? (pixels * this.cost > 4 * BUDGET_MS ? 3 : 2) : 1;
    // While something moves, grid and folds are found on the nodes of the whole picture, also below the original.
    const rest = isMoving ? whole : { ...whole, x: whole.x + cut, width: whole.width - cut };
    if (rest.width > 0) this.#paintPart(deformed ?? source, view, deformed ? null : fit, rest, step, isMoving, 1);
    if (cut > 0) this.#paintPart(source, view, null, { ...whole, width: cut }, step, isMoving, 1);
    if (isFaded) this.#paintPart(source, view, null, whole, step, isMoving, original.opacity);
    if (isMoving) this.cost += 0.2 * (((performance.now() - start) * step * step) / pixels - this.cost);
  }

  /**
   * @param step pixels of the canvas across one that is looked up
   * @param opacity over the picture below
   */
  #paintPart(
    source: PictureSource,
    view: View,
    fit: LayeredFit | null,
    part: Part,
    step: number,
    isMoving: boolean,
    opacity: number,
  ) {
    const { context: c } = this,
      w = Math.ceil(part.width / step),
      h = Math.ceil(part.height / step);
    this.#warp(source, view, fit, part, step, isMoving);
    if (step === 1 && opacity === 1) {
      c.putImageData(this.image, part.x, part.y);
      return;
    }
    if (this.scratch.width !== w || this.scratch.height !== h) Object.assign(this.scratch, { width: w, height: h });
    this.scratchContext.putImageData(this.image, 0, 0);
    c.imageSmoothingEnabled = true;
    c.save();
    c.globalAlpha = opacity;
    c.beginPath();
    c.rect(part.x, part.y, part.width, part.height);
    c.clip();
    c.drawImage(this.scratch, part.x, part.y, w * step, h * step);
    c.restore();
  }

  /** The part of the canvas that a box on the picture's plane covers. */
  visible({ k, x, y, ratio }: View, [a0, a1, b0, b1]: Vector4): Part {
    const { width, height } = this.canvas;
    const clamp = (value: number, most: number) => Math.max(0, Math.min(most, Math.round(value * ratio)));
    const left = clamp(k * a0 + x, width),
      right = clamp(k * a1 + x, width);
    const top = clamp(k * b0 + y, height),
      bottom = clamp(k * b1 + y, height);
    return { x: left, y: top, width: right - left, height: bottom - top };
  }

  /**
   * Pixels that are looked up between the nodes at which the map is evaluated.
   * @param step pixels of the canvas across one that is looked up
   */
  latticeStep(fit: LayeredFit | null, w: number, h: number, step: number, isMoving: boolean) {
    if (!fit || fit.fits.every((one) => isStill(one.fit))) return 32; // a linear map needs no more nodes than that
    if (isMoving) {
      return Math.max(Math.ceil(LATTICE_PIXELS / step), Math.ceil(Math.sqrt((w * h * fit.count) / MOVING_EVALUATIONS)));
    }
    return Math.max(fit.regions.length ? FINEST_LAYERS : 1, Math.ceil(Math.sqrt((w * h * fit.count) / EVALUATIONS)));
  }

  /**
   * Sample the source at every pixel: map at the nodes of a lattice, bilinear between them, bilinear in the picture.
   * @param step pixels of the canvas across one that is looked up
   */
  #warp(
    source: PictureSource,
    { k, x, y, ratio }: View,
    fit: LayeredFit | null,
    part: Part,
    step: number,
    isMoving: boolean,
  ) {
    const w = Math.ceil(part.width / step),
      h = Math.ceil(part.height / step);
    const lattice = this.latticeStep(fit, w, h, step, isMoving);
    if (this.image.width !== w || this.image.height !== h) this.image = new ImageData(w, h);
    const { raster } = source,
      size = step / (k * ratio); // of one looked-up pixel, in units of the picture
    const a0 = ((part.x + step / 2) / ratio - x) / k,
      b0 = ((part.y + step / 2) / ratio - y) / k;
    const columns = Math.ceil((w - 1) / lattice) + 1 + (w === 1 ? 1 : 0);
    const rows = Math.ceil((h - 1) / lattice) + 1 + (h === 1 ? 1 : 0);
    const nodes: Raster = { shape: [rows, columns], spacing: [lattice * size, lattice * size], origin: [a0, b0] };
    const shrink = Math.min(size / raster.spacing[0], size / raster.spacing[1]);
    const level = Math.max(0, Math.min(8, Math.floor(Math.log2(shrink) + 0.5)));
    const part2 = 2 ** level,
      scale = mapVector(raster.spacing, (value) => 1 / (value * part2)),
      shift = 0.5 / part2 - 0.5;
    const moves: Float32Array[] = [];
    const cutFit = fit && fit.regions.length > 0 ? fit : null,
      count = cutFit ? cutFit.fits.length + 1 : 1;
    for (let m = 0; m < count; m++) {
      if ((this.maps[m]?.length ?? 0) < rows * columns * 2) this.maps[m] = new Float32Array(rows * columns * 2);
      const map = this.maps[m]!,
        one = fit?.fits[m]?.fit;
      if (one && !isStill(one)) fieldOnRaster(one, nodes, map);
      else map.fill(0, 0, rows * columns * 2);
      if (isMoving && fit) moves.push(map.slice(0, rows * columns * 2));
      // From displacements to places in the pixels of that level: ((a + D - origin) / spacing + 1/2) / 2^level - 1/2.
      for (let i = 0, n = 0; i < rows; i++) {
        const b = b0 + i * lattice * size - raster.origin[1];
        for (let j = 0; j < columns; j++, n += 2) {
          map[n] = (a0 + j * lattice * size - raster.origin[0] + map[n]!) * scale[0] + shift;
          map[n + 1] = (b + map[n + 1]!) * scale[1] + shift;
        }
      }
    }
    if (isMoving && fit) this.sampled = sampledFits(fit, nodes, moves);
    const pixels = source.level(level)!,
      { channels, fill } = source,
      rim = 0.5 / part2;
    const out = new Uint32Array(this.image.data.buffer);
    const softness = Math.max(size, (raster.spacing[0] + raster.spacing[1]) / 2);
    const layers = cutFit
      ? new LayerPlan(
          cutFit,
          this.maps,
          { rows, columns, a0, b0, step: lattice * size },
          { origin: raster.origin, scale, shift },
          softness,
          isMoving,
        )
      : null;
    const plan = layers?.plan ?? null;
    if (channels === 1) lookUpGrey(out, w, h, this.maps, plan, columns, lattice, pixels, fill, rim, this.colours);
    else lookUpColour(out, w, h, this.maps, plan, columns, lattice, pixels, fill, rim);
    if (layers) lookUpLayers(out, w, h, layers, lattice, pixels, channels, fill, rim, this.paper, this.colours);
  }

  /** The edge of the drawing, where its own edge is as dark as its surroundings. */
  drawFrame({ k, x, y, ratio }: View, [a0, a1, b0, b1]: Vector4) {
    const { context: c } = this;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.strokeStyle = "rgba(255, 255, 255, 0.28)";
    c.lineWidth = 1;
    c.strokeRect(k * a0 + x, k * b0 + y, k * (a1 - a0), k * (b1 - b0));
    c.setTransform(1, 0, 0, 1, 0, 0);
  }
}

const CASING = "rgba(0, 0, 0, 0.45)",
  CASING_AWAY = 0.7,
  HAIRLINE = 0.9; // CSS pixels

/**
 * Draw polylines in picture coordinates: first a dark casing, then the line, legible on black, white and colour. The
 * casing is a hairline along each side of the line: without a GPU a browser draws those ten times as fast as wide lines.
 */
export function drawGrid(
  c: CanvasRenderingContext2D,
  { k, x, y, ratio }: View,
  lines: { isEdge: boolean; runs: ArrayLike<number>[] }[],
  colour: string,
) {
  const edges = lines.filter((line) => line.isEdge).flatMap((line) => line.runs);
  const inner = lines.filter((line) => !line.isEdge).flatMap((line) => line.runs);
  const isLevel = (run: ArrayLike<number>) =>
    Math.abs(run[run.length - 2]! - run[0]!) > Math.abs(run[run.length - 1]! - run[1]!);
  const level = inner.filter(isLevel),
    upright = inner.filter((run) => !isLevel(run));
  const stroke = (runs: ArrayLike<number>[], width: number, style: string, dx: number = 0, dy: number = 0) => {
    c.strokeStyle = style;
    c.lineWidth = width;
    c.beginPath();
    for (const run of runs) {
      c.moveTo(k * run[0]! + x + dx, k * run[1]! + y + dy);
      for (let j = 2; j < run.length; j += 2) c.lineTo(k * run[j]! + x + dx, k * run[j + 1]! + y + dy);
    }
    c.stroke();
  };
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.lineJoin = "round";
  for (const side of [-CASING_AWAY, CASING_AWAY]) {
    stroke(level, HAIRLINE, CASING, 0, side);
    stroke(upright, HAIRLINE, CASING, side, 0);
  }
  stroke(edges, 3, CASING);
  stroke(inner, HAIRLINE, colour);
  stroke(edges, 1.6, colour);
  c.setTransform(1, 0, 0, 1, 0, 0);
}

/** A loop over the cells of the lattice row by row; places run linearly inside a cell's row. */
export type LookUp = (
  out: Uint32Array,
  w: number,
  h: number,
  maps: Float32Array[],
  plan: Int8Array | null,
  columns: number,
  lattice: number,
  level: Level,
  fill: number,
  rim: number,
  colours?: Uint32Array,
) => void;

const lookUpGrey: LookUp = (
  out,
  w,
  h,
  maps,
  plan,
  columns,
  lattice,
  { pixels, width, height },
  fill,
  rim,
  colours = GREYS,
) => {
  const empty = colours[fill]!,
    right = width - 1,
    bottom = height - 1;
  for (let y = 0; y < h; y++) {
    const i = Math.min(Math.floor(y / lattice), Math.max(0, Math.floor((h - 2) / lattice))),
      f = y / lattice - i;
    const up = 2 * i * columns,
      down = up + 2 * columns,
      line = y * w;
    for (let j = 0, x = 0; x < w; j++) {
      const n = up + 2 * j,
        m = down + 2 * j,
        last = Math.min(w, x + lattice),
        full = lattice;
      const layer = plan ? plan[i * columns + j]! : 0;
      if (layer < 0) {
        x = last;
        continue;
      }
      const map = maps[layer]!;
      let u = map[n]! + f * (map[m]! - map[n]!),
        v = map[n + 1]! + f * (map[m + 1]! - map[n + 1]!);
      const du = (map[n + 2]! + f * (map[m + 2]! - map[n + 2]!) - u) / full;
      const dv = (map[n + 3]! + f * (map[m + 3]! - map[n + 3]!) - v) / full;
      for (; x < last; x++, u += du, v += dv) {
        let p = u,
          q = v;
        if (!(p >= 0 && q >= 0 && p < right && q < bottom)) {
          if (!(p >= -rim && q >= -rim && p < right + rim && q < bottom + rim)) {
            out[line + x] = empty;
            continue;
          }
          p = Math.max(0, Math.min(right, p));
          q = Math.max(0, Math.min(bottom, q));
        }
        const pi = p | 0,
          qi = q | 0,
          s = p - pi,
          t = q - qi,
          at = qi * width + pi;
        const east = pi < right ? 1 : 0,
          south = qi < bottom ? width : 0;
        const top = pixels[at]! + s * (pixels[at + east]! - pixels[at]!),
          low = at + south;
        const g = (top + t * (pixels[low]! + s * (pixels[low + east]! - pixels[low]!) - top) + 0.5) | 0;
        out[line + x] = colours[g]!;
      }
    }
  }
};

const lookUpColour: LookUp = (out, w, h, maps, plan, columns, lattice, { pixels, width, height }, fill, rim) => {
  const empty = OPAQUE | (fill * 0x010101),
    right = width - 1,
    bottom = height - 1;
  for (let y = 0; y < h; y++) {
    const i = Math.min(Math.floor(y / lattice), Math.max(0, Math.floor((h - 2) / lattice))),
      f = y / lattice - i;
    const up = 2 * i * columns,
      down = up + 2 * columns,
      line = y * w;
    for (let j = 0, x = 0; x < w; j++) {
      const n = up + 2 * j,
        m = down + 2 * j,
        last = Math.min(w, x + lattice);
      const layer = plan ? plan[i * columns + j]! : 0;
      if (layer < 0) {
        x = last;
        continue;
      }
      const map = maps[layer]!;
      let u = map[n]! + f * (map[m]! - map[n]!),
        v = map[n + 1]! + f * (map[m + 1]! - map[n + 1]!);
      const du = (map[n + 2]! + f * (map[m + 2]! - map[n + 2]!) - u) / lattice;
      const dv = (map[n + 3]! + f * (map[m + 3]! - map[n + 3]!) - v) / lattice;
      for (; x < last; x++, u += du, v += dv) {
        if (!(u >= -rim && v >= -rim && u < right + rim && v < bottom + rim)) {
          out[line + x] = empty;
          continue;
        }
        const p = Math.max(0, Math.min(right, u)),
          q = Math.max(0, Math.min(bottom, v));
        const pi = p | 0,
          qi = q | 0,
          s = p - pi,
          t = q - qi;
        const at = 4 * (qi * width + pi),
          east = pi < right ? 4 : 0,
          low = at + (qi < bottom ? 4 * width : 0);
        let colour = OPAQUE;
        for (let c = 0; c < 3; c++) {
          const top = pixels[at + c]! + s * (pixels[at + east + c]! - pixels[at + c]!);
          const bed = pixels[low + c]! + s * (pixels[low + east + c]! - pixels[low + c]!);
          colour |= ((top + t * (bed - top) + 0.5) | 0) << (8 * c);
        }
        out[line + x] = colour;
      }
    }
  }
};

const LAYER_EMPTY = -1,
  LAYER_MIXED = -2;
const FEW_EDGES = 32; // of all cuts together: beyond that each cell searches for the near ones

/**
 * The choice between several smooth maps in every pixel of a picture with cuts.
 *
 * The maps are known at the nodes of a lattice. Most cells between the nodes show one map, or nothing at all, which
 * their corners decide: a distance changes by no more than the path length. Only where a cut runs through a
 * cell, each of its pixels is decided by itself, and no displacement is ever interpolated across a cut.
 */
class LayerPlan {
  isShort: boolean;
  here: Float32Array<ArrayBuffer>[];
  depths: Float32Array<ArrayBuffer>[];
  plan: Int8Array<ArrayBuffer>;
  fitOf: Int8Array<ArrayBuffer>;

  /** Regions as a cell sees them. */
  near: Map<number, NearRegion[]> = new Map();

  work = { pixels: new Float64Array(512), covers: new Float64Array(256), out: [0, 0, 1, 0] as Vector4 };

  /** The displacement of each fit at a place. */
  moves: Vector2[] = [];

  /** @param maps one for each fit, and the identity for regions without points, which stay */
  constructor(
    readonly layered: LayeredFit,
    readonly maps: Float32Array<ArrayBufferLike>[],
    public nodes: Lattice,
    readonly places: LevelPlaces,
    readonly softness: number,
    readonly isMoving: boolean,
  ) {
    this.isShort = layered.regions.reduce((sum, { edges }) => sum + (edges ?? 0), 0) <= FEW_EDGES;
    // Distances of every node to the cuts, and the depth of its images within their regions.
    this.here = layered.regions.map(() => new Float32Array(nodes.rows * nodes.columns));
    this.depths = layered.fits.map(() => new Float32Array(nodes.rows * nodes.columns));
    this.plan = new Int8Array(nodes.rows * nodes.columns);
    this.fitOf = Int8Array.from({ length: 1 << layered.regions.length }, (_, key) => layered.byKey.get(key) ?? -1);
    this.#measure();
    for (let i = 0; i < nodes.rows; i++) {
      for (let j = 0; j < nodes.columns; j++) this.plan[i * nodes.columns + j] = this.#cell(i, j);
    }
  }

  /** The number of the identity among the maps. */
  get still() {
    return this.layered.fits.length;
  }

  /**
   * Measure the distances. Far from all cuts a bound will do: the last distance, less the path from the last node.
   */
  #measure() {
    const {
      layered: { regions, fits },
      maps,
      nodes: { rows, columns, a0, b0, step },
      places: { scale },
    } = this;
    const enough = 6 * step + this.softness;
    const fill = (
      values: Float32Array,
      exact: (at: number, i: number, j: number) => number,
      way: (from: number, to: number) => number,
    ) => {
      for (let i = 0, at = 0; i < rows; i++) {
        for (let j = 0; j < columns; j++, at++) {
          const before = j ? values[at - 1]! : i ? values[at - columns]! : 0,
            from = j ? at - 1 : at - columns;
          const left = Math.abs(before) - (at ? way(from, at) : 0);
          values[at] = left > enough ? (before < 0 ? -left : left) : exact(at, i, j);
        }
      }
    };
    for (const [k, { distance }] of regions.entries()) {
      fill(
        this.here[k]!,
        (_, i, j) => distance(a0 + j * step, b0 + i * step),
        () => step,
      );
    }
    for (const [k, { key }] of fits.entries()) {
      const map = maps[k]!;
      fill(
        this.depths[k]!,
        (at) => marginOf(regions, key, this.#a(map[2 * at]!), this.#b(map[2 * at + 1]!)),
        (m, at) => distanceBetween(map, m, at, scale),
      );
    }
  }

  #a(p: number) {
    return (p - this.places.shift) / this.places.scale[0] + this.places.origin[0];
  }

  #b(q: number) {
    return (q - this.places.shift) / this.places.scale[1] + this.places.origin[1];
  }

  /** The content of a whole cell: the number of a map, nothing, or mixed. */
  #cell(i: number, j: number) {
    const { columns, rows, step } = this.nodes,
      { layered, here, still } = this,
      half = this.softness / 2;
    const up = i * columns,
      down = Math.min(i + 1, rows - 1) * columns,
      right = Math.min(j + 1, columns - 1);
    const p = up + j,
      q = up + right,
      r = down + j,
      s = down + right,
      reach = 0.7072 * step + half;
    let key = 0,
      isOne = true;
    for (let k = 0; k < here.length && isOne; k++) {
      const d = here[k]!,
        least = Math.min(d[p]!, d[q]!, d[r]!, d[s]!);
      if (least < -reach && Math.max(d[p]!, d[q]!, d[r]!, d[s]!) < -reach) key |= 1 << k;
      else isOne = least > reach;
    }
    const own = isOne ? (this.fitOf[key]! < 0 ? still : this.fitOf[key]!) : LAYER_MIXED;
    if (layered.rule === "paper") {
      if (own === still || own === LAYER_MIXED) return own;
      const cover = this.#coverage(own, p, q, r, s, half);
      return cover > 0 ? own : cover < 0 ? LAYER_EMPTY : LAYER_MIXED;
    }
    if (own !== LAYER_MIXED && own !== still) {
      const cover = this.#coverage(own, p, q, r, s, half);
      if (cover > 0) return own;
      if (cover === 0) return LAYER_MIXED;
    } else if (own === LAYER_MIXED && layered.hasRest) return LAYER_MIXED;
    let found = LAYER_EMPTY;
    for (let k = 0; k < this.depths.length; k++) {
      const cover = this.#coverage(k, p, q, r, s, half);
      if (cover === 0 || (cover > 0 && (found >= 0 || own === still))) return LAYER_MIXED;
      if (cover > 0) found = k;
    }
    return own === still ? still : found;
  }

  /** 1 if a cell's images under a map are all deep in its region, -1 if none of them comes near it, else 0. */
  #coverage(k: number, p: number, q: number, r: number, s: number, half: number) {
    const map = this.maps[k]!,
      d = this.depths[k]!,
      { scale } = this.places;
    const least = Math.min(d[p]!, d[q]!, d[r]!, d[s]!),
      most = Math.max(d[p]!, d[q]!, d[r]!, d[s]!);
    if (least < half && most > -half) return 0;
    const reach =
      half +
      0.5 *
        (Math.max(distanceBetween(map, p, q, scale), distanceBetween(map, r, s, scale)) +
          Math.max(distanceBetween(map, p, r, scale), distanceBetween(map, q, s, scale)));
    return least > reach ? 1 : most < -reach ? -1 : 0;
  }

  /** The cuts near one cell: of long outlines only the near edges. */
  #regionsAt(cell: number) {
    if (this.isShort) return this.layered.regions;
    const made = this.near.get(cell) ?? this.#regionsNear(cell);
    this.near.set(cell, made);
    return made;
  }

  #regionsNear(cell: number) {
    const {
      layered: { regions },
      maps,
      nodes: { columns, rows, step, a0, b0 },
    } = this;
    const j = cell % columns,
      i = (cell - j) / columns,
      a = a0 + (j + 0.5) * step,
      b = b0 + (i + 0.5) * step;
    let radius = 0.7072 * step;
    const right = Math.min(j + 1, columns - 1);
    const corners = [i, Math.min(i + 1, rows - 1)].flatMap((y) => [y * columns + j, y * columns + right]);
    for (const map of maps.slice(0, this.layered.fits.length)) {
      for (const c of corners) {
        radius = Math.max(radius, Math.hypot(this.#a(map[2 * c]!) - a, this.#b(map[2 * c + 1]!) - b));
      }
    }
    return regions.map((region) => ({ distance: region.near(a, b, radius) }));
  }

  /**
   * Sample one pixel: writes [p, q, opacity] in pixels of the level.
   * @param s the place of the pixel in its cell
   */
  look(cell: number, s: number, t: number, out: number[]) {
    // Between several cuts, one distance does not decide the region.
    if (this.isMoving && (this.here.length === 1 || !this.layered.hasRest)) this.#lookQuickly(cell, s, t, out);
    else this.#lookExactly(cell, s, t, out);
  }

  /** Distances between the nodes are interpolated while something moves; at a corner of a cut that is not exact. */
  #lookQuickly(cell: number, s: number, t: number, out: number[]) {
    const { layered, depths, here, softness, work } = this,
      { columns, rows } = this.nodes,
      { covers } = work;
    const e = cell % columns < columns - 1 ? 1 : 0,
      d = cell < (rows - 1) * columns ? columns : 0;
    let key = 0,
      inside = Infinity,
      still = 1,
      sum = 0,
      best = 0;
    for (let k = 0; k < here.length; k++) {
      const value = between(here[k]!, cell, e, d, s, t);
      if (value < 0) key |= 1 << k;
      inside = Math.min(inside, Math.abs(value));
    }
    const own = this.fitOf[key]!;
    for (let k = 0; k < depths.length; k++)
      sum += covers[k] = coverage(between(depths[k]!, cell, e, d, s, t), softness);
    let k = own;
    if (layered.rule === "paper") {
      out[2] = own < 0 ? 1 : Math.min(1, covers[own]! / coverage(inside, softness));
    } else {
      if (layered.hasRest) still = own < 0 ? coverage(inside, softness) : 1 - coverage(inside, softness);
      else still = 0;
      best = own < 0 ? still : covers[own]!;
      if (best < 0.5) {
        for (let n = 0; n < covers.length && n < depths.length; n++)
          if (covers[n]! > best) {
            best = covers[n]!;
            k = n;
          }
        if (still > best) k = -1;
      }
      out[2] = Math.min(1, sum + still);
    }
    const map = this.maps[k < 0 ? this.still : k]!;
    out[0] = between(map, 2 * cell, 2 * e, 2 * d, s, t);
    out[1] = between(map, 2 * cell + 1, 2 * e, 2 * d, s, t);
  }

  #lookExactly(cell: number, s: number, t: number, out: number[]) {
    const { columns } = this.nodes,
      { layered, maps, moves, work } = this,
      j = cell % columns,
      i = (cell - j) / columns;
    const { a0, b0, step, rows } = this.nodes,
      a = a0 + (j + s) * step,
      b = b0 + (i + t) * step;
    const east = j < columns - 1 ? 2 : 0,
      south = i < rows - 1 ? 2 * columns : 0;
    for (let k = 0; k < layered.fits.length; k++) {
      for (let c = 0; c < 2; c++) work.pixels[2 * k + c] = between(maps[k]!, 2 * cell + c, east, south, s, t);
      moves[k] ??= [0, 0];
      moves[k]![0] = this.#a(work.pixels[2 * k]!) - a;
      moves[k]![1] = this.#b(work.pixels[2 * k + 1]!) - b;
    }
    const [, , opacity, k] = chosenPlace(layered, this.#regionsAt(cell), a, b, this.move, this.softness, work.out) as [
      number,
      number,
      number,
      number,
    ];
    out[2] = opacity;
    if (k < 0) {
      out[0] = (a - this.places.origin[0]) * this.places.scale[0] + this.places.shift;
      out[1] = (b - this.places.origin[1]) * this.places.scale[1] + this.places.shift;
    } else {
      out[0] = work.pixels[2 * k]!;
      out[1] = work.pixels[2 * k + 1]!;
    }
  }

  move = (k: number) => this.moves[k]!;
}

/** Bilinear between four nodes. */
export function between(values: Float32Array, at: number, east: number, south: number, s: number, t: number) {
  const p = values[at]!,
    r = values[at + south]!,
    top = p + s * (values[at + east]! - p);
  return top + t * (r + s * (values[at + south + east]! - r) - top);
}

/** The distance of two nodes' images in the picture. */
function distanceBetween(map: Float32Array, m: number, n: number, scale: Vector2) {
  const a = (map[2 * m]! - map[2 * n]!) / scale[0],
    b = (map[2 * m + 1]! - map[2 * n + 1]!) / scale[1];
  return Math.sqrt(a * a + b * b);
}

/**
 * The pixels of all cells that show more than one map, or nothing.
 * @param paper red, green and blue
 * @param colours the pixel of each grey value
 */
function lookUpLayers(
  out: Uint32Array,
  w: number,
  h: number,
  layers: LayerPlan,
  lattice: number,
  { pixels, width, height }: Level,
  channels: number,
  fill: number,
  rim: number,
  paper: number[],
  colours: Uint32Array,
) {
  const {
      plan,
      nodes: { columns },
    } = layers,
    seen: Vector3 = [0, 0, 1],
    right = width - 1,
    bottom = height - 1;
  const empty = OPAQUE | (paper[2]! << 16) | (paper[1]! << 8) | paper[0]!;
  for (let y = 0; y < h; y++) {
    const i = Math.min(Math.floor(y / lattice), Math.max(0, Math.floor((h - 2) / lattice))),
      t = y / lattice - i;
    for (let j = 0, x = 0; x < w; j++) {
      const last = Math.min(w, x + lattice),
        cell = i * columns + j,
        first = x;
      if (plan[cell]! >= 0) {
        x = last;
        continue;
      }
      if (plan[cell] === LAYER_EMPTY) {
        out.fill(empty, y * w + x, y * w + last);
        x = last;
        continue;
      }
      for (; x < last; x++) {
        layers.look(cell, (x - first) / lattice, t, seen);
        const [u, v, opacity] = seen;
        if (opacity === 0) {
          out[y * w + x] = empty;
          continue;
        }
        const isIn = u >= -rim && v >= -rim && u < right + rim && v < bottom + rim;
        const p = Math.max(0, Math.min(right, u)),
          q = Math.max(0, Math.min(bottom, v)),
          pi = p | 0,
          qi = q | 0;
        const s = p - pi,
          f = q - qi,
          at = channels * (qi * width + pi),
          east = pi < right ? channels : 0;
        const low = at + (qi < bottom ? channels * width : 0);
        let colour = OPAQUE,
          looked = 0;
        for (let c = 0; c < 3; c++) {
          if (c === 0 || channels > 1) {
            const top = pixels[at + c]! + s * (pixels[at + east + c]! - pixels[at + c]!);
            const bed = pixels[low + c]! + s * (pixels[low + east + c]! - pixels[low + c]!);
            looked = isIn ? top + f * (bed - top) : fill;
          }
          const value = channels > 1 ? looked : (colours[(looked + 0.5) | 0]! >>> (8 * c)) & 255;
          colour |= ((paper[c]! + opacity * (value - paper[c]!) + 0.5) | 0) << (8 * c);
        }
        out[y * w + x] = colour;
      }
    }
  }
}
