// Kernels of Python without a formula here: as tables of polynomials (deformnb/widgets/kernel_table.py).

import type { KernelTable } from "../types.ts";
import type { Kernel } from "./rbf.ts";

const TERMS = 16; // coefficients of a polynomial

/** phi at 0, phi and slope at the first edge, phi and slope at the last one */
type Ends = [at0: number, phi0: number, slope0: number, phi1: number, slope1: number];
const AT_ENDS = 5;

/** A kernel by its table. */
export function kernelOfTable({ title, order, compact, share, gaps, pieces, numbers }: KernelTable): Kernel {
  const all = new Float64Array(Uint8Array.from(atob(numbers), (c) => c.charCodeAt(0)).buffer);
  const [at0, phi0, slope0, phi1, slope1] = [...all.subarray(0, AT_ENDS)] as Ends,
    edges = all.subarray(AT_ENDS, AT_ENDS + pieces + 1);
  const powers = all.subarray(AT_ENDS + pieces + 1),
    least = edges[0]!,
    most = edges[pieces]!;
  const power = phi1 === 0 ? 0 : (slope1 * most) / phi1; // phi continues as a power of s
  const float = new Float64Array(1),
    words = new Int32Array(float.buffer);
  /** The octave of a number, the exponent of 2. */
  const octaveOf = (s: number) => {
    float[0] = s;
    return words[1]! >> 20;
  };
  const low = octaveOf(least),
    firsts = new Int32Array(octaveOf(most) - low);
  for (let k = pieces - 1; k >= 0; k--) firsts[octaveOf(edges[k]!) - low] = k;
  const inPiece = (s: number, which: number) => {
    let k = firsts[octaveOf(s) - low]!;
    while (s >= edges[k + 1]!) k += 1;
    const a = edges[k]!,
      b = edges[k + 1]!,
      t = (s - a - (b - s)) / (b - a),
      at = (2 * k + which) * TERMS;
    let value = powers[at + TERMS - 1]!;
    for (let i = at + TERMS - 2; i >= at; i--) value = value * t + powers[i]!;
    return value;
  };
  return {
    title,
    order,
    compact,
    share,
    gaps: gaps ?? Infinity,
    profile: (s) => {
      if (s < least) return at0 + (phi0 - at0) * Math.sqrt(s / least);
      if (s < most) return inPiece(s, 0);
      return compact ? 0 : phi1 * (s / most) ** power;
    },
    slope: (s) => {
      if (s < least) return slope0;
      if (s < most) return inPiece(s, 1);
      return compact ? 0 : slope1 * (s / most) ** (power - 1);
    },
  };
}
