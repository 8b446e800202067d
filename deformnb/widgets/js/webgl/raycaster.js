// Programs of a graphics card: compiled, and chosen by what is shown. Needs webgl/ray_shader.js.

import { dot } from "../maths/camera.js";
import { clipSides, leftOf } from "../maths/clipping.js";
import { planarFolds, spaceFolds } from "./fold_mesh.js";
import { FRAGMENT, PRESENT, VERTEX } from "./ray_shader.js";
import {
  AMBIENT_CELL, ambientLight, BLOCK, blockExtremes, emptyRings, extrusionSlope, gradientSlab, opacityOfByte,
  planarBounds, spaceSlope, STEEPEST,
} from "./volume_blocks.js";

function compiled(gl, type, source) {
  const shader = gl.createShader(type);
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
    throw new Error(`shader: ${gl.getShaderInfoLog(shader)}`);
  }
  return shader;
}

export function linked(gl, fragment) {
  const program = gl.createProgram();
  gl.attachShader(program, compiled(gl, gl.VERTEX_SHADER, VERTEX));
  gl.attachShader(program, compiled(gl, gl.FRAGMENT_SHADER, fragment));
  gl.bindAttribLocation(program, 0, "corner");
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(`program: ${gl.getProgramInfoLog(program)}`);
  }
  const at = {}, count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) || 0;
  for (let i = 0; i < count; i++) {
    const { name } = gl.getActiveUniform(program, i);
    at[name] = gl.getUniformLocation(program, name);
  }
  return { program, at };
}

// From places in the volume's frame to texture coordinates over a plane: a matrix, column by column, and an offset.
function toTextures({ origin, u, v, n }, starts, lengths) {
  const scale = lengths.map((l) => (l > 0 ? 1 / l : 0));
  return [[0, 1, 2].flatMap((j) => [u, v, n].map((axis, i) => axis[j] * scale[i])),
    [u, v, n].map((axis, i) => (scale[i] ? (-dot(axis, origin) - starts[i]) * scale[i] : 0.5))];
}

/** What the shader is to be able to do, and no more: what nobody needs costs nothing. */
function definesOf(projection, planar, space, folds = false, clipped = false) {
  const cut = planar && planar.cut, early = space && space.cut, isPaper = (c) => c && c.rule === "paper";
  const wanted = {
    PLANAR: planar, WEIGHTED: planar && !planar.isReplicated, SPACE: space, WARPED: planar || space,
    MIP: projection === "mip", SHADED: projection === "shaded",
    CUT: cut || early, PLANE_CUT: cut, BY_PLACE: isPaper(cut), SPACE_CUT: early, SPACE_BY_PLACE: isPaper(early),
    FOLDS: folds && (planar || space), CLIPPED: clipped && projection === "shaded",
  };
  return Object.keys(wanted).filter((name) => wanted[name]);
}

// The ray caster: textures and programs on one WebGL2 context, pictures of any part at any resolution.
// It knows no widget and no mouse; all that comes in is arrays and numbers.

const UNITS = { volume: 0, blocks: 1, ambience: 2, table: 3, maps: 4, weights: 5, space: 6, picture: 7, distances: 8, depths: 9 };

const FACE_VOXELS = 3; // a cut face is lit this deep, half on each side of it

export const BACKGROUNDS = {
  dark: { centre: [0.118, 0.126, 0.147], corner: [0.052, 0.056, 0.067], ink: [0.97, 0.96, 0.93] },
  light: { centre: [0.957, 0.96, 0.965], corner: [0.85, 0.857, 0.87], ink: [0.09, 0.1, 0.13] },
};

export class MemoryError extends Error {}
export const NOT_HELD = "The graphics memory does not hold this volume.";

export class RayCaster {
  /** canvas without a context; throws an Error with a readable reason if there is no WebGL2. */
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, depth: false, stencil: false,
      powerPreference: "high-performance" });
    if (!gl) throw new Error("this browser offers no WebGL2 here");
    this.gl = gl;
    this.canvas = canvas;
    this.floats = Boolean(gl.getExtension("EXT_color_buffer_float") || gl.getExtension("EXT_color_buffer_half_float"));
    this.smoothFloats = Boolean(gl.getExtension("OES_texture_float_linear"));
    const info = gl.getExtension("WEBGL_debug_renderer_info");
    this.name = String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER) || "");
    this.isSoftware = /swiftshader|llvmpipe|software|basic render/i.test(this.name);
    this.largest = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE);
    this.programs = {};
    this.textures = {};
    this.targets = {};
    this.volume = null;
    this.table = null;
    this.planar = null;
    this.space = null;
    this.projection = "shaded";
    this.background = "dark";
    this.showFolds = true;
    this.clip = null; // the shares of the volume's box that are seen, see maths/clipping.js; null: all
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.disable(gl.DITHER);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 3, -1, -1, 3]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    this.#plain();
  }

  /** Whether what is shown folds somewhere, and shows it. */
  get folds() { return this.showFolds && Boolean(this.planar?.folds || this.space?.folds); }

  get isReady() { return Boolean(this.volume && this.table && this.volume.loaded); }

  // A program reads every sampler it declares, so each unit holds something of its kind from the start.
  #plain() {
    const gl = this.gl;
    for (const name of ["volume", "blocks", "ambience", "space", "depths"]) {
      this.#texture(name, gl.TEXTURE_3D, true);
      gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGBA8, 1, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    }
    for (const name of ["maps", "distances"]) {
      this.#texture(name, gl.TEXTURE_2D_ARRAY, true);
      gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RGBA8, 1, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    }
    for (const name of ["table", "weights", "picture"]) {
      this.#texture(name, gl.TEXTURE_2D, true);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    }
  }

  #texture(name, target, linear) {
    const gl = this.gl;
    gl.deleteTexture(this.textures[name] || null);
    const texture = gl.createTexture();
    this.textures[name] = texture;
    gl.activeTexture(gl.TEXTURE0 + UNITS[name]);
    gl.bindTexture(target, texture);
    for (const side of ["WRAP_S", "WRAP_T", "WRAP_R"]) gl.texParameteri(target, gl[`TEXTURE_${side}`], gl.CLAMP_TO_EDGE);
    for (const kind of ["MIN", "MAG"]) {
      gl.texParameteri(target, gl[`TEXTURE_${kind}_FILTER`], linear ? gl.LINEAR : gl.NEAREST);
    }
  }

  /**
   * The volume: bytes [z][y][x]. info: shape [nx, ny, nz], spacing, outside (0..255), isLabels. `tick` is awaited
   * between slabs so that the page stays alive; returns false if another volume came in meanwhile.
   */
  async setVolume(values, info, tick) {
    const gl = this.gl, [nx, ny, nz] = info.shape;
    const volume = { ...info, values, loaded: false };
    this.volume = volume;
    this.#texture("volume", gl.TEXTURE_3D, !info.isLabels);
    gl.texStorage3D(gl.TEXTURE_3D, 1, gl.RGBA8, nx, ny, nz);
    this.#held();
    const slab = Math.max(1, Math.round(2 ** 20 / (nx * ny))); // about 10 ms of work
    for (let z = 0; z < nz; z += slab) {
      const last = Math.min(nz, z + slab);
      const voxels = gradientSlab(values, info.shape, z, last, info.spacing, info.outside);
      gl.activeTexture(gl.TEXTURE0 + UNITS.volume);
      gl.texSubImage3D(gl.TEXTURE_3D, 0, 0, 0, z, nx, ny, last - z, gl.RGBA, gl.UNSIGNED_BYTE, voxels);
      if (tick) await tick(last / nz);
      if (this.volume !== volume) return false;
    }
    this.#held(); // some cards take the memory only when they are given what it holds
    volume.extremes = blockExtremes(values, info.shape);
    volume.loaded = true;
    if (this.table) this.setTable(this.table.rgba, this.table.unit);
    return true;
  }

  /** Throws a MemoryError, and gives back what was taken, where the card has not enough for the volume. */
  #held() {
    const { gl } = this;
    if (gl.getError() !== gl.OUT_OF_MEMORY) return;
    this.volume = null;
    this.#texture("volume", gl.TEXTURE_3D, true);
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGBA8, 1, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    throw new MemoryError(NOT_HELD);
  }

  /** Colours and opacities: (255 k + 1) x 4 floats, every k-th for a byte; opacities for layers of thickness `unit`. */
  setTable(rgba, unit) {
    this.table = { rgba, unit, step: 0 };
    if (!this.volume || !this.volume.loaded) return;
    const gl = this.gl, { extremes, values, shape, spacing } = this.volume;
    const alphas = Float32Array.from({ length: rgba.length / 4 }, (_, i) => rgba[4 * i + 3]);
    this.#texture("blocks", gl.TEXTURE_3D, false);
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.RG8, ...extremes.size, 0, gl.RG, gl.UNSIGNED_BYTE, emptyRings(extremes, alphas));
    const light = ambientLight(values, shape, alphas, (AMBIENT_CELL * Math.min(...spacing)) / unit);
    this.#texture("ambience", gl.TEXTURE_3D, true);
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.R8, ...light.size, 0, gl.RED, gl.UNSIGNED_BYTE, light.values);
  }

  // Opacities hold for one thickness: made anew for the step of this picture rather than with a power at every sample.
  #fitTable(step) {
    const { rgba, unit } = this.table, gl = this.gl;
    if (this.table.step === step) return;
    this.table.step = step;
    const fitted = Float32Array.from(rgba);
    for (let i = 3; i < fitted.length; i += 4) fitted[i] = 1 - Math.pow(1 - Math.min(fitted[i], 0.9999), step / unit);
    this.#texture("table", gl.TEXTURE_2D, true);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, fitted.length / 4, 1, 0, gl.RGBA, gl.FLOAT, fitted);
  }

  /**
   * Displacement maps over a plane, or null. maps: Float32Array [k][row][column][2]; shape [k, rows, columns], where k
   * counts the maps of one region after those of another if there is a cut;
   * origin and spacing of the map's nodes in picture coordinates; depth [c0, c1]; weights Float32Array [k][knots]
   * for the maps of one region; plane {origin, u, v, n} already in the volume's frame; isReplicated: no weight changes
   * with depth. cut: null, or {shape [cuts, rows, columns], origin, spacing, distances Float32Array, sides: for each
   * region whether it lies inside of each cut, rule}; softness: width of the ramp of opacity at a cut.
   */
  setPlanar(planar) {
    this.planar = planar;
    if (!planar) return;
    const gl = this.gl, [layers, rows, columns] = planar.shape, regions = planar.cut ? planar.cut.sides.length : 1;
    const count = layers / regions, knots = planar.weights.length / count;
    const kind = this.smoothFloats ? [gl.RG32F, gl.R32F] : [gl.RG16F, gl.R16F];
    this.#texture("maps", gl.TEXTURE_2D_ARRAY, true);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, kind[0], columns, rows, layers, 0, gl.RG, gl.FLOAT, planar.maps);
    this.#texture("weights", gl.TEXTURE_2D, true);
    gl.texImage2D(gl.TEXTURE_2D, 0, kind[1], knots, count, 0, gl.RED, gl.FLOAT, planar.weights);
    const [c0, c1] = planar.depth;
    const lengths = [planar.spacing[0] * columns, planar.spacing[1] * rows, (c1 - c0) * knots / Math.max(1, knots - 1)];
    const starts = [planar.origin[0] - planar.spacing[0] / 2, planar.origin[1] - planar.spacing[1] / 2,
      c0 - (c1 - c0) / Math.max(1, knots - 1) / 2];
    [planar.toMap, planar.toMap0] = toTextures(planar.plane, starts, lengths);
    const bounds = planarBounds(planar.maps, planar.shape, planar.spacing), each = Array.from({ length: regions }, (_, r) => r);
    planar.count = count;
    planar.folds = planarFolds(planar, count, bounds.steep);
    planar.slope = Math.max(...each.map((r) => extrusionSlope({ steep: bounds.steep.subarray(r * count, (r + 1) * count),
      far: bounds.far.subarray(r * count, (r + 1) * count) }, planar.weights, count, knots, c1 - c0)));
    if (planar.cut) this.#setCut(planar.cut, planar.plane);
  }

  #setCut(cut, plane) {
    const gl = this.gl, [count, rows, columns] = cut.shape, [da, db] = cut.spacing;
    const lengths = [columns * da, rows * db, 0];
    [cut.toCut, cut.toCut0] = toTextures(plane, [cut.origin[0] - da / 2, cut.origin[1] - db / 2, 0], lengths);
    cut.scale = [1 / lengths[0], 1 / lengths[1]];
    cut.bits = cut.sides.map((sides) => sides.reduce((sum, inside, c) => sum + (inside ? 2 ** c : 0), 0));
    if (this.distances === cut.distances) return; // they change when a cut is drawn, not when points move
    this.distances = cut.distances;
    this.#texture("distances", gl.TEXTURE_2D_ARRAY, true);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, this.smoothFloats ? gl.R32F : gl.R16F, columns, rows, count, 0, gl.RED, gl.FLOAT,
      cut.distances);
  }

  /**
   * A displacement sampled in space, or null. values: Float32Array [z][y][x][3] in the volume's frame. With cut {regions,
   * rule, softness, slope}: numbers of half precision as Uint16Array, values [region][z][y][x][4] with the depth of where
   * it leads to, and depths [region][z][y][x][2] with the depth of the sample and the share of it that is seen.
   */
  setSpace(space) {
    this.space = space;
    if (!space) return;
    const gl = this.gl, { shape, origin, spacing, cut } = space;
    space.toSpace = shape.map((n, i) => 1 / (n * spacing[i]));
    space.toSpace0 = origin.map((o, i) => (0.5 * spacing[i] - o) * space.toSpace[i]);
    this.#texture("space", gl.TEXTURE_3D, true);
    if (cut) {
      const size = [shape[0], shape[1], shape[2] * cut.regions]; // one region behind the other
      gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGBA16F, ...size, 0, gl.RGBA, gl.HALF_FLOAT, space.values);
      this.#texture("depths", gl.TEXTURE_3D, true);
      gl.texImage3D(gl.TEXTURE_3D, 0, gl.RG16F, ...size, 0, gl.RG, gl.HALF_FLOAT, space.depths);
      space.slope = cut.slope;
      space.folds = cut.slope >= 1; // at least it may
      return;
    }
    const kind = this.smoothFloats ? gl.RGBA32F : gl.RGBA16F, padded = new Float32Array((space.values.length / 3) * 4);
    for (let i = 0, j = 0; i < space.values.length; i += 3, j += 4) {
      padded[j] = space.values[i]; padded[j + 1] = space.values[i + 1]; padded[j + 2] = space.values[i + 2];
    }
    gl.texImage3D(gl.TEXTURE_3D, 0, kind, ...shape, 0, gl.RGBA, gl.FLOAT, padded);
    space.slope = spaceSlope(space.values, shape, spacing);
    space.folds = space.slope >= 1 && spaceFolds(space.values, shape, spacing);
  }

  #program({ planar, space }) {
    const defines = definesOf(this.projection, planar, space, this.folds, Boolean(this.clip));
    const key = defines.join(" ");
    if (!this.programs[key]) {
      const lines = defines.map((d) => `#define ${d}\n`).join("");
      this.programs[key] = linked(this.gl, FRAGMENT.replace("#version 300 es\n", `#version 300 es\n${lines}`));
    }
    return this.programs[key];
  }

  /** A picture to draw into, made anew when its size changes. */
  #target(name, width, height) {
    const gl = this.gl, old = this.targets[name];
    if (old && old.width === width && old.height === height) return old;
    if (old) { gl.deleteTexture(old.texture); gl.deleteFramebuffer(old.buffer); }
    const target = { width, height, texture: gl.createTexture(), buffer: gl.createFramebuffer() };
    gl.activeTexture(gl.TEXTURE0 + UNITS.picture);
    gl.bindTexture(gl.TEXTURE_2D, target.texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, this.floats ? gl.RGBA16F : gl.RGBA8, width, height);
    for (const [k, v] of [["MIN_FILTER", "LINEAR"], ["MAG_FILTER", "LINEAR"], ["WRAP_S", "CLAMP_TO_EDGE"],
      ["WRAP_T", "CLAMP_TO_EDGE"]]) gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${k}`], gl[v]);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.buffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target.texture, 0);
    this.targets[name] = target;
    return target;
  }

  /**
   * Casts rays into a picture of that name. picture: {x, width, original, camera}, columns of it and what is seen there;
   * original leaves the displacement out. camera: eye, right, up (half the picture's extent each), ahead, bend, all in
   * the volume's frame. tile: [x, y, width, height] in pixels from the lower left. pass: 0 replaces, n > 0 averages with
   * the n passes before it.
   */
  cast(name, width, height, picture, { tile = null, pass = 0, coarseness = 1 } = {}) {
    const { camera, original } = picture, field = original ? { planar: null, space: null } : this;
    const gl = this.gl, target = this.#target(name, width, height), { program, at } = this.#program(field);
    const finest = Math.min(...this.volume.spacing), pixel = (2 * Math.hypot(...camera.up)) / height;
    const step = coarseness * Math.max(finest * 0.7, Math.min(pixel, 2 * finest));
    this.#fitTable(step);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.buffer);
    gl.viewport(picture.x, 0, picture.width, height); // which cuts off what lies beside it
    gl.useProgram(program);
    for (const [sampler, unit] of Object.entries(UNITS)) if (at[sampler]) gl.uniform1i(at[sampler], unit);
    this.#setCamera(at, camera, picture.width, height, pass);
    gl.uniform2f(at.place, picture.x, 0);
    this.#setVolumeNumbers(at, step, original ? this.volume.ownBox : this.volume.box);
    this.#setFieldNumbers(at, field);
    if (pass > 0) {
      gl.enable(gl.BLEND);
      gl.blendColor(0, 0, 0, 1 / (pass + 1));
      gl.blendFunc(gl.CONSTANT_ALPHA, gl.ONE_MINUS_CONSTANT_ALPHA);
    }
    if (tile) { gl.enable(gl.SCISSOR_TEST); gl.scissor(...tile); }
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.BLEND);
    gl.disable(gl.SCISSOR_TEST);
  }

  #setCamera(at, camera, width, height, pass) {
    const gl = this.gl;
    for (const name of ["eye", "right", "up", "ahead"]) gl.uniform3fv(at[name], camera[name]);
    gl.uniform1f(at.bend, camera.bend || 0);
    gl.uniform2f(at.resolution, width, height);
    // Later passes look through other places of each pixel, spread by the fractional parts of two irrational numbers.
    const spread = (x) => x - Math.floor(x) - 0.5;
    gl.uniform2f(at.shift, pass ? spread(0.5 + pass * 0.7548777) : 0, pass ? spread(0.5 + pass * 0.5698403) : 0);
    gl.uniform1f(at.phase, (pass * 0.6180340) % 1);
    const unit = (v) => v.map((x) => x / Math.hypot(...v));
    const [r, u, n] = [unit(camera.right), unit(camera.up), camera.ahead];
    const mixed = (a, b, c) => unit([0, 1, 2].map((i) => a * r[i] + b * u[i] + c * n[i]));
    // A lamp above the viewer's left shoulder: light from the eye alone looks flat. A weak one from the other side.
    const lamp = mixed(-0.42, 0.55, -0.72);
    gl.uniform3fv(at.lamp, lamp);
    gl.uniform3fv(at.halfway, unit([0, 1, 2].map((i) => lamp[i] - n[i])));
    gl.uniform3fv(at.fillLamp, mixed(0.7, -0.25, -0.5));
  }

  #setVolumeNumbers(at, step, box) {
    const gl = this.gl, volume = this.volume, { shape, spacing, extremes } = volume;
    gl.uniform1f(at.reach, Math.hypot(...box.low.map((low, i) => box.high[i] - low)) || 1);
    gl.uniform3fv(at.middle, box.low.map((low, i) => (low + box.high[i]) / 2));
    this.#setBox(at, box, step);
    gl.uniform3fv(at.toTexture, shape.map((n, i) => 1 / (n * spacing[i])));
    gl.uniform3fv(at.toTexture0, shape.map((n) => 0.5 / n));
    gl.uniform3fv(at.blockScale, shape.map((n, i) => n / (BLOCK * extremes.size[i])));
    gl.uniform3fv(at.blockSize, spacing.map((s) => s * BLOCK));
    gl.uniform1f(at.stepLength, step);
    gl.uniform1f(at.outside, volume.outside / 255);
    gl.uniform1f(at.outsideOpacity, opacityOfByte(this.table.rgba, volume.outside));
    // Below two hundredths of the range per voxel a slope is noise; bytes of the gradient count 1/127 of the steepest.
    gl.uniform1f(at.certain, ((volume.share ?? 1) * STEEPEST) / 127 / (0.012 * 255)); // of the range of all values
    gl.uniform2fv(at.grey, volume.grey || [0, 1]);
    gl.uniform3fv(at.ink, BACKGROUNDS[this.background].ink);
  }

  #setBox(at, box, step) {
    const gl = this.gl, left = this.clip ? leftOf(box, clipSides(this.volume.box, this.clip)) : box;
    gl.uniform3fv(at.boxLow, left.low);
    gl.uniform3fv(at.boxHigh, left.high);
    if (!this.clip) return;
    gl.uniform3fv(at.openLow, left.openLow);
    gl.uniform3fv(at.openHigh, left.openHigh);
    gl.uniform1f(at.bareDepth, 2 * Math.max(step, Math.min(...this.volume.spacing)));
  }

  #setFieldNumbers(at, { planar, space }) {
    const gl = this.gl;
    const plane = planar ? planar.slope : 0, rest = space ? space.slope * (1 + plane) : 0;
    // Of a composition: (1 + a)(1 + b) - 1, and nothing of a along the normal; a little more, because graphics cards
    // interpolate with few digits.
    const slope = [0, 1, 2].map((i) => 1.02 * (rest + (planar ? plane * Math.hypot(planar.plane.u[i], planar.plane.v[i]) : 0)));
    gl.uniform3fv(at.slope, slope);
    const axes = planar ? planar.plane : { u: [1, 0, 0], v: [0, 1, 0], n: [0, 0, 1] };
    gl.uniform3fv(at.axisU, axes.u);
    gl.uniform3fv(at.axisV, axes.v);
    gl.uniform3fv(at.axisN, axes.n);
    if (planar) {
      gl.uniform1i(at.mapCount, planar.count);
      gl.uniformMatrix3fv(at.toMap, false, planar.toMap);
      gl.uniform3fv(at.toMap0, planar.toMap0);
    }
    if (planar && planar.cut) this.#setCutNumbers(at, planar.cut);
    if ((planar && planar.cut) || (space && space.cut)) {
      const softness = Math.max(planar && planar.cut ? planar.softness : space.cut.softness, Math.min(...this.volume.spacing));
      gl.uniform1f(at.softness, softness);
      gl.uniform1f(at.faceWidth, FACE_VOXELS * softness);
      gl.uniform1f(at.rate, 1.2 * (1 + Math.hypot(...slope))); // more than 1: distances between samples are not quite such
    }
    if (space && space.cut) {
      gl.uniform1i(at.spaceRegions, space.cut.regions);
      gl.uniform1f(at.spaceEdge, 0.5 / space.shape[2]);
    }
    if (space) { gl.uniform3fv(at.toSpace, space.toSpace); gl.uniform3fv(at.toSpace0, space.toSpace0); }
    const finest = Math.min(...this.volume.spacing);
    gl.uniform1f(at.slopeStep, Math.max(finest, space ? Math.min(...space.spacing) / 2 : 0,
      planar ? Math.min(...planar.spacing) : 0));
  }

  #setCutNumbers(at, cut) {
    const gl = this.gl;
    gl.uniformMatrix3fv(at.toCut, false, cut.toCut);
    gl.uniform3fv(at.toCut0, cut.toCut0);
    gl.uniform2fv(at.cutScale, cut.scale);
    gl.uniform1i(at.cutCount, cut.shape[0]);
    gl.uniform1i(at.regionCount, cut.bits.length);
    gl.uniform1iv(at["sides[0]"], cut.bits);
  }

  /** Copies a picture into a larger one: what is not refined yet shows it. */
  enlarge(small, large, width, height) {
    const gl = this.gl, from = this.targets[small], to = this.#target(large, width, height);
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, from.buffer);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, to.buffer);
    gl.blitFramebuffer(0, 0, from.width, from.height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.LINEAR);
  }

  /** Shows a picture on the canvas, over the background; one that has parts side by side has it behind each. */
  present(name, parts = 1) {
    const gl = this.gl, { width, height } = this.canvas, ground = BACKGROUNDS[this.background];
    if (!this.programs.present) this.programs.present = linked(gl, PRESENT);
    const { program, at } = this.programs.present;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.useProgram(program);
    gl.activeTexture(gl.TEXTURE0 + UNITS.picture);
    gl.bindTexture(gl.TEXTURE_2D, name ? this.targets[name].texture : this.textures.picture);
    gl.uniform1i(at.picture, UNITS.picture);
    gl.uniform2f(at.resolution, width, height);
    gl.uniform1f(at.parts, parts);
    gl.uniform3fv(at.centre, ground.centre);
    gl.uniform3fv(at.corner, ground.corner);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** Gives the context back: a page has only about sixteen. */
  dispose() {
    this.volume = null;
    const lose = this.gl.getExtension("WEBGL_lose_context");
    if (lose && !this.gl.isContextLost()) lose.loseContext();
  }
}
