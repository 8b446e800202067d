// Encoding for the shader of which cuts the regions of the plane are inside of.

/** The sides of a region as one number: bit c is set inside cut c. */
export function bitsOf(sides: boolean[]) {
  return sides.reduce((sum, inside, c) => sum + (inside ? 2 ** c : 0), 0);
}
