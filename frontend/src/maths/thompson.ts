// D'Arcy Thompson's grids without Python: a pair placed on a picture as deformnb.datasets.thompson_map does, the score of
// a deformation against it as deformnb.datasets.thompson_score, and where the cells have grown.

import type { LayeredFit, Vector2, Vector4 } from "../types.ts";
import { newPoint } from "./points.ts";
import { findVisiblePlace } from "./warp_map.ts";

/** Nodes of a grid, row by row from back to belly, each from head to tail. */
export type Nodes = Vector2[][];

/** A pair of grids in the coordinates of a picture. */
export interface PlacedPair {
  source: Nodes;
  target: Nodes;
  /** Of a drawing of the target: a place p of it is at scale * p + shift of the picture. */
  scale: Vector2;
  shift: Vector2;
}

/** Where a pair is placed: the subject's box, the box in which the target has to be, and the side of the head. */
export interface Placement {
  box: Vector4;
  /** None where the target may be of any size: it then has the source's area. */
  frame?: Vector4;
  head?: "left" | "right";
}

const NEAR = 1e-6; // of a picture's unit: the tolerance of the place to which a node is moved

/** A grid with other numbers of lines on the same bent surface, linear along its lines. */
export function resampleNodes(nodes: Nodes, rows: number, columns: number): Nodes {
  const between = (p: Vector2, q: Vector2, share: number): Vector2 => [
    p[0] + share * (q[0] - p[0]),
    p[1] + share * (q[1] - p[1]),
  ];
  const along = <T>(line: T[], count: number, mix: (p: T, q: T, share: number) => T) =>
    Array.from({ length: count }, (_, k) => {
      const at = (k * (line.length - 1)) / (count - 1),
        low = Math.min(Math.floor(at), line.length - 2);
      return mix(line[low]!, line[low + 1]!, at - low);
    });
  const down = along(nodes, rows, (p, q, share) => p.map((place, j) => between(place, q[j]!, share)));
  return down.map((row) => along(row, columns, between));
}

/** The bounding box a0, a1, b0, b1 of nodes. */
export function boxOfNodes(nodes: Nodes): Vector4 {
  const flat = nodes.flat(),
    along = (k: 0 | 1) => flat.map((p) => p[k]);
  return [Math.min(...along(0)), Math.max(...along(0)), Math.min(...along(1)), Math.max(...along(1))];
}

/** The area inside the outline of a grid, by the shoelace formula. */
function areaOf(nodes: Nodes) {
  const down = (j: number) => nodes.slice(1).map((row) => row.at(j)!);
  const rim = [...nodes[0]!, ...down(-1), ...nodes.at(-1)!.slice(0, -1).reverse(), ...down(0).slice(0, -1).reverse()];
  const twice = rim.reduce((sum, [x, y], k) => {
    const [p, q] = rim[(k + 1) % rim.length]!;
    return sum + x * q - p * y;
  }, 0);
  return Math.abs(twice) / 2;
}

function meanOf(nodes: Nodes): Vector2 {
  const flat = nodes.flat(),
    along = (k: 0 | 1) => flat.reduce((sum, p) => sum + p[k], 0) / flat.length;
  return [along(0), along(1)];
}

const mapped = (nodes: Nodes, map: (x: number, k: 0 | 1) => number) =>
  nodes.map((row) => row.map(([x, y]): Vector2 => [map(x, 0), map(y, 1)]));

/**
 * A pair of grids placed on a picture: the source fills a box, and the target has the same area and mean node, or is
 * smaller and moved where it would leave the frame.
 */
export function placePair(source: Nodes, target: Nodes, { box, frame, head = "left" }: Placement): PlacedPair {
  const own = boxOfNodes(source),
    sideOf = ([a0, a1, b0, b1]: Vector4, k: 0 | 1): Vector2 => (k ? [b0, b1] : [a0, a1]);
  const [factorA, factorB] = ([0, 1] as const).map((k) => {
    const [low, high] = sideOf(box, k),
      [first, last] = sideOf(own, k);
    return (high - low) / (last - first);
  }) as Vector2;
  const factor: Vector2 = [factorA, factorB],
    base: Vector2 = [box[0] - factorA * own[0], box[2] - factorB * own[2]];
  let room = frame;
  if (room && head === "right") room = [box[0] + box[1] - room[1], box[0] + box[1] - room[0], room[2], room[3]];
  const extent = boxOfNodes(target);
  let size = Math.sqrt(areaOf(source) / areaOf(target));
  if (room) {
    for (const k of [0, 1] as const) {
      const [low, high] = sideOf(room, k),
        [first, last] = sideOf(extent, k);
      size = Math.min(size, (high - low) / factor[k] / (last - first));
    }
  }
  const from = meanOf(source),
    to = meanOf(target);
  const scale: Vector2 = [size * factorA, size * factorB],
    shift: Vector2 = [base[0] + factorA * from[0] - scale[0] * to[0], base[1] + factorB * from[1] - scale[1] * to[1]];
  if (room) {
    for (const k of [0, 1] as const) {
      const [low, high] = sideOf(room, k),
        [first, last] = sideOf(extent, k).map((x) => scale[k] * x + shift[k]) as Vector2;
      shift[k] += Math.max(low - first, 0) + Math.min(high - last, 0);
    }
  }
  let placed = mapped(source, (x, k) => factor[k] * x + base[k]);
  if (head === "right") {
    const mirror = (x: number, k: 0 | 1) => (k ? x : box[0] + box[1] - x);
    placed = mapped(placed, mirror);
    scale[0] = -scale[0];
    shift[0] = box[0] + box[1] - shift[0];
  }
  return { source: placed, target: mapped(target, (x, k) => scale[k] * x + shift[k]), scale, shift };
}

/** The control points at all nodes of a pair, or at those of some numbers, named by these numbers from 1. */
export function pairPoints({ source, target }: Pick<PlacedPair, "source" | "target">, chosen?: number[]) {
  const from = source.flat(),
    to = target.flat();
  return (chosen ?? from.map((_, k) => k)).map((k, id) => newPoint(id, from[k]!, to[k]!, chosen ? String(id + 1) : ""));
}

/** The numbers of twelve nodes of a grid: of three rows and four columns, spread evenly with those at its border. */
export function twelveNodes(nodes: Nodes) {
  const columns = nodes[0]!.length,
    at = (k: number, parts: number, count: number) => Math.round((k * (count - 1)) / parts);
  return [0, 1, 2].flatMap((i) => [0, 1, 2, 3].map((j) => at(i, 2, nodes.length) * columns + at(j, 3, columns)));
}

/** Progress of places towards goals. */
export interface Progress {
  /** 100 at the goals, 0 where nothing has moved, negative where places are farther away than before. */
  percent: number;
  /** Distances from the goals */
  distances: number[];
  /** The number of the place that is farthest from its goal */
  worst: number;
}

const gap = ([a, b]: Vector2, [c, d]: Vector2) => Math.hypot(a - c, b - d);

/** How near places that began at sources have come to their goals. */
export function progressOf(source: Vector2[], reached: Vector2[], goals: Vector2[]): Progress {
  const sum = (values: number[]) => values.reduce((total, value) => total + value, 0);
  const distances = reached.map((place, k) => gap(place, goals[k]!)),
    before = sum(source.map((place, k) => gap(place, goals[k]!)));
  const worst = distances.indexOf(Math.max(...distances));
  return { percent: before > 0 ? 100 * (1 - sum(distances) / before) : 100, distances, worst };
}

/** Where a map takes the nodes of a grid; a node that has no place there, for the map folds or is cut, stays. */
export function reachedNodes(layered: LayeredFit, source: Nodes) {
  return source.flat().map((place) => findVisiblePlace(layered, place, NEAR) ?? place);
}

/** The row and column of a cell that is flat or turned over, as deformnb.datasets.custom_grid finds it; null for none. */
export function foldedCell(nodes: Nodes): Vector2 | null {
  const turned = (a: Vector2, b: Vector2, c: Vector2) =>
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) <= 0;
  for (const { row, column, corners } of cellsOf(nodes, nodes)) {
    const [p, q, r, s] = corners;
    if (turned(p, q, s) || turned(q, r, p) || turned(r, s, q) || turned(s, p, r)) return [row, column];
  }
  return null;
}

/** The area of a cell with corners in order. */
function cellArea([p, q, r, s]: Corners) {
  return Math.abs((r[0] - p[0]) * (s[1] - q[1]) - (r[1] - p[1]) * (s[0] - q[0])) / 2;
}

type Corners = [Vector2, Vector2, Vector2, Vector2];

/** A cell of a grid after a map. */
export interface Cell {
  row: number;
  column: number;
  corners: Corners;
  before: number;
  after: number;
  /** How many times its area it has, if the whole grid is of the same area before and after */
  times: number;
}

/** The cells of a grid after a map of its nodes, row by row. */
export function cellsOf(source: Nodes, target: Nodes): Cell[] {
  const at = (nodes: Nodes, i: number, j: number): Corners => [
    nodes[i]![j]!,
    nodes[i]![j + 1]!,
    nodes[i + 1]![j + 1]!,
    nodes[i + 1]![j]!,
  ];
  const found = source.slice(1).flatMap((_, row) =>
    source[0]!.slice(1).map((__, column) => {
      const corners = at(target, row, column);
      return { row, column, corners, before: cellArea(at(source, row, column)), after: cellArea(corners) };
    }),
  );
  const sum = (name: "before" | "after") => found.reduce((total, cell) => total + cell[name], 0),
    whole = sum("after") / sum("before");
  return found.map((cell) => ({ ...cell, times: cell.after / cell.before / whole }));
}

/** A third of an animal along both directions, and how many times its area it has after a map. */
export interface Growth {
  /** 0 at the back, 1 in the middle, 2 at the belly */
  row: number;
  /** 0 at the head, 1 in the middle, 2 at the tail */
  column: number;
  times: number;
}

/**
 * The thirds of a grid that have grown most and least, relative to the whole grid: each cell counts to the third in
 * which its middle is.
 */
export function growthOf(source: Nodes, target: Nodes): { most: Growth; least: Growth } {
  const third = (k: number, count: number) => Math.floor((3 * (k + 0.5)) / count),
    cells = cellsOf(source, target),
    whole = cells.reduce<Vector2>(([p, q], { before, after }) => [p + before, q + after], [0, 0]);
  const sums = new Map<number, Vector2>();
  for (const { row, column, before, after } of cells) {
    const key = 3 * third(row, source.length - 1) + third(column, source[0]!.length - 1),
      [p, q] = sums.get(key) ?? [0, 0];
    sums.set(key, [p + before, q + after]);
  }
  const sorted = [...sums]
    .map(([key, [before, after]]) => ({
      row: Math.floor(key / 3),
      column: key % 3,
      times: (after * whole[0]) / before / whole[1],
    }))
    .sort((p, q) => p.times - q.times);
  return { most: sorted.at(-1)!, least: sorted[0]! };
}
