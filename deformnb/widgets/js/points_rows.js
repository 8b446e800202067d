// The rows of the table of control points: what Python sends of them, columns, order, text. Pure functions; no DOM.

const AXES = { 2: ["a", "b"], 3: ["x", "y", "z"] };
const FLAGS = { active: 1, locked: 2, suspect: 4 };

// kind: "fact" and "go" cannot be edited. `at` is the place in a row of numbers.
function pointColumns(dim) {
  const axes = AXES[dim] ?? AXES[2], unit = "in the volume's unit";
  return [
    { key: "id", title: "Id", kind: "fact", width: "52px", tip: "Number of the point; never given twice" },
    { key: "name", title: "Name", kind: "text", width: "minmax(90px, 1fr)", tip: "Name of the point" },
    { key: "active", title: "On", kind: "check", width: "42px", tip: "A point that is off keeps its place and has no say" },
    { key: "locked", title: "Lock", kind: "check", width: "48px", tip: "A locked point stays where it is until it is unlocked" },
    ...axes.map((axis, k) => ({ key: `source_${axis}`, field: "source", axis: k, title: `from ${axis}`, kind: "number", at: k,
      width: "minmax(64px, 92px)", tip: `Source, ${axis}: where the feature is, ${unit}` })),
    ...axes.map((axis, k) => ({ key: `target_${axis}`, field: "target", axis: k, title: `to ${axis}`, kind: "number",
      at: dim + k, width: "minmax(64px, 92px)", tip: `Target, ${axis}: where it shall go, ${unit}` })),
    { key: "drag", title: "Drag", kind: "fact", width: "minmax(56px, 80px)", tip: `How far it is dragged, ${unit}` },
    { key: "weight", title: "Weight", kind: "number", at: 2 * dim, width: "64px",
      tip: "How much the point counts beside others. It matters only with smoothing" },
    { key: "radius", title: "Radius", kind: "number", at: 2 * dim + 1, width: "64px",
      tip: `How far this point reaches, ${unit}; empty: as far as all (Support, under Interpolation)` },
    { key: "error", title: "Off by", kind: "fact", at: 2 * dim + 2, width: "minmax(64px, 80px)",
      tip: `How far all other points would miss this one (leave-one-out error), ${unit}. ! marks a point that disagrees with its neighbours` },
    { key: "go", title: "", kind: "go", width: "34px", tip: "Show the point in the picture" },
  ];
}

function bytesOf(view) {
  return view ? view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength) : new ArrayBuffer(0);
}

// All points of a model, or null while its traits do not fit together yet.
function readPoints(model) {
  const ids = model.get("ids") ?? [], names = model.get("names") ?? [], dim = model.get("dim"), width = 2 * dim + 3;
  const numbers = bytesOf(model.get("numbers")), flags = new Uint8Array(bytesOf(model.get("flags")));
  if (names.length !== ids.length || flags.length !== ids.length || numbers.byteLength !== 8 * width * ids.length) return null;
  const all = new Float64Array(numbers);
  return ids.map((id, k) => ({ id, name: names[k], active: Boolean(flags[k] & FLAGS.active),
    locked: Boolean(flags[k] & FLAGS.locked), suspect: Boolean(flags[k] & FLAGS.suspect),
    numbers: all.subarray(k * width, (k + 1) * width) }));
}

function dragOf(p, dim) {
  let sum = 0;
  for (let k = 0; k < dim; k += 1) sum += (p.numbers[dim + k] - p.numbers[k]) ** 2;
  return Math.sqrt(sum);
}

// What a cell is about, for its order and its text.
function cellValue(p, column, dim) {
  if (column.key === "drag") return dragOf(p, dim);
  return column.at === undefined ? p[column.key] : p.numbers[column.at];
}

// In full, as one edits it; no number is the empty text.
function editedText(value) {
  return typeof value === "number" ? (Number.isNaN(value) ? "" : String(value)) : value;
}

function shownNumber(value) {
  if (Number.isNaN(value)) return "";
  const size = Math.abs(value);
  if (size === 0) return "0";
  return size < 0.005 || size >= 1e7 ? value.toExponential(1) : value.toFixed(2);
}

// Positions in the order of a column; what has no value comes last, either way round.
function orderedPoints(points, column, isDown, dim) {
  const places = points.map((_, k) => k);
  if (!column) return places;
  const values = points.map((p) => cellValue(p, column, dim)), sign = isDown ? -1 : 1;
  const isNothing = (v) => v === "" || Number.isNaN(v);
  return places.sort((i, j) => {
    const p = values[i], q = values[j];
    if (isNothing(p) || isNothing(q)) return isNothing(p) - isNothing(q) || i - j;
    return sign * (typeof p === "string" ? p.localeCompare(q, undefined, { numeric: true }) : p - q) || i - j;
  });
}

// The points as CSV with a line of names, which Python takes back (deformnb.io.landmarks).
function pointsAsCsv(points, dim) {
  const columns = pointColumns(dim).filter(({ key }) => !["drag", "error", "go"].includes(key));
  const quoted = (text) => (/[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const line = (p) => columns.map((c) => quoted(String(editedText(cellValue(p, c, dim)))));
  return [columns.map(({ key }) => key), ...points.map(line)].map((row) => `${row.join(",")}\n`).join("");
}
