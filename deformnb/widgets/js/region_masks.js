// Masks as regions, equal to deformnb.rbf.regions.Mask in the plane: {kind: "mask", shape: [nv, nu], spacing, origin, bits},
// bits being base64 of zlib of the pixels, eight to a byte, the first in the highest bit. Needs regions.js. No DOM.

function maskRegion(data) {
  const { shape: [nv, nu], spacing: [du, dv], origin: [a0, b0] } = data, isSet = maskPixels(data);
  const outside = boxDistances(isSet, nv, nu, du, dv), inside = boxDistances(isSet.map((v) => 1 - v), nv, nu, du, dv);
  const signed = outside.map((value, k) => (isSet[k] ? -inside[k] : value));
  const distance = (a, b) => {
    const u = (a - a0) / du, v = (b - b0) / dv;
    const p = Math.max(0, Math.min(nu - 1, u)), q = Math.max(0, Math.min(nv - 1, v));
    const i = Math.min(Math.floor(q), Math.max(0, nv - 2)), j = Math.min(Math.floor(p), Math.max(0, nu - 2));
    const s = p - j, t = q - i, at = i * nu + j, east = nu > 1 ? 1 : 0, south = nv > 1 ? nu : 0;
    const top = signed[at] + s * (signed[at + east] - signed[at]), low = at + south;
    const value = top + t * (signed[low] + s * (signed[low + east] - signed[low]) - top);
    return u === p && v === q ? value : value + Math.hypot((u - p) * du, (v - q) * dv);
  };
  return { kind: "mask", distance, near: () => distance, isSet };
}

function maskPixels({ shape: [nv, nu], bits }) {
  const bytes = inflated(Uint8Array.from(atob(bits), (c) => c.charCodeAt(0))), out = new Uint8Array(nv * nu);
  for (let k = 0; k < out.length; k++) out[k] = (bytes[k >> 3] >> (7 - (k & 7))) & 1;
  return out;
}

// Distance of every centre to the nearest pixel that is set, measured to its faces; 1e15 if there is none, for infinity
// would become NaN where it is interpolated.
function boxDistances(isSet, nv, nu, du, dv) {
  const found = new Float32Array(nv * nu);
  if (!isSet.includes(1)) return found.fill(1e15);
  const above = new Int32Array(nv * nu); // the row of the nearest set pixel in the same column, -1 for none
  for (let j = 0; j < nu; j++) {
    let last = -1;
    for (let i = 0; i < nv; i++) { if (isSet[i * nu + j]) last = i; above[i * nu + j] = last; }
    last = -1;
    for (let i = nv - 1; i >= 0; i--) {
      if (isSet[i * nu + j]) last = i;
      const up = above[i * nu + j];
      if (last >= 0 && (up < 0 || last - i < i - up)) above[i * nu + j] = last;
    }
  }
  const feet = new Int32Array(nu), from = new Float64Array(nu + 1);
  for (let i = 0; i < nv; i++) {
    const height = (j) => ((above[i * nu + j] - i) * dv) ** 2, row = i * nu;
    let top = -1; // the lower envelope of the columns' parabolas
    for (let j = 0; j < nu; j++) {
      if (above[row + j] < 0) continue;
      let meet = -Infinity;
      while (top >= 0) {
        const k = feet[top];
        meet = (height(j) - height(k) + du * du * (j * j - k * k)) / (2 * du * du * (j - k));
        if (meet > from[top]) break;
        top -= 1;
      }
      if (top < 0) meet = -Infinity;
      top += 1;
      feet[top] = j;
      from[top] = meet;
    }
    for (let j = 0, k = 0; j < nu; j++) {
      while (k < top && from[k + 1] < j) k += 1;
      const across = Math.max(0, Math.abs(feet[k] - j) - 0.5) * du;
      found[row + j] = Math.hypot(across, Math.max(0, Math.abs(above[row + feet[k]] - i) - 0.5) * dv);
    }
  }
  return found;
}

// ---- zlib: a browser inflates only in promises, and a picture is drawn now ------------------------------------------

const INFLATE_LENGTHS = [3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 15, 17, 19, 23, 27, 31, 35, 43, 51, 59, 67, 83, 99, 115, 131, 163,
  195, 227, 258];
const INFLATE_DISTANCES = [1, 2, 3, 4, 5, 7, 9, 13, 17, 25, 33, 49, 65, 97, 129, 193, 257, 385, 513, 769, 1025, 1537, 2049,
  3073, 4097, 6145, 8193, 12289, 16385, 24577];
const INFLATE_ORDER = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];

function inflated(bytes) {
  let at = 16, out = new Uint8Array(1 << 14), size = 0; // in bits; a header of two bytes comes first
  const take = (n) => {
    let value = 0;
    for (let k = 0; k < n; k++, at++) {
      if (at >> 3 >= bytes.length) throw new Error("a mask ends too early");
      value |= ((bytes[at >> 3] >> (at & 7)) & 1) << k;
    }
    return value;
  };
  const put = (value) => {
    if (size === out.length) { const more = new Uint8Array(2 * size); more.set(out); out = more; }
    out[size++] = value;
  };
  for (let isLast = 0; !isLast;) {
    isLast = take(1);
    const kind = take(2);
    if (kind === 0) {
      at = (at + 7) & ~7;
      const length = take(16);
      take(16);
      for (let k = 0; k < length; k++) put(take(8));
      continue;
    }
    if (kind === 3) throw new Error("a mask is not packed as zlib does");
    const [symbols, distances] = kind === 1 ? fixedCodes() : sentCodes(take);
    for (let symbol = symbols(take); symbol !== 256; symbol = symbols(take)) {
      if (symbol < 256) { put(symbol); continue; }
      const s = symbol - 257, length = INFLATE_LENGTHS[s] + (s < 8 || s === 28 ? 0 : take((s >> 2) - 1));
      const d = distances(take), back = INFLATE_DISTANCES[d] + (d < 4 ? 0 : take((d >> 1) - 1));
      for (let k = 0; k < length; k++) put(out[size - back]);
    }
  }
  return out.subarray(0, size);
}

// A reader of the code whose symbols have these numbers of bits.
function codeReader(lengths) {
  const counts = new Array(16).fill(0), table = new Map();
  for (const n of lengths) if (n) counts[n] += 1;
  const next = [0];
  for (let n = 1, code = 0; n < 16; n++) { code = (code + (counts[n - 1] ?? 0)) << 1; next[n] = code; }
  lengths.forEach((n, symbol) => { if (n) table.set((n << 16) | next[n]++, symbol); });
  return (take) => {
    for (let n = 1, code = 0; n < 16; n++) {
      code = (code << 1) | take(1);
      const symbol = table.get((n << 16) | code);
      if (symbol !== undefined) return symbol;
    }
    throw new Error("a mask is not packed as zlib does");
  };
}

function fixedCodes() {
  const lengths = Array.from({ length: 288 }, (_, k) => (k < 144 ? 8 : k < 256 ? 9 : k < 280 ? 7 : 8));
  return [codeReader(lengths), codeReader(new Array(30).fill(5))];
}

function sentCodes(take) {
  const literals = take(5) + 257, distances = take(5) + 1, count = take(4) + 4, first = new Array(19).fill(0);
  for (let k = 0; k < count; k++) first[INFLATE_ORDER[k]] = take(3);
  const read = codeReader(first), lengths = [];
  while (lengths.length < literals + distances) {
    const symbol = read(take);
    if (symbol < 16) lengths.push(symbol);
    else {
      const [bits, least] = [[2, 3], [3, 3], [7, 11]][symbol - 16], value = symbol === 16 ? lengths[lengths.length - 1] : 0;
      for (let n = take(bits) + least; n > 0; n--) lengths.push(value);
    }
  }
  return [codeReader(lengths.slice(0, literals)), codeReader(lengths.slice(literals))];
}
