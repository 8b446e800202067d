// Numbers as they are shown.

/** A length with one digit after the decimal point, from 100 on with none. */
export function formatLength(value: number) {
  return String(Number(value.toFixed(Math.abs(value) >= 100 ? 0 : 1)));
}
