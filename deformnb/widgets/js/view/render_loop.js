// Scheduling of the drawing: quick pictures while something moves, then the full one piece by piece, then finer ones.
// Never more than one piece of work is on its way, so the next movement waits for that piece only.
// What is seen consists of pictures side by side, or of layers that are shown in turn; each has a place and a camera.
// A browser whose canvas has changed waits, as it puts its next frame together, for all that the GPU was given: so the
// canvas changes when the GPU has nothing left to do, and gets no more until that frame is on its way.

/** @import { RayCaster } from "../webgl/raycaster.js" */
/** @import { Picture } from "../webgl/types.d.ts" */

/** @typedef {[number, number, number, number]} Tile x, y, width and height in pixels, from the lower left */

/**
 * @typedef {object} Rush a quick picture under way
 * @property {{picture: Picture, tile: Tile}[]} pieces
 * @property {[number, number]} size
 * @property {number} coarseness
 * @property {number[]} layers
 * @property {number} start
 * @property {number} spent
 */

/**
 * @typedef {object} Work a full picture under way
 * @property {number} pass
 * @property {{picture: Picture, at: Tile}[]} tiles
 * @property {Picture[]} pictures
 * @property {[number, number]} size
 * @property {number} spent
 * @property {number} passes
 * @property {number} unseen
 */

const TILE_MS = 40; // a piece of the full picture: the pointer is answered after at most this and one quick picture
const PIECE_MS = 25; // of a quick picture: a widget that draws a picture beside it waits for one piece only
const REST_SHARE = 0.6; // a software renderer takes the processors from the widget that moves the points: so it rests
const MOST_REST = 60;
const SHOW_MS = 150; // of work on the full picture, after which what there is of it is shown
const MOST_PIECES = 3; // each waits for its turn at the GPU: many small ones take longer than they save
// [milliseconds, passes]: the faster a full picture, the more of them are averaged; without a GPU the processors have
// other work to do.
const PASSES = [[150, 8], [700, 4], [3000, 2]], SOFTWARE_PASSES = [[150, 4], [3000, 2]];

export class FrameLoop {
  /**
   * @param {RayCaster} caster
   * @param {(width: number, height: number) => Picture[]} pictures gives what is seen in a canvas of that size
   * @param {() => {target: number, settle: number}} options in milliseconds
   * @param {(loop: FrameLoop) => void} report is called when all is drawn
   * @param {() => void} catchUp is called before anything is drawn, for what is made only then
   */
  constructor(caster, pictures, options, report, catchUp) {
    this.caster = caster;
    this.pictures = pictures;
    this.options = options;
    this.report = report;
    this.catchUp = catchUp;
    this.scale = caster.isSoftware ? 0.3 : 0.7;
    this.pixelCost = caster.isSoftware ? 2e-3 : 2e-5; // ms, of the full picture; measured as soon as there is one
    this.moved = 0;
    this.isRequested = false;
    /** @type {Work | null} */
    this.work = null;
    this.held = false;
    this.layer = 0; // the one on the screen
    /** The share of layer 1 laid over layer 0; null where one layer is seen at a time. @type {number | null} */
    this.mixture = null;
    /** @type {Record<number, "coarse" | "full">} */
    this.drawn = {}; // by layer: whichever is up to date
    /** @type {string | null} */
    this.showing = null; // the picture on the canvas
    /** @type {string | null} */
    this.over = null; // the one that a mixture lays over it
    this.parts = 1; // pictures side by side
    /** @type {(() => void)[]} */
    this.after = []; // called after the next quick picture
    this.quickCost = 0; // ms for a pixel of a quick picture, measured with the first
    this.restUntil = 0; // no movement begins the next quick picture before that
    /** @type {Rush | null} */
    this.rush = null;
    /** @type {(() => void) | null} */
    this.change = null; // what comes with the next quick picture
    this.times = { drag: /** @type {number[]} */ ([]), full: 0, passes: 0, frames: 0 };
    /** @type {WebGLSync | null} */
    this.sync = null; // of the work that the GPU has not finished
    this.isShowing = false; // whether a frame with a changed canvas is put together
    this.waiting = 0;
    this.frame = 0;
    this.closed = false;
  }

  /** Draws soon, since something has changed. `held`: a finger or a button is still down. */
  touch(held = false) {
    this.held = held;
    this.moved = performance.now();
    this.isRequested = true;
    this.work = null;
    this.drawn = {};
    this.#plan(0);
  }

  /**
   * Changes what is drawn, but never within a picture; of several changes meanwhile the last one counts.
   * @param {() => void} change
   */
  apply(change) {
    if (this.rush) this.change = change;
    else change();
  }

  /** Lets the full picture begin: nothing has changed, but the finger is lifted. */
  release() { this.held = false; this.#plan(0); }

  /**
   * Shows another layer: at once if it has been drawn, else a quick picture of it; what is under way goes on.
   * @param {number} layer
   */
  flip(layer) {
    this.layer = layer;
    if (this.drawn[layer]) this.#present();
    else { this.isRequested = true; this.#plan(0); }
  }

  close() { this.closed = true; clearTimeout(this.waiting); cancelAnimationFrame(this.frame); }

  /** @param {number} delay */
  #plan(delay) {
    if (this.closed || this.sync || this.isShowing) return; // what is on its way plans the next step itself
    clearTimeout(this.waiting);
    cancelAnimationFrame(this.frame);
    const next = () => { this.frame = requestAnimationFrame(() => this.#step()); };
    const pause = Math.max(delay, this.restUntil - performance.now());
    if (pause > 0) this.waiting = setTimeout(next, pause); else next();
  }

  #step() {
    if (this.closed || !this.caster.isReady || this.caster.gl.isContextLost()) return;
    const { settle } = this.options(), idle = performance.now() - this.moved;
    if (this.rush) this.#piece(this.rush);
    else if (this.isRequested) this.#quick();
    else if (this.held || idle < settle) this.#plan(Math.max(16, settle - idle));
    else this.#refine();
  }

  /** @returns {[number, number]} */
  get size() { return [this.caster.canvas.width, this.caster.canvas.height]; }

  /**
   * @param {"coarse" | "full"} kind
   * @param {[number, number]} size
   * @param {Picture} picture
   * @param {Parameters<RayCaster["cast"]>[4]} options
   */
  #cast(kind, [width, height], picture, options) {
    this.caster.cast(`${kind}${picture.layer}`, width, height, picture, options);
  }

  #present() {
    const kind = this.drawn[this.layer];
    if (!kind) return;
    this.showing = `${kind}${this.layer}`;
    this.over = this.drawn[1] ? `${this.drawn[1]}1` : null;
    this.again();
  }

  /** Whether a picture is on the screen. @param {Picture} picture */
  #isSeen({ layer }) { return this.mixture !== null || layer === this.layer; }

  /**
   * @param {number} width
   * @param {number} height
   */
  #seen(width, height) {
    const pictures = this.pictures(width, height);
    if (!pictures.some((p) => p.layer === this.layer)) this.layer = 0;
    this.parts = pictures.filter((p) => p.layer === this.layer && !p.whole).length || 1;
    return pictures;
  }

  #quick() {
    this.isRequested = false;
    this.#settle();
    const [w, h] = this.size;
    const width = Math.max(24, Math.round(w * this.scale)), height = Math.max(24, Math.round(h * this.scale));
    const count = Math.max(1, Math.min(MOST_PIECES, Math.round((this.quickCost * width * height) / PIECE_MS)));
    const rows = Math.max(4, Math.ceil(height / count));
    /** @type {Rush["pieces"]} */
    const pieces = [];
    for (const picture of this.#seen(width, height)) {
      if (!this.#isSeen(picture)) continue;
      for (let y = 0; y < height; y += rows) {
        pieces.push({ picture, tile: [picture.x, y, picture.width, Math.min(rows, height - y)] });
      }
    }
    // Fewer samples along the ray too: half of what is saved by fewer pixels would be spent on depth nobody sees.
    const coarseness = this.scale < 0.5 ? 1.6 : 1.15;
    this.rush = { pieces, size: [width, height], coarseness,
      layers: [...new Set(pieces.map(({ picture }) => picture.layer))], start: performance.now(), spent: 0 };
    this.#piece(this.rush);
  }

  /** @param {Rush} rush */
  #piece(rush) {
    const piece = rush.pieces.shift(), start = performance.now();
    if (!piece) return;
    const { picture, tile } = piece;
    this.#cast("coarse", rush.size, picture, { coarseness: rush.coarseness, tile });
    this.#when(() => {
      rush.spent += performance.now() - start;
      if (rush.pieces.length > 0 || this.rush !== rush) return false;
      for (const layer of rush.layers) this.drawn[layer] = "coarse";
      this.#present();
      this.#rushed(rush);
      return true;
    });
  }

  /** @param {Rush} rush */
  #rushed(rush) {
    this.rush = null;
    const ms = performance.now() - rush.start, { target } = this.options();
    this.times.drag = [...this.times.drag.slice(-49), ms];
    this.times.frames += 1;
    const [width, height] = rush.size;
    this.quickCost = rush.spent / (width * height);
    const change = Math.sqrt((0.5 * target) / Math.max(rush.spent, 1)); // not the turns of others in between
    this.scale = Math.min(1, Math.max(0.12, this.scale * Math.min(1.35, Math.max(0.5, change))));
    for (const callback of this.after.splice(0)) callback();
    if (this.caster.isSoftware) this.restUntil = performance.now() + Math.min(MOST_REST, REST_SHARE * ms);
  }

  /** Makes the changes that were requested while a picture was being drawn. */
  #settle() {
    this.catchUp();
    const { change } = this;
    this.change = null;
    if (change) change();
  }

  /**
   * Begins a pass of the full picture, the first or the one after `last`.
   * @param {Work | null} last
   * @returns {Work}
   */
  #begin(last) {
    const [w, h] = this.size, pass = last ? last.pass + 1 : 0;
    const side = Math.max(16, Math.min(Math.max(w, h), Math.round(Math.sqrt(TILE_MS / this.pixelCost))));
    const pictures = last ? last.pictures : this.#seen(w, h);
    /** @type {Work["tiles"]} */
    const tiles = [];
    for (const picture of pictures) {
      const end = picture.x + picture.width;
      for (let y = 0; y < h; y += side) {
        for (let x = picture.x; x < end; x += side) {
          tiles.push({ picture, at: [x, y, Math.min(side, end - x), Math.min(side, h - y)] });
        }
      }
    }
    /** @typedef {Work["tiles"][number]} WorkTile */
    const far = (/** @type {WorkTile} */ { picture, at: [x, y, tw, th] }) => (
      Math.hypot(x + tw / 2 - picture.x - picture.width / 2, y + th / 2 - h / 2));
    const hidden = (/** @type {WorkTile} */ { picture }) => (picture.layer === this.layer ? 0 : 1);
    tiles.sort((a, b) => hidden(b) - hidden(a) || far(b) - far(a)); // from the end: what is seen, and its middle first
    /** @type {Work} */
    const work = { pass, tiles, pictures, size: [w, h], spent: last?.spent ?? 0, passes: last?.passes ?? 1, unseen: 0 };
    this.work = work;
    if (last) return work;
    for (const layer of new Set(pictures.map((p) => p.layer))) {
      if (this.drawn[layer] !== "coarse") continue;
      this.caster.enlarge(`coarse${layer}`, `full${layer}`, w, h);
      this.drawn[layer] = "full";
    }
    return work;
  }

  /** Draws pieces of the full picture for about TILE_MS. */
  #refine() {
    this.#settle();
    const work = this.work ?? this.#begin(null), [w, h] = work.size;
    if (w !== this.size[0] || h !== this.size[1]) { this.touch(); return; }
    if (work.tiles.length === 0) return;
    const start = performance.now();
    let pixels = 0;
    while (pixels * this.pixelCost < TILE_MS) {
      const tile = work.tiles.pop();
      if (!tile) break;
      this.#cast("full", work.size, tile.picture, { tile: tile.at, pass: work.pass });
      pixels += tile.at[2] * tile.at[3];
    }
    this.#when(() => {
      const ms = performance.now() - start;
      // Pieces differ: empty corners cost nothing. Learn slowly, so that a full piece does not take a second.
      this.pixelCost = Math.max(1e-6, 0.6 * this.pixelCost + 0.4 * (ms / pixels));
      if (this.work !== work) return false;
      work.unseen += ms;
      const isDue = work.unseen >= SHOW_MS || work.tiles.length === 0;
      if (isDue) { work.unseen = 0; this.#present(); }
      this.#finished(work, ms);
      return isDue;
    });
  }

  /**
   * @param {Work} work
   * @param {number} ms
   */
  #finished(work, ms) {
    work.spent += ms;
    if (work.tiles.length) return;
    for (const { layer } of work.pictures) this.drawn[layer] = "full";
    if (work.pass === 0) {
      this.times.full = work.spent;
      const passes = this.caster.isSoftware ? SOFTWARE_PASSES : PASSES;
      work.passes = (passes.find(([limit]) => work.spent < limit) ?? [0, 1])[1];
    }
    this.times.passes = work.pass + 1;
    if (work.pass + 1 < work.passes) this.#begin(work);
    else this.report(this);
  }

  /**
   * Calls done when the GPU has finished, without blocking the page; done returns whether it has changed the canvas.
   * @param {() => boolean} done
   */
  #when(done) {
    const gl = this.caster.gl;
    this.sync = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const look = () => {
      if (this.closed || !this.sync) return;
      if (gl.isContextLost()) { this.sync = null; return; }
      if (gl.getSyncParameter(this.sync, gl.SYNC_STATUS) !== gl.SIGNALED) { setTimeout(look, 2); return; }
      gl.deleteSync(this.sync);
      this.sync = null;
      this.isShowing = done();
      const next = () => { this.isShowing = false; this.#plan(0); };
      if (this.isShowing) requestAnimationFrame(() => setTimeout(next, 0)); // a frame is put together between the two
      else next();
    };
    setTimeout(look, 1);
  }

  /** Draws the full picture at once, for a screenshot: the page waits. */
  drawNow(passes = 2) {
    this.rush = null;
    this.#settle();
    const [w, h] = this.size, pictures = this.#seen(w, h).filter((p) => this.#isSeen(p));
    for (const picture of pictures) {
      for (let pass = 0; pass < passes; pass++) this.#cast("full", [w, h], picture, { pass });
    }
    for (const { layer } of pictures) this.drawn[layer] = "full";
    this.#present();
  }

  /** Shows again what was drawn last, or nothing but the background, after the canvas was cleared or that changed. */
  again() {
    this.caster.present(this.showing, this.parts, this.mixture === null ? null : this.over, this.mixture ?? 0);
  }
}
