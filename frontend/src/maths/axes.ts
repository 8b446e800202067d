// The three axes of a volume or of space.

export const AXES = [0, 1, 2] as const;
export type Axis = (typeof AXES)[number];

/** The values of a function of each axis. */
export function perAxis<T>(value: (axis: Axis) => T): [T, T, T] {
  return [value(0), value(1), value(2)];
}
