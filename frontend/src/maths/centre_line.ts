// A bent subject unbent along a centre line, as deformnb.document.centre_line: places on the smoothed line and at offsets
// on both sides go to a straight line of the same length, through the middle of the line in the direction of its ends.

import type { Vector2 } from "../types.ts";

const FINE = 65,
  SMOOTH = 2,
  TAPS = 6,
  STATIONS = 9,
  INNER = 0.8,
  CHORD = 0.2; // as in Python

/** Places at equal distances along a line, with both ends. */
export function resampleLine(line: Vector2[], count: number): Vector2[] {
  const along = [0];
  for (let k = 1; k < line.length; k++) along.push(along[k - 1]! + distance(line[k - 1]!, line[k]!));
  const length = along.at(-1)!;
  let k = 0;
  return Array.from({ length: count }, (_, n) => {
    const at = (length * n) / (count - 1);
    while (k < line.length - 2 && along[k + 1]! < at) k++;
    const step = along[k + 1]! - along[k]!,
      t = step > 0 ? Math.min(1, (at - along[k]!) / step) : 0;
    return between(line[k]!, line[k + 1]!, t);
  });
}

/** A drawn line without its jitter; its ends stay. */
export function smoothLine(line: Vector2[]): Vector2[] {
  const fine = resampleLine(line, FINE),
    last = FINE - 1;
  const at = (k: number): Vector2 =>
    k < 0 ? between(fine[-k]!, fine[0]!, 2) : k > last ? between(fine[2 * last - k]!, fine[last]!, 2) : fine[k]!;
  const weights = Array.from({ length: 2 * TAPS + 1 }, (_, k) => Math.exp(-0.5 * ((k - TAPS) / SMOOTH) ** 2)),
    whole = weights.reduce((sum, weight) => sum + weight, 0);
  const smooth = fine.map((_, k): Vector2 => {
    let a = 0,
      b = 0;
    weights.forEach((weight, n) => {
      const [p, q] = at(k + n - TAPS);
      a += (weight * p) / whole;
      b += (weight * q) / whole;
    });
    return [a, b];
  });
  return resampleLine(smooth, FINE);
}

/** A place along the smoothed line, the direction there, and the bend in radians per length. */
type Station = { place: Vector2; along: Vector2; bend: number; away: number };

/** Stations along a line, its length, its middle, and the direction from its first end to its last. */
export function stationsOf(centreLine: Vector2[]) {
  const line = smoothLine(centreLine),
    last = FINE - 1;
  let length = 0;
  for (let k = 0; k < last; k++) length += distance(line[k]!, line[k + 1]!);
  const slopes = line.map((_, k): Vector2 => {
    const [p, q] = [line[Math.max(0, k - 1)]!, line[Math.min(last, k + 1)]!],
      size = distance(p, q) || 1;
    return [(q[0] - p[0]) / size, (q[1] - p[1]) / size];
  });
  const turn = ([a, b]: Vector2, [c, d]: Vector2) => Math.atan2(a * d - b * c, a * c + b * d);
  const station = (k: number): Station => {
    const [low, high] = [Math.max(0, k - 1), Math.min(last, k + 1)];
    const bend = turn(slopes[low]!, slopes[high]!) / (((high - low) * length) / last);
    return { place: line[k]!, along: slopes[k]!, bend, away: length * (k / last - 0.5) };
  };
  const stations = Array.from({ length: STATIONS }, (_, n) => station(Math.round((n * last) / (STATIONS - 1))));
  const middle = station(last / 2),
    [first, end] = [line[0]!, line[last]!],
    span = distance(first, end);
  const direction: Vector2 =
    span > CHORD * length ? [(end[0] - first[0]) / span, (end[1] - first[1]) / span] : middle.along;
  return { stations, length, middle: middle.place, direction };
}

/** Places along a centre line and beside it, as far as half a width, and where each goes when the line is straight. */
export function straightenedPlaces(centreLine: Vector2[], halfWidth: number) {
  const { stations, middle, direction } = stationsOf(centreLine),
    [u, v] = direction,
    pairs: { from: Vector2; to: Vector2 }[] = [];
  for (const { place, along, bend, away } of stations) {
    for (const side of [-1, 0, 1]) {
      const offset = side * (side * bend > 0 ? Math.min(halfWidth, INNER / Math.abs(bend)) : halfWidth);
      pairs.push({
        from: [place[0] - offset * along[1], place[1] + offset * along[0]],
        to: [middle[0] + away * u - offset * v, middle[1] + away * v + offset * u],
      });
    }
  }
  return pairs;
}

/**
 * Half of the width of what a line runs along: as far as tissue reaches on either side, at four fifths of the stations.
 * @param isTissue at a place
 * @param step between two places that are looked at
 */
export function halfWidthAlong(line: Vector2[], isTissue: (a: number, b: number) => boolean, step: number) {
  const { stations, length } = stationsOf(line),
    found: number[] = [];
  for (const { place, along } of stations) {
    for (const side of [-1, 1]) {
      let away = 0;
      while (away < length / 3 && isTissue(place[0] - side * away * along[1], place[1] + side * away * along[0]))
        away += step;
      found.push(away);
    }
  }
  found.sort((p, q) => p - q);
  const width = found[Math.floor(0.8 * found.length)]!;
  return Math.max(length / 40, Math.min(length / 4, width));
}

/** Distance of a place from a line. */
export function distanceToLine(line: Vector2[], place: Vector2) {
  return Math.min(...resampleLine(line, FINE).map((one) => distance(one, place)));
}

function distance([a, b]: Vector2, [c, d]: Vector2) {
  return Math.hypot(c - a, d - b);
}

function between([a, b]: Vector2, [c, d]: Vector2, t: number): Vector2 {
  return [a + t * (c - a), b + t * (d - b)];
}
