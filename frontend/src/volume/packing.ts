// The payload of a volume for an editor and a live view, made in the browser: the voxels as bytes in packed pieces,
// a maximum projection, and the textures of a displacement that is zero still. See deformnb/widgets/packed_volume.py,
// deformnb/imaging/projection.py and deformnb/widgets/textures.py.

import type { Values, Volume } from "../formats/volume_files.ts";
import { MAP_SIZE, METAL, MOST_VOXELS_SENT, PACKED_CHUNK_BYTES, SATURATED, WINDOWS_AROUND } from "../generated.ts";
import type { Axis } from "../maths/axes.ts";
import { AXES, perAxis } from "../maths/axes.ts";
import { added, dot } from "../maths/camera.ts";
import type { Plane, Vector2, Vector3 } from "../types.ts";
import type { Grid } from "./grid.ts";
import {
  boundsOf,
  coarserGrid,
  cornersOf,
  countAlong,
  frameOf,
  lengthsOf,
  planeAlong,
  toFrame,
  toPlane,
  unitOf,
  voxelOrder,
} from "./grid.ts";
import type { Measured } from "./levels.ts";

const LONGEST = 1024;

/** Yields to the browser, to draw between two pieces of work. */
const rest = () => new Promise((resolve) => setTimeout(resolve, 0));

/** Numbers of voxels to average along x, y, z: always along the axes where they are closest. */
export function factorsOf(grid: Grid) {
  const factors: Vector3 = [1, 1, 1];
  for (;;) {
    const left = perAxis((k) => Math.ceil(countAlong(grid, k) / factors[k])),
      isLong = perAxis((k) => left[k] > LONGEST);
    if (!isLong.includes(true) && left[0] * left[1] * left[2] <= MOST_VOXELS_SENT) return factors;
    const can = isLong.includes(true) ? isLong : perAxis((k) => left[k] > 1);
    const sizes = perAxis((k) => (can[k] ? factors[k] * grid.spacing[k] : Infinity));
    factors[sizes.indexOf(Math.min(...sizes)) as Axis] += 1;
  }
}

/** The voxels as bytes of a window of values, averaged over blocks; of labels the first of each. */
export async function bytesOfVolume(
  { values, grid, isLabels }: Volume,
  [fx, fy, fz]: Vector3,
  [low, high]: Vector2,
  progress: (share: number) => void,
  signal?: AbortSignal,
) {
  const [nz, ny, nx] = grid.shape,
    [mz, my, mx] = coarserGrid(grid, [fx, fy, fz]).shape,
    scale = 255 / (high - low);
  const bytes = new Uint8Array(mz * my * mx),
    isWhole = fx * fy * fz === 1 || isLabels;
  const every = Math.max(1, Math.floor(2 ** 22 / (fz * ny * nx)));
  let at = 0;
  for (let k = 0; k < mz; k++) {
    for (let j = 0; j < my; j++) {
      for (let i = 0; i < mx; i++, at++) {
        const first = (k * fz * ny + j * fy) * nx + i * fx;
        let value = values[first]!;
        if (!isWhole) {
          const ez = Math.min(fz, nz - k * fz),
            ey = Math.min(fy, ny - j * fy),
            ex = Math.min(fx, nx - i * fx);
          value = 0;
          for (let c = 0; c < ez; c++) {
            for (let b = 0; b < ey; b++) {
              const row = first + (c * ny + b) * nx;
              for (let a = 0; a < ex; a++) value += values[row + a]!;
            }
          }
          value /= ex * ey * ez;
        }
        bytes[at] = Math.min(255, Math.max(0, (value - low) * scale + 0.5));
      }
    }
    if (k % every === every - 1) {
      progress((k + 1) / mz);
      await rest();
      signal?.throwIfAborted();
    }
  }
  return bytes;
}

/** Pieces of whole slices, packed as those of a file. */
export async function piecesOf(bytes: Uint8Array<ArrayBuffer>, [, ny, nx]: Vector3, signal?: AbortSignal) {
  const size = Math.max(1, Math.floor(PACKED_CHUNK_BYTES / (ny * nx))) * ny * nx,
    pieces = [];
  for (let start = 0; start < bytes.length; start += size) {
    signal?.throwIfAborted();
    const stream = new Blob([bytes.subarray(start, start + size)]).stream().pipeThrough(new CompressionStream("gzip"));
    pieces.push({ start, lag: 0, packed: new DataView(await new Response(stream).arrayBuffer()) });
  }
  return pieces;
}

/** The maximum of each column of voxels along a plane's normal, [v, u]. */
export function maximumProjection({ values, grid }: Volume, plane: Plane) {
  const [, ny, nx] = grid.shape,
    strides: Vector3 = [1, nx, nx * ny];
  const order = voxelOrder(grid, plane);
  const walkOf = ({ axis, sign }: (typeof order)[number]) => {
    const count = countAlong(grid, axis);
    return { count, step: sign * strides[axis], first: sign > 0 ? 0 : (count - 1) * strides[axis] };
  };
  const [n, v, u] = [walkOf(order[0]), walkOf(order[1]), walkOf(order[2])] as const;
  const Kind = values.constructor as { new (size: number): Values },
    out = new Kind(v.count * u.count);
  let at = 0;
  for (let b = 0; b < v.count; b++) {
    for (let a = 0; a < u.count; a++, at++) {
      let place = n.first + v.first + b * v.step + u.first + a * u.step,
        most = values[place]!;
      for (let c = 1; c < n.count; c++) {
        place += n.step;
        if (values[place]! > most) most = values[place]!;
      }
      out[at] = most;
    }
  }
  return out;
}

function quantile(sorted: Float64Array, share: number) {
  const at = share * (sorted.length - 1),
    low = Math.floor(at),
    high = Math.min(low + 1, sorted.length - 1);
  return sorted[low]! + (at - low) * (sorted[high]! - sorted[low]!);
}

/** Values of a grey picture shown as black and white. */
export function pictureWindow(
  pixels: Values,
  { isLabels }: Volume,
  { range: [lowest, highest], whole, hounsfield }: Measured,
): Vector2 {
  const most = hounsfield ? Math.min(highest, METAL) : highest;
  const shown = Float64Array.from(pixels)
    .filter((value) => value >= lowest && value <= most)
    .sort();
  const isEven = isLabels || !shown.length || shown[0] === shown[shown.length - 1];
  const low = isEven ? whole[0] : quantile(shown, SATURATED),
    subject = shown.filter((value) => value > low);
  const high = subject.length ? quantile(subject, 1 - SATURATED) : low;
  const isReal = pixels instanceof Float32Array || pixels instanceof Float64Array;
  return [low, high > low ? high : low + Math.max(1, Math.abs(low)) * (isReal ? 1e-6 : 1)];
}

/** The pixels of a grey picture as an editor receives them: red, green, blue and alpha, and their meaning. */
export function packedPicture(pixels: Values, window: Vector2) {
  const [black, white] = window,
    margin = WINDOWS_AROUND * (white - black);
  let least = Infinity,
    most = -Infinity;
  for (const value of pixels) {
    if (value < least) least = value;
    if (value > most) most = value;
  }
  let low = Math.max(least, black - margin),
    high = Math.min(most, white + margin);
  if (!(low < high)) [low, high] = window;
  const isReal = pixels instanceof Float32Array || pixels instanceof Float64Array,
    isByte = !isReal && high - low <= 255;
  if (isByte) high = low + 255;
  const rgba = new Uint8ClampedArray(4 * pixels.length),
    top = isByte ? 255 : 65535;
  pixels.forEach((value: number, k: number) => {
    const number = Math.floor(Math.min(1, Math.max(0, (value - low) / (high - low))) * top + 0.5);
    rgba.set(isByte ? [number, number, number, 255] : [number >> 8, number & 255, 0, 255], 4 * k);
  });
  const range: Vector2 = [low, high];
  return { rgba, facts: { channels: isByte ? 1 : 2, range, window, unit: "" } };
}

/** Facts of a packed volume for a live view. */
export function volumeInfo(
  { grid: own, isLabels }: Volume,
  { whole, levels }: Measured,
  packed: { id: string; grid: Grid; chunks: number; window: Vector2; share: number; views: string[] },
) {
  const {
    id,
    grid,
    chunks,
    window: [low, high],
    share,
    views,
  } = packed;
  const shareOf = (value: number) => (value - low) / (high - low);
  const clipped = (value: number, least: number) => Math.min(1, Math.max(least, value));
  const looks = Object.fromEntries(
    views.map((view) => {
      const { n, v } = planeAlong(own, view);
      return [view, { direction: n, up: v.map((x) => -x) }];
    }),
  );
  return {
    id,
    shape: grid.shape.toReversed(),
    spacing: grid.spacing,
    origin: grid.origin,
    chunks,
    to_frame: frameOf(grid),
    axes: grid.direction,
    box: boxOf(own, grid),
    outside: Math.floor(clipped(shareOf(whole[0]), 0) * 255 + 0.5),
    is_labels: isLabels,
    grey: [0, clipped(shareOf(isLabels ? high : levels[3]), 1 / 255)],
    share,
    unit: unitOf(own),
    note: grid.shape.every((n, k) => n === own.shape[k]) ? "" : "shown at a lower resolution",
    views: { ...looks, home: { direction: [0.4, 1, -0.3], up: [0, 0, 1] } },
  };
}

/** The box of a grid along the axes of another. */
function boxOf(own: Grid, grid: Grid) {
  const middle = toFrame(grid, own.origin),
    lengths = lengthsOf(own),
    low = perAxis((k) => middle[k] - own.spacing[k] / 2);
  return { low, high: added(low, lengths) };
}

/**
 * The message "field" of a displacement over a plane that is zero; the client fits it to the points.
 * @param grid of the packed voxels
 */
export function stillField(own: Grid, grid: Grid, plane: Plane) {
  const { low, high } = boundsOf(toPlane(plane, cornersOf(own))),
    size: Vector2 = [high[0] - low[0], high[1] - low[1]];
  const longest = Math.max(...size),
    samples = (s: number) => Math.max(8, Math.ceil((MAP_SIZE * s) / longest)),
    columns = samples(size[0]),
    rows = samples(size[1]);
  const depths = boundsOf(toPlane(plane, cornersOf(own, true))),
    frame = frameOf(grid);
  const turned = (w: Vector3) => perAxis((i) => dot(frame[i], w));
  /** The spacing of the voxels in a direction. */
  const spacingAlong = (w: Vector3) =>
    AXES.reduce<number>((sum, k) => {
      const cosine = AXES.reduce<number>((total, i) => total + own.direction[i][k] * w[i], 0);
      return sum + cosine * cosine * own.spacing[k];
    }, 0);
  const planar = {
    shape: [1, rows, columns],
    origin: [low[0], low[1]],
    spacing: [size[0] / (columns - 1), size[1] / (rows - 1)],
    depth: [depths.low[2], depths.high[2]],
    isReplicated: true,
    cut: null,
    softness: (spacingAlong(plane.u) + spacingAlong(plane.v)) / 2,
    plane: { origin: toFrame(grid, plane.origin), u: turned(plane.u), v: turned(plane.v), n: turned(plane.n) },
  };
  return {
    content: {
      type: "field",
      seq: 0,
      box: boxOf(own, grid),
      planar,
      space: null,
      coarse: false,
      buffers: ["maps", "weights"],
      follow: { index: 0, points: [] },
    },
    buffers: [new DataView(new Float32Array(2 * rows * columns).buffer), new DataView(new Float32Array([1, 1]).buffer)],
  };
}

/** The corners of a picture on the outermost voxels' centres, as points that fix it. */
export function cornerPoints(grid: Grid, plane: Plane) {
  const {
    low: [a0, b0],
    high: [a1, b1],
  } = boundsOf(toPlane(plane, cornersOf(grid, true)));
  const corners: Vector2[] = [
    [a0, b0],
    [a1, b0],
    [a1, b1],
    [a0, b1],
  ];
  return corners.map((place, id) => ({
    id,
    name: "corner",
    source: place,
    target: [...place],
    active: true,
    weight: 1,
    locked: false,
    radius: null,
  }));
}
