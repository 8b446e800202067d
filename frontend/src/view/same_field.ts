// Whether two fields of a view give the same picture: the answer of Python to an edit that was drawn here draws nothing
// again. No DOM.

import type { PlanarField } from "../webgl/types.ts";
import type { Field } from "./types.ts";

const SAME_SAMPLE = 1e-3; // of the distance of two samples of a map: they are numbers of single precision

/** Whether two fields are the same; displacements in space count as different. */
export function isSameField(one: Field, other: Field) {
  const { planar, space, box, coarse } = one;
  if (space || other.space || !planar || !other.planar) return false;
  const isAlike = JSON.stringify(box) === JSON.stringify(other.box) && Boolean(coarse) === Boolean(other.coarse);
  return isAlike && isSamePlanar(planar, other.planar);
}

/** Whether maps over a plane are the same to within what can be seen. */
export function isSamePlanar(one: PlanarField, other: PlanarField) {
  if (one === other) return true;
  const words = ({ plane, shape, origin, spacing, depth, softness, isReplicated, cut }: PlanarField) =>
    JSON.stringify([
      plane,
      shape,
      origin,
      spacing,
      depth,
      softness,
      isReplicated,
      cut && [cut.sides, cut.rule, cut.shape],
    ]);
  if (words(one) !== words(other) || one.cut?.distances !== other.cut?.distances) return false;
  return (
    areNear(one.weights, other.weights, 0) && areNear(one.maps, other.maps, SAME_SAMPLE * Math.min(...one.spacing))
  );
}

function areNear(one: Float32Array, other: Float32Array, most: number) {
  if (one.length !== other.length) return false;
  for (let k = 0; k < one.length; k++) if (!(Math.abs(one[k]! - other[k]!) <= most)) return false;
  return true;
}
