// Paints a warped picture and its net on a 2D canvas. The view says which part of the picture plane is seen:
// {k, x, y}: a place (a, b) lies at (k a + x, k b + y) CSS pixels; {width, height} of the canvas; ratio of its pixels.

const LATTICE_PIXELS = 8; // nodes of the map while something moves: 0.06 px of error for a drag of 60 px over 400
const EVALUATIONS = 6e6; // kernel evaluations of the full picture at most: 40 ms, after the hand has come to rest
const FINEST_LAYERS = 4; // pixels between the nodes of maps with cuts, whose pixels are decided by distances
const BUDGET_MS = 9; // for the picture of one frame; the rest of 16 ms belongs to fit, net, handles and the browser

class PictureSource {
  // pixels: Uint8 (height * width * channels), channels 1 (grey) or 4 (RGBA); raster {shape, spacing, origin}
  constructor(pixels, channels, raster) {
    const [height, width] = raster.shape;
    this.raster = raster;
    this.channels = channels;
    this.levels = [{ pixels, width, height }];
    // Beyond the picture lies its smallest value, as for a volume.
    this.fill = channels === 1 ? pixels.reduce((least, value) => Math.min(least, value), 255) : 0;
  }

  get box() {
    const { shape: [nv, nu], spacing: [du, dv], origin: [a, b] } = this.raster;
    return [a - du / 2, a + (nu - 0.5) * du, b - dv / 2, b + (nv - 0.5) * dv];
  }

  // The picture averaged to half its size, `level` times: a picture seen from far must not shimmer.
  level(level) {
    while (this.levels.length <= level) this.levels.push(halved(this.levels[this.levels.length - 1], this.channels));
    return this.levels[level];
  }
}

// The bytes of a PNG as a source for the painter: one channel where the picture is grey.
async function decodePicture(bytes, raster) {
  const view = new Uint8Array(bytes.buffer ?? bytes, bytes.byteOffset ?? 0, bytes.byteLength);
  const bitmap = await createImageBitmap(new Blob([view], { type: "image/png" }),
    { colorSpaceConversion: "none", premultiplyAlpha: "none" });
  const [height, width] = raster.shape;
  if (bitmap.width !== width || bitmap.height !== height) throw new Error("its size is not that of its raster");
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  const rgba = context.getImageData(0, 0, width, height).data;
  if (raster.channels !== 1) return new PictureSource(rgba, 4, raster);
  return new PictureSource(Uint8Array.from({ length: width * height }, (_, k) => rgba[4 * k]), 1, raster);
}

function halved({ pixels, width, height }, channels) {
  const w = Math.max(1, width >> 1), h = Math.max(1, height >> 1), out = new Uint8Array(w * h * channels);
  for (let y = 0; y < h; y++) {
    const up = Math.min(2 * y, height - 1) * width, down = Math.min(2 * y + 1, height - 1) * width;
    for (let x = 0; x < w; x++) {
      const left = Math.min(2 * x, width - 1), right = Math.min(2 * x + 1, width - 1);
      for (let c = 0; c < channels; c++) {
        const at = (row, column) => pixels[(row + column) * channels + c];
        out[(y * w + x) * channels + c] = (at(up, left) + at(up, right) + at(down, left) + at(down, right) + 2) >> 2;
      }
    }
  }
  return { pixels: out, width: w, height: h };
}

class Painter {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.scratch = document.createElement("canvas");
    this.scratchContext = this.scratch.getContext("2d", { alpha: false });
    this.source = null;
    this.image = null;
    this.cost = 15e-6; // milliseconds per pixel, measured from then on
  }

  resize(width, height, ratio) {
    const w = Math.max(1, Math.round(width * ratio)), h = Math.max(1, Math.round(height * ratio));
    if (this.canvas.width !== w || this.canvas.height !== h) {
      this.canvas.width = w;
      this.canvas.height = h;
    }
  }

  // A layered fit (cut_fits.js), or null for the picture as it is, drawn as far as `sheet` reaches. Returns what it took: {ms, step, lattice}.
  paint(view, fit, { isMoving, paper, sheet }) {
    const start = performance.now(), { context: c, canvas, source } = this;
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.fillStyle = paper;
    c.fillRect(0, 0, canvas.width, canvas.height);
    this.paper = [1, 3, 5].map((k) => parseInt(String(c.fillStyle).slice(k, k + 2), 16) || 0); // #rrggbb, whatever was set
    if (!source) return { ms: performance.now() - start, step: 0, lattice: 0 };
    const part = this.visible(view, sheet);
    if (part.width <= 0 || part.height <= 0) return { ms: 0, step: 0, lattice: 0 };
    const pixels = part.width * part.height;
    const step = isMoving && pixels * this.cost > BUDGET_MS ? (pixels * this.cost > 4 * BUDGET_MS ? 3 : 2) : 1;
    const w = Math.ceil(part.width / step), h = Math.ceil(part.height / step);
    const lattice = this.latticeStep(fit, w, h, isMoving);
    this.warp(view, fit, part, step, w, h, lattice, isMoving);
    if (step === 1) c.putImageData(this.image, part.x, part.y);
    else {
      if (this.scratch.width !== w || this.scratch.height !== h) Object.assign(this.scratch, { width: w, height: h });
      this.scratchContext.putImageData(this.image, 0, 0);
      c.imageSmoothingEnabled = true;
      c.save();
      c.beginPath();
      c.rect(part.x, part.y, part.width, part.height);
      c.clip();
      c.drawImage(this.scratch, part.x, part.y, w * step, h * step);
      c.restore();
    }
    const ms = performance.now() - start;
    if (isMoving) this.cost += 0.2 * (ms / (w * h) - this.cost);
    return { ms, step, lattice };
  }

  // The part of the canvas, in its own pixels, that a box on the picture's plane covers.
  visible({ k, x, y, ratio }, [a0, a1, b0, b1] = this.source.box) {
    const { width, height } = this.canvas;
    const clamp = (value, most) => Math.max(0, Math.min(most, Math.round(value * ratio)));
    const left = clamp(k * a0 + x, width), right = clamp(k * a1 + x, width);
    const top = clamp(k * b0 + y, height), bottom = clamp(k * b1 + y, height);
    return { x: left, y: top, width: right - left, height: bottom - top };
  }

  latticeStep(fit, w, h, isMoving) {
    if (!fit || fit.fits.every((one) => isStill(one.fit))) return 32; // a linear map needs no more nodes than that
    if (isMoving) return LATTICE_PIXELS * Math.max(1, Math.ceil(Math.sqrt(w * h / 64 * fit.count / 4e5)));
    return Math.max(fit.regions.length ? FINEST_LAYERS : 1, Math.ceil(Math.sqrt(w * h * fit.count / EVALUATIONS)));
  }

  // Looks every pixel up in the source: map at the nodes of a lattice, bilinear between them, bilinear in the picture.
  warp({ k, x, y, ratio }, fit, part, step, w, h, lattice, isMoving) {
    if (!this.image || this.image.width !== w || this.image.height !== h) this.image = new ImageData(w, h);
    const { raster } = this.source, size = step / (k * ratio); // of one looked-up pixel, in units of the picture
    const a0 = ((part.x + step / 2) / ratio - x) / k, b0 = ((part.y + step / 2) / ratio - y) / k;
    const columns = Math.ceil((w - 1) / lattice) + 1 + (w === 1 ? 1 : 0);
    const rows = Math.ceil((h - 1) / lattice) + 1 + (h === 1 ? 1 : 0);
    const nodes = { shape: [rows, columns], spacing: [lattice * size, lattice * size], origin: [a0, b0] };
    const shrink = Math.min(size / raster.spacing[0], size / raster.spacing[1]);
    const level = Math.max(0, Math.min(8, Math.floor(Math.log2(shrink) + 0.5)));
    const part2 = 2 ** level, scale = raster.spacing.map((value) => 1 / (value * part2)), shift = 0.5 / part2 - 0.5;
    const isLayered = Boolean(fit) && fit.regions.length > 0, count = isLayered ? fit.fits.length + 1 : 1;
    this.maps ??= [];
    for (let m = 0; m < count; m++) {
      if (!this.maps[m] || this.maps[m].length < rows * columns * 2) this.maps[m] = new Float32Array(rows * columns * 2);
      const map = this.maps[m], one = fit?.fits[m]?.fit;
      if (one && !isStill(one)) fieldOnRaster(one, nodes, map);
      else map.fill(0, 0, rows * columns * 2);
      // From displacements to places in the pixels of that level: ((a + D - origin) / spacing + 1/2) / 2^level - 1/2.
      for (let i = 0, n = 0; i < rows; i++) {
        const b = b0 + i * lattice * size - raster.origin[1];
        for (let j = 0; j < columns; j++, n += 2) {
          map[n] = (a0 + j * lattice * size - raster.origin[0] + map[n]) * scale[0] + shift;
          map[n + 1] = (b + map[n + 1]) * scale[1] + shift;
        }
      }
    }
    const pixels = this.source.level(level), { channels, fill } = this.source, rim = 0.5 / part2;
    const out = new Uint32Array(this.image.data.buffer);
    const layers = isLayered ? new LayerPlan(fit, this.maps, { rows, columns, a0, b0, step: lattice * size },
      { origin: raster.origin, scale, shift }, Math.max(size, (raster.spacing[0] + raster.spacing[1]) / 2), isMoving) : null;
    const lookUp = channels === 1 ? lookUpGrey : lookUpColour;
    lookUp(out, w, h, this.maps, layers?.plan ?? null, columns, lattice, pixels, fill, rim);
    if (layers) lookUpLayers(out, w, h, layers, lattice, pixels, channels, fill, rim, this.paper);
  }

  // The edge of what is drawn, where its own edge is as dark as what is around.
  drawFrame({ k, x, y, ratio }, [a0, a1, b0, b1]) {
    const { context: c } = this;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.strokeStyle = "rgba(255, 255, 255, 0.28)";
    c.lineWidth = 1;
    c.strokeRect(k * a0 + x, k * b0 + y, k * (a1 - a0), k * (b1 - b0));
    c.setTransform(1, 0, 0, 1, 0, 0);
  }

  // Polylines in picture coordinates: first a dark casing, then the line, legible on black, white and colour.
  drawNet(view, net, colour) {
    const { context: c } = this, { k, x, y, ratio } = view;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.lineJoin = "round";
    for (const [style, wider] of [["rgba(0, 0, 0, 0.45)", 1.4], [colour, 0]]) {
      c.strokeStyle = style;
      for (const isEdge of [false, true]) {
        c.lineWidth = (isEdge ? 1.6 : 0.9) + wider;
        c.beginPath();
        for (const line of net) {
          if (line.isEdge !== isEdge) continue;
          for (const run of line.runs) {
            c.moveTo(k * run[0] + x, k * run[1] + y);
            for (let j = 2; j < run.length; j += 2) c.lineTo(k * run[j] + x, k * run[j + 1] + y);
          }
        }
        c.stroke();
      }
    }
    c.setTransform(1, 0, 0, 1, 0, 0);
  }
}

const OPAQUE = 0xff000000;

// Both loops walk the cells of the lattice row by row; places run linearly inside a cell's row. `rim` is half a pixel
// of the full picture: so far beyond the outermost centres a place still takes the edge pixel, beyond it the fill.
// `plan` says which of the maps each cell shows, and leaves out those below 0 (paint_layers.js); null shows the first.
function lookUpGrey(out, w, h, maps, plan, columns, lattice, { pixels, width, height }, fill, rim) {
  const empty = OPAQUE | (fill * 0x010101), right = width - 1, bottom = height - 1;
  for (let y = 0; y < h; y++) {
    const i = Math.min(Math.floor(y / lattice), Math.max(0, Math.floor((h - 2) / lattice))), f = y / lattice - i;
    const up = 2 * i * columns, down = up + 2 * columns, line = y * w;
    for (let j = 0, x = 0; x < w; j++) {
      const n = up + 2 * j, m = down + 2 * j, last = Math.min(w, x + lattice), full = lattice;
      const layer = plan ? plan[i * columns + j] : 0;
      if (layer < 0) { x = last; continue; }
      const map = maps[layer];
      let u = map[n] + f * (map[m] - map[n]), v = map[n + 1] + f * (map[m + 1] - map[n + 1]);
      const du = (map[n + 2] + f * (map[m + 2] - map[n + 2]) - u) / full;
      const dv = (map[n + 3] + f * (map[m + 3] - map[n + 3]) - v) / full;
      for (; x < last; x++, u += du, v += dv) {
        let p = u, q = v;
        if (!(p >= 0 && q >= 0 && p < right && q < bottom)) {
          if (!(p >= -rim && q >= -rim && p < right + rim && q < bottom + rim)) { out[line + x] = empty; continue; }
          p = p < 0 ? 0 : p > right ? right : p;
          q = q < 0 ? 0 : q > bottom ? bottom : q;
        }
        const pi = p | 0, qi = q | 0, s = p - pi, t = q - qi, at = qi * width + pi;
        const east = pi < right ? 1 : 0, south = qi < bottom ? width : 0;
        const top = pixels[at] + s * (pixels[at + east] - pixels[at]), low = at + south;
        const g = (top + t * (pixels[low] + s * (pixels[low + east] - pixels[low]) - top) + 0.5) | 0;
        out[line + x] = OPAQUE | (g << 16) | (g << 8) | g;
      }
    }
  }
}

function lookUpColour(out, w, h, maps, plan, columns, lattice, { pixels, width, height }, fill, rim) {
  const empty = OPAQUE | (fill * 0x010101), right = width - 1, bottom = height - 1;
  for (let y = 0; y < h; y++) {
    const i = Math.min(Math.floor(y / lattice), Math.max(0, Math.floor((h - 2) / lattice))), f = y / lattice - i;
    const up = 2 * i * columns, down = up + 2 * columns, line = y * w;
    for (let j = 0, x = 0; x < w; j++) {
      const n = up + 2 * j, m = down + 2 * j, last = Math.min(w, x + lattice);
      const layer = plan ? plan[i * columns + j] : 0;
      if (layer < 0) { x = last; continue; }
      const map = maps[layer];
      let u = map[n] + f * (map[m] - map[n]), v = map[n + 1] + f * (map[m + 1] - map[n + 1]);
      const du = (map[n + 2] + f * (map[m + 2] - map[n + 2]) - u) / lattice;
      const dv = (map[n + 3] + f * (map[m + 3] - map[n + 3]) - v) / lattice;
      for (; x < last; x++, u += du, v += dv) {
        if (!(u >= -rim && v >= -rim && u < right + rim && v < bottom + rim)) { out[line + x] = empty; continue; }
        const p = u < 0 ? 0 : u > right ? right : u, q = v < 0 ? 0 : v > bottom ? bottom : v;
        const pi = p | 0, qi = q | 0, s = p - pi, t = q - qi;
        const at = 4 * (qi * width + pi), east = pi < right ? 4 : 0, low = at + (qi < bottom ? 4 * width : 0);
        let colour = OPAQUE;
        for (let c = 0; c < 3; c++) {
          const top = pixels[at + c] + s * (pixels[at + east + c] - pixels[at + c]);
          const bed = pixels[low + c] + s * (pixels[low + east + c] - pixels[low + c]);
          colour |= ((top + t * (bed - top) + 0.5) | 0) << (8 * c);
        }
        out[line + x] = colour;
      }
    }
  }
}
