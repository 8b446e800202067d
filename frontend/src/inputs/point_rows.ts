// The rows of the table of control points: the data that Python sends, columns, order, selection, texts. No DOM.

import type { PointsCommand } from "../generated.ts";
import { numberOf } from "../maths/point_names.ts";
import { setTrait } from "../sync/edits.ts";
import type { Model, Point } from "../types.ts";
import { targetSize } from "../ui/fingers.ts";

/** The names of the axes of a picture or of a volume. */
export function axisNames(dim: number) {
  return dim === 3 ? ["x", "y", "z"] : ["a", "b"];
}

const FLAGS = { active: 1, locked: 2, suspect: 4 };

/** A point: its source, target, weight, radius and error as numbers. */
export interface TableRow {
  id: number;
  name: string;
  active: boolean;
  locked: boolean;
  /** Whether it disagrees with its neighbours */
  suspect: boolean;
  numbers: Float64Array;
}

export interface Column {
  key: string;
  title: string;
  /** "fact" and "go" cannot be edited */
  kind: "fact" | "text" | "check" | "number" | "go";
  /** As in CSS */
  width: string;
  tip: string;
  /** The index in a row of numbers */
  at?: number;
  /** The field of a point, where it is not the key */
  field?: PointsCommand["field"];
  /** The index in this field */
  axis?: number;
}

export function pointColumns(dim: number): Column[] {
  const axes = axisNames(dim),
    unit = "in the volume's unit",
    number = "number" as const;
  return [
    { key: "id", title: "Id", kind: "fact", width: "52px", tip: "Id of the point in Python; never given twice" },
    { key: "name", title: "Name", kind: "text", width: "minmax(80px, 1fr)", tip: "Name of the point" },
    {
      key: "active",
      title: "On",
      kind: "check",
      width: `${targetSize(42)}px`,
      tip: "A point that is off stays in its place and is not fitted",
    },
    {
      key: "locked",
      title: "Lock",
      kind: "check",
      width: "48px",
      tip: "A locked point stays where it is until it is unlocked",
    },
    ...axes.map((axis, k) => ({
      key: `source_${axis}`,
      field: "source" as const,
      axis: k,
      title: `from ${axis}`,
      kind: number,
      at: k,
      width: "minmax(54px, 92px)",
      tip: `Source, ${axis}: where the feature is, ${unit}`,
    })),
    ...axes.map((axis, k) => ({
      key: `target_${axis}`,
      field: "target" as const,
      axis: k,
      title: `to ${axis}`,
      kind: number,
      at: dim + k,
      width: "minmax(54px, 92px)",
      tip: `Target, ${axis}: where the feature should be, ${unit}`,
    })),
    { key: "drag", title: "Drag", kind: "fact", width: "minmax(56px, 80px)", tip: `How far it is dragged, ${unit}` },
    {
      key: "weight",
      title: "Weight",
      kind: "number",
      at: 2 * dim,
      width: "64px",
      tip: "Weight of the point relative to others. It matters only with smoothing",
    },
    {
      key: "radius",
      title: "Radius",
      kind: "number",
      at: 2 * dim + 1,
      width: "64px",
      tip: `How far this point reaches, ${unit}; empty: as far as all (Support, under Interpolation)`,
    },
    {
      key: "error",
      title: "Off by",
      kind: "fact",
      at: 2 * dim + 2,
      width: "minmax(64px, 80px)",
      tip:
        `How far all other points would miss this one (leave-one-out error), ${unit}. ! marks a point that ` +
        "disagrees with its neighbours",
    },
    { key: "go", title: "", kind: "go", width: `${targetSize(34)}px`, tip: "Show the point in the picture" },
  ];
}

/** Columns by their keys or fields, the most wanted first, for narrow tables. */
const WANTED = ["name", "go", "active", "target", "drag", "source", "error", "locked", "id", "weight", "radius"];

/** The least width of a column in CSS pixels. */
export function leastWidth({ width }: Column) {
  return Number(width.match(/(\d+)px/)?.[1]);
}

/**
 * The columns that have room, in their order; the coordinates of a place together or not at all.
 * @param room CSS pixels
 */
export function fittingColumns(columns: Column[], room: number) {
  const kept = new Set(),
    sum = (some: Column[]) => some.reduce((all, column) => all + leastWidth(column), 0);
  let left = room;
  for (const wanted of WANTED) {
    const group = columns.filter(({ key, field }) => (field ?? key) === wanted),
      width = sum(group);
    if (width > left && kept.size) continue;
    left -= width;
    for (const column of group) kept.add(column);
  }
  return columns.filter((column) => kept.has(column));
}

function bytesOf(view: DataView | null | undefined) {
  return view ? view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength) : new ArrayBuffer(0);
}

/** All points of a model, or null while its traits do not fit together yet. */
export function readPoints(model: Model): TableRow[] | null {
  const ids: number[] = model.get("ids") ?? [];
  const names = model.get("names") ?? [],
    dim = model.get("dim"),
    width = 2 * dim + 3;
  const numbers = bytesOf(model.get("numbers")),
    flags = new Uint8Array(bytesOf(model.get("flags")));
  const isWhole = names.length === ids.length && flags.length === ids.length;
  if (!isWhole || numbers.byteLength !== 8 * width * ids.length) return null;
  const all = new Float64Array(numbers);
  return ids.map((id, k) => ({
    id,
    name: names[k],
    active: Boolean(flags[k]! & FLAGS.active),
    locked: Boolean(flags[k]! & FLAGS.locked),
    suspect: Boolean(flags[k]! & FLAGS.suspect),
    numbers: all.subarray(k * width, (k + 1) * width),
  }));
}

function dragOf(p: TableRow, dim: number) {
  let sum = 0;
  for (let k = 0; k < dim; k += 1) sum += (p.numbers[dim + k]! - p.numbers[k]!) ** 2;
  return Math.sqrt(sum);
}

/** The value of a cell, for its order and its text. */
export function cellValue(p: TableRow, { key, at }: Column, dim: number) {
  if (key === "drag") return dragOf(p, dim);
  return at === undefined ? p[key as "id" | "name" | "active" | "locked"] : p.numbers[at]!;
}

/** The text of a value while it is edited, with all digits; empty for no number. */
export function editText(value: string | number | boolean) {
  return Number.isNaN(value) ? "" : String(value);
}

export function formatNumber(value: number) {
  if (Number.isNaN(value)) return "";
  const size = Math.abs(value);
  if (size === 0) return "0";
  return size < 0.005 || size >= 1e7 ? value.toExponential(1) : value.toFixed(2);
}

/** Indices of the points in the order of a column; those without a value are last in both directions. */
export function sortPoints(points: TableRow[], column: Column | undefined, isDown: boolean, dim: number) {
  const places = points.map((_, k) => k);
  if (!column) return places;
  const values = points.map((p) => cellValue(p, column, dim)),
    sign = isDown ? -1 : 1;
  const isNothing = (v: string | number | boolean) => v === "" || Number.isNaN(v);
  return places.sort((i, j) => {
    const p = values[i]!,
      q = values[j]!;
    if (isNothing(p) || isNothing(q)) return Number(isNothing(p)) - Number(isNothing(q)) || i - j;
    const isText = typeof p === "string" && typeof q === "string";
    return sign * (isText ? p.localeCompare(q, undefined, { numeric: true }) : Number(p) - Number(q)) || i - j;
  });
}

/** The points as CSV with a header, which Python takes back (deformnb.io.landmarks.formats). */
export function pointsAsCsv(points: TableRow[], dim: number) {
  const columns = pointColumns(dim).filter(({ key }) => !["drag", "error", "go"].includes(key));
  const quoted = (text: string) => (/[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const line = (p: TableRow) => columns.map((c) => quoted(editText(cellValue(p, c, dim))));
  return [columns.map(({ key }) => key), ...points.map(line)].map((row) => `${row.join(",")}\n`).join("");
}

/** The points of a table as Python sent them, their order, and where a drag has moved them. */
export class PointList {
  dim = 0;
  points: TableRow[] = [];
  /** The column by which they are sorted; null: as they were made */
  sort: { key: string | null; isDown: boolean } = { key: null, isDown: false };
  /** Indices of the points, as sorted */
  order: number[] = [];
  /** Places in the order, by id */
  #ranks: Map<number, number> = new Map();
  /** Numbers of points that are being dragged, by id */
  #dragged: Map<number, Float64Array> = new Map();

  /** Take the points of a model; false while its traits do not fit together yet. */
  read(model: Model) {
    const points = readPoints(model);
    if (!points) return false;
    this.points = points;
    this.dim = model.get("dim");
    this.#dragged.clear();
    return true;
  }

  /** Sort by a column: upwards, then downwards, then as the points were made. */
  sortBy(key: string) {
    if (this.sort.key !== key) this.sort = { key, isDown: false };
    else if (!this.sort.isDown) this.sort.isDown = true;
    else this.sort = { key: null, isDown: false };
  }

  arrange(columns: Column[]) {
    const { key, isDown } = this.sort;
    this.order = sortPoints(
      this.points,
      columns.find((column) => column.key === key),
      isDown,
      this.dim,
    );
    this.#ranks = new Map(this.order.map((k, rank) => [this.points[k]!.id, rank]));
  }

  /** Move points with a drag, until Python sends them. */
  drag(points: Point[]) {
    this.#dragged = new Map();
    for (const { id, source, target } of points) {
      const p = this.at(this.rankOf(id));
      if (!p || source.length !== this.dim) continue;
      this.#dragged.set(id, Float64Array.of(...source, ...target, ...p.numbers.slice(2 * this.dim)));
    }
  }

  /** A point as a drag has moved it. */
  moved(p: TableRow) {
    const numbers = this.#dragged.get(p.id);
    return numbers ? { ...p, numbers } : p;
  }

  get last() {
    return this.order.length - 1;
  }

  /** The number of a point among all, from 1, by which people know it. */
  numberOf(id: number) {
    return numberOf(this.points, id);
  }

  /** The place of a point in the order, or -1. */
  rankOf(id: number | null) {
    return id === null ? -1 : (this.#ranks.get(id) ?? -1);
  }

  /** The point at a place in the order. */
  at(rank: number): TableRow | undefined {
    const k = this.order[rank];
    return k === undefined ? undefined : this.points[k];
  }
}

/** The selected points, which the editor shares. */
export class Selection {
  ids: Set<number>;
  /** Where a range of selected rows begins */
  #anchor: number | null = null;

  /** @param changed called after a change by the user */
  constructor(
    readonly model: Model,
    readonly list: PointList,
    readonly changed: () => void,
  ) {
    this.ids = new Set(model.get("selected"));
  }

  /** The selected points, else this one. */
  or(id: number | null) {
    return this.ids.size ? [...this.ids] : id === null ? [] : [id];
  }

  select(ids: number[]) {
    this.ids = new Set(ids);
    setTrait(this.model, "selected", [...this.ids]);
    this.changed();
  }

  /** Take a selection from Python, as after a click in the picture; false if it is the same. */
  take(ids: number[]) {
    if (ids.length === this.ids.size && ids.every((id) => this.ids.has(id))) return false;
    this.ids = new Set(ids);
    return true;
  }

  choose(rank: number, isToggled: boolean, isRange: boolean) {
    const { ids, list } = this,
      id = list.at(rank)?.id,
      from = list.rankOf(this.#anchor);
    if (id === undefined) return;
    if (isRange && from >= 0) {
      const [low, high] = [Math.min(from, rank), Math.max(from, rank)];
      this.select(list.order.slice(low, high + 1).map((k) => list.points[k]!.id));
      return;
    }
    this.#anchor = id;
    if (!isToggled) this.select([id]);
    else this.select(ids.has(id) ? [...ids].filter((other) => other !== id) : [...ids, id]);
  }
}
