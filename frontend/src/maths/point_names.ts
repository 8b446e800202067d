// The names of control points for people: their own, or their numbers in the list from 1, as ControlPoints.label in
// deformnb.rbf.points. Ids are for programs: they are never given twice, so that the fifth point may have the id 13.

type Listed = { readonly id: number; readonly name: string };

const NUMBERS = new WeakMap<readonly Listed[], Map<number, number>>();

/** The number from 1 of the point with this id in a list; 0 if there is none. */
export function numberOf(points: readonly Listed[], id: number) {
  let known = NUMBERS.get(points);
  if (!known || known.size !== points.length) {
    known = new Map(points.map((p, k) => [p.id, k + 1]));
    NUMBERS.set(points, known);
  }
  return known.get(id) ?? 0;
}

/** The label of a point with its number: 'point 3 ("nose")'. */
export function labelOf({ name }: { name: string }, number: number) {
  return `point ${number}${name ? ` ("${name}")` : ""}`;
}

/** The name of a point, or "point 3". */
export function nameOf({ name }: { name: string }, number: number) {
  return name || `point ${number}`;
}

/** The points with their numbers, which subsets keep; those of a subset are given back as they are. */
export function numberPoints<P extends { number?: number }>(points: P[]): P[] {
  return points[0]?.number === undefined ? points.map((p, k) => ({ ...p, number: k + 1 })) : points;
}

/** Whether a message names the point of this label: "point 1" is no part of "point 12". */
export function isNamed(message: string, label: string) {
  return message.split(label).some((rest, k) => k > 0 && !/^\d/.test(rest));
}
