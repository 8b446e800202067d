// Scheduling of the drawing: quick pictures while something moves; at rest all pixels, and then passes that are averaged.
// It is all drawn in pieces, but shown only when it is a whole picture, smoothly enlarged.
// Never more than two pieces of work are in flight, so the next movement waits for those only.
// The view consists of pictures side by side, or of alternating layers; each has a place and a camera.
// A browser whose canvas has changed waits, as it puts its next frame together, for all that the GPU was given: so the
// canvas changes when the GPU has nothing left to do, and receives no more until that frame is in flight.

import type { Vector2, Vector4 } from "../types.ts";
import type { RayCaster } from "../webgl/raycaster.ts";
import type { Picture } from "../webgl/types.ts";

/** X, y, width and height in pixels, from the lower left */
export type Tile = Vector4;

/** A quick picture under way */
export interface Rush {
  pieces: { picture: Picture; tile: Tile }[];
  size: Vector2;
  /** Whatever it is made of; pictures of equal ones are the same */
  inputs: unknown[];
  coarseness: number;
  layers: number[];
  start: number;
  spent: number;
  /** Pieces that the GPU has */
  inFlight: number;
}

/** Of a full picture */
export type Piece = { picture: Picture; at: Tile };

/** A whole picture of one layer, out of the full one under way */
export interface Stage {
  layer: number;
  /** The next one last */
  pieces: Piece[];
  /** The picture that is complete then */
  shows: string;
}

/** A full picture under way */
export interface Work {
  pass: number;
  /** The next one first */
  stages: Stage[];
  pictures: Picture[];
  size: Vector2;
  spent: number;
  passes: number;
}

const TILE_MS = 40; // a piece of the full picture: the pointer is answered after at most this and one quick picture
const PIECE_MS = 25; // of a quick picture: a widget that draws a picture next to it waits for one piece only
// Of the time that a picture may take while something moves. A software renderer draws on the processors that the widget
// that moves the points needs too.
const GPU_SHARE = 0.5,
  SOFTWARE_SHARE = 0.25; // of the usual 65 ms: 16, so that a volume follows in every second frame
const HEARD_MS = 3; // from the end of the GPU's work until the page is notified
const COARSEST = 2; // halvings of the pixels: half of them along both axes, or a moving volume is a blur
const FEWEST_PIXELS = 8000; // of a quick picture: 7 to 12 ms of drawing; with fewer it waits for other work as long
const KNOWN_COSTS = 5; // of quick pictures, whose median counts: a single slow one has other causes
const FITS_EASILY = 0.75,
  EXCEEDS = 1.3; // of the time: between the two the scale stays, or the picture would flicker
const ANSWER_MS = 1000; // after a drag: what changes within that time is an answer to it, and no movement follows
const QUEUED = 2; // pieces of a quick picture that the GPU has at a time
const MOST_PIECES = 3; // each waits for its turn at the GPU: many small ones take longer than they save
// [milliseconds, passes]: the faster a full picture, the more of them are averaged; without a GPU the processors have
// other work to do.
const PASSES: Vector2[] = [
    [150, 8],
    [700, 4],
    [3000, 2],
  ],
  SOFTWARE_PASSES: Vector2[] = [
    [150, 4],
    [3000, 2],
  ];

/** The resolution of quick pictures: they have as many pixels as are drawn in the time that they may take. */
class QuickScale {
  halvings: number; // how often the pixels of the full picture are halved
  cost = 0; // ms for a pixel, measured with the first picture: the median of the last ones
  #costs: number[] = [];

  constructor(readonly isSoftware: boolean) {
    this.halvings = isSoftware ? COARSEST : 1;
  }

  /** The share of the full picture's width and height that a quick one has. */
  get scale() {
    return 2 ** (-this.halvings / 2);
  }

  /**
   * Choose the pixels of the next pictures by the milliseconds that one of this scale took.
   * @param target milliseconds from one picture to the next
   */
  learn(spent: number, pixels: number, target: number) {
    this.#costs = [...this.#costs.slice(1 - KNOWN_COSTS), spent / pixels];
    this.cost = [...this.#costs].sort((a, b) => a - b)[this.#costs.length >> 1]!;
    let ms = this.cost * pixels;
    const most = (this.isSoftware ? SOFTWARE_SHARE : GPU_SHARE) * target;
    const coarsest = Math.min(COARSEST, Math.floor(this.halvings + Math.log2(pixels / FEWEST_PIXELS)));
    while (ms > EXCEEDS * most && this.halvings < coarsest) {
      this.halvings += 1;
      ms /= 2;
    }
    while (2 * ms < FITS_EASILY * most && this.halvings > 0) {
      this.halvings -= 1;
      ms *= 2;
    }
  }
}

/** The plan of full pictures: whole pictures, each of more pixels than the one before it, in pieces of about TILE_MS. */
class FullPlan {
  cost: number; // ms for a pixel, measured as soon as there is one

  constructor(isSoftware: boolean) {
    this.cost = isSoftware ? 2e-3 : 2e-5;
  }

  /** Pieces differ: empty corners cost nothing. Learn slowly, so that a full piece does not take a second. */
  learn(ms: number, pixels: number) {
    this.cost = Math.max(1e-6, 0.6 * this.cost + 0.4 * (ms / Math.max(1, pixels)));
  }

  /** The whole pictures of a pass; first that of the layer that is seen. */
  stages(pictures: Picture[], size: Vector2, layer: number): Stage[] {
    const layers = [...new Set(pictures.map((p) => p.layer))].sort((a) => (a === layer ? -1 : 1));
    return layers.map((one) => {
      const own = pictures.filter((p) => p.layer === one);
      return { layer: one, pieces: this.#pieces(own, size), shows: `full${one}` };
    });
  }

  #pieces(pictures: Picture[], [w, h]: Vector2) {
    const side = Math.round(Math.sqrt(TILE_MS / this.cost));
    const most = Math.max(16, Math.min(Math.max(w, h), side));
    const pieces: Piece[] = [];
    for (const picture of pictures) {
      const right = picture.x + picture.width;
      for (let y = 0; y < h; y += most) {
        for (let x = picture.x; x < right; x += most) {
          pieces.push({ picture, at: [x, y, Math.min(most, right - x), Math.min(most, h - y)] });
        }
      }
    }
    return pieces.reverse();
  }
}

/** What the canvas shows: of two layers one, or both mixed. */
class ShownLayers {
  layer = 0; // the one on the screen
  /** The share of layer 1 laid over layer 0; null where one layer is seen at a time. */
  mixture: number | null = null;
  /** By layer: the best picture that is up to date, "full" or a name for fewer pixels */
  drawn: Record<number, string> = {};
  quickInputs: unknown[] = []; // of the last quick picture that is complete
  #showing: string | null = null; // the picture on the canvas
  #over: string | null = null; // the one that a mixture lays over it
  #parts = 1; // pictures side by side

  /** @param pictures returns the pictures of a canvas of that size */
  constructor(
    readonly caster: RayCaster,
    readonly pictures: (width: number, height: number) => Picture[],
  ) {}

  isSeen(layer: number) {
    return this.mixture !== null || layer === this.layer;
  }

  /** Whether the canvas shows the best picture of the layer that is seen. */
  get isShowing() {
    return this.#showing !== null && this.#showing === this.drawn[this.layer];
  }

  choosePictures([width, height]: Vector2) {
    const pictures = this.pictures(width, height);
    if (!pictures.some((p) => p.layer === this.layer)) this.layer = 0;
    this.#parts = pictures.filter((p) => p.layer === this.layer && !p.whole).length || 1;
    return pictures;
  }

  show() {
    const name = this.drawn[this.layer];
    if (!name) return;
    this.#showing = name;
    this.#over = this.drawn[1] ?? null;
    this.again();
  }

  /**
   * Show the last picture again, or nothing but the background, after the canvas was cleared or that changed.
   */
  again() {
    const { caster, mixture } = this,
      name = this.#showing,
      over = mixture === null ? null : this.#over,
      isQuick = caster.gpu.isSoftware && name?.startsWith("coarse");
    caster.present(name, { parts: this.#parts, over, share: mixture ?? 0, isQuick });
  }
}

/** Movements of what is seen, and whether a finger or a button is down. */
class Movement {
  isHeld = false;
  #moved = 0;
  #dropped = -Infinity;

  hold(isHeld: boolean) {
    if (this.isHeld && !isHeld) this.#dropped = performance.now();
    this.isHeld = isHeld;
  }

  move(isHeld: boolean) {
    this.hold(isHeld);
    this.#moved = performance.now();
  }

  /** Milliseconds until it is at rest, which it is for `settle`; what answers a drag need not settle. */
  left(settle: number) {
    const pause = this.#moved < this.#dropped + ANSWER_MS ? 0 : settle;
    return this.#moved + pause - performance.now();
  }
}

type Scheduler = {
  postTask: (task: () => void, options: { priority: "user-blocking"; delay: number }) => Promise<void>;
};

/** Call before the timers of the page, which wait for all its movements. */
function soon(task: () => void, delay: number) {
  const { scheduler } = globalThis as unknown as { scheduler?: Scheduler };
  if (scheduler) scheduler.postTask(task, { priority: "user-blocking", delay });
  else setTimeout(task, delay);
}

/** Work that the GPU was given, and what to call when it is finished. */
type Turn = { sync: WebGLSync; done: (ms: number) => boolean };

/** The turns of the GPU: at most QUEUED pieces of work are in flight, and then a frame of the page, if the canvas has changed. */
class GpuTurns {
  isClosed = false;
  #inFlight: Turn[] = []; // the oldest first
  #begun = 0; // when the GPU began the oldest one
  #isShowing = false; // whether a frame with a changed canvas is put together
  #timer = 0;
  #frame = 0;

  /** @param step gives the GPU its next piece of work */
  constructor(
    readonly gl: WebGL2RenderingContext,
    readonly step: () => void,
  ) {}

  close() {
    this.isClosed = true;
    clearTimeout(this.#timer);
    cancelAnimationFrame(this.#frame);
  }

  get #isBusy() {
    return this.#inFlight.length > 0 || this.#isShowing;
  }

  plan(delay: number) {
    if (this.isClosed || this.#isBusy) return; // the work in flight plans the next step itself
    if (this.#frame) return; // rescheduled by a change in every frame, as by an animation, it would never run
    clearTimeout(this.#timer);
    const step = () => {
      this.#frame = 0;
      this.#go();
    };
    // After the frame: a widget that moves points has drawn them by then, and its picture waits for no rays.
    const next = () => {
      this.#frame = requestAnimationFrame(() => soon(step, 0));
    };
    if (delay > 0) this.#timer = setTimeout(next, delay);
    else next();
  }

  /** Step, where no other step has given the GPU work meanwhile. */
  #go() {
    if (!this.isClosed && !this.#isBusy) this.step();
  }

  /**
   * Call done when the GPU has finished what it was given, without blocking the page, with the milliseconds that it
   * took; done returns whether it has changed the canvas. Where the page polls late, half of the time since its last
   * poll is counted.
   */
  wait(done: (ms: number) => boolean) {
    const { gl } = this;
    const sync = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    if (!sync) return; // the context is lost
    this.#inFlight.push({ sync, done });
    if (this.#inFlight.length > 1) return;
    const now = performance.now();
    this.#begun = now;
    soon(() => this.#look(now), 1);
  }

  /** @param looked when the page polled last */
  #look(looked: number) {
    const { gl } = this,
      [oldest] = this.#inFlight;
    if (this.isClosed || !oldest) return;
    if (gl.isContextLost()) {
      this.#inFlight = [];
      return;
    }
    const now = performance.now();
    if (gl.getSyncParameter(oldest.sync, gl.SYNC_STATUS) !== gl.SIGNALED) {
      soon(() => this.#look(now), 2);
      return;
    }
    gl.deleteSync(oldest.sync);
    this.#inFlight.shift();
    const ended = (looked + now) / 2,
      ms = ended - this.#begun,
      others = this.#inFlight.length;
    this.#begun = ended;
    this.#isShowing = oldest.done(ms);
    const next = () => {
      this.#isShowing = false;
      this.#go();
    };
    if (others > 0) soon(() => this.#look(ended), 0);
    // A frame is put together between the two.
    else if (this.#isShowing) requestAnimationFrame(() => soon(next, 0));
    else if (!this.#isBusy) soon(next, 0);
  }
}

export class FrameLoop {
  readonly screen: ShownLayers;
  readonly quick: QuickScale;
  readonly full: FullPlan;
  readonly movement = new Movement();
  readonly turns: GpuTurns;
  isRequested = false;
  work: Work | null = null;
  rush: Rush | null = null;
  change: (() => void) | null = null; // applied with the next quick picture
  begun: (() => void)[] = []; // called when the next quick picture has begun
  times: { drag: number[]; full: number; passes: number; frames: number } = { drag: [], full: 0, passes: 0, frames: 0 };

  /**
   * @param pictures returns the pictures of a canvas of that size
   * @param options in milliseconds
   * @param report called when all is drawn
   * @param catchUp called before anything is drawn, for lazy updates
   */
  constructor(
    readonly caster: RayCaster,
    pictures: (width: number, height: number) => Picture[],
    readonly options: () => { target: number; settle: number },
    readonly report: (loop: FrameLoop) => void,
    readonly catchUp: () => void,
  ) {
    this.screen = new ShownLayers(caster, pictures);
    this.quick = new QuickScale(caster.gpu.isSoftware);
    this.full = new FullPlan(caster.gpu.isSoftware);
    this.turns = new GpuTurns(caster.gpu.gl, () => this.#step());
  }

  /** Draw soon, since something has changed. `held`: a finger or a button is still down. */
  touch(held = false) {
    this.movement.move(held);
    this.isRequested = true;
    this.work = null;
    this.screen.drawn = {};
    this.turns.plan(0);
  }

  /** Change the pictures, but never within a picture; of several changes before the next one the last counts. */
  apply(change: () => void) {
    if (this.rush || this.isRequested) this.change = change;
    else change();
  }

  /** Let the full picture begin: nothing has changed, but the finger is lifted. */
  release() {
    this.movement.hold(false);
    this.turns.plan(0);
  }

  /** Show a layer: at once if it has been drawn, else a quick picture of it; work under way continues. */
  flip(layer: number) {
    const { screen } = this;
    screen.layer = layer;
    if (screen.drawn[layer]) screen.show();
    else {
      this.isRequested = true;
      this.turns.plan(0);
    }
  }

  close() {
    this.turns.close();
  }

  #step() {
    const { caster, movement, turns } = this;
    if (turns.isClosed || !caster.isReady || caster.gpu.gl.isContextLost()) return;
    const left = movement.left(this.options().settle);
    if (this.rush) this.#piece(this.rush);
    else if (this.isRequested) this.#quick();
    else if (movement.isHeld || left > 0) turns.plan(Math.max(16, left));
    else this.#refine();
  }

  get size(): Vector2 {
    return [...this.caster.size];
  }

  #quick() {
    this.isRequested = false;
    this.#settle();
    const { cost, scale } = this.quick,
      [w, h] = this.size;
    const width = Math.max(24, Math.round(w * scale)),
      height = Math.max(24, Math.round(h * scale));
    const count = Math.max(1, Math.min(MOST_PIECES, Math.round((cost * width * height) / PIECE_MS)));
    const rows = Math.max(4, Math.ceil(height / count));
    const pictures = this.screen.choosePictures([width, height]).filter(({ layer }) => this.screen.isSeen(layer)),
      pieces: Rush["pieces"] = [];
    for (const picture of pictures) {
      for (let y = 0; y < height; y += rows) {
        pieces.push({ picture, tile: [picture.x, y, picture.width, Math.min(rows, height - y)] });
      }
    }
    // Fewer samples along the ray too: half of the time saved by fewer pixels would be spent on depth nobody sees.
    const coarseness = this.caster.gpu.isSoftware && scale < 1 ? 2 : 1.15;
    const rush: Rush = {
      pieces,
      size: [width, height],
      inputs: [width, height, coarseness, ...this.caster.inputsOf(pictures)],
      coarseness,
      layers: [...new Set(pictures.map(({ layer }) => layer))],
      start: performance.now(),
      spent: 0,
      inFlight: 0,
    };
    const { quickInputs } = this.screen,
      isSame = quickInputs.length > 0 && rush.inputs.every((input, k) => input === quickInputs[k]);
    if (isSame) {
      // A drag that is stopped at folds moves nothing.
      for (const layer of rush.layers) this.screen.drawn[layer] = `coarse${layer}`;
      if (!this.screen.isShowing) this.screen.show();
    } else {
      this.rush = rush;
      this.screen.quickInputs = [];
      for (let k = 0; k < QUEUED; k++) this.#piece(rush);
    }
    for (const callback of this.begun.splice(0)) callback();
    if (isSame) this.turns.plan(0);
  }

  #piece(rush: Rush) {
    const piece = rush.pieces.shift();
    if (!piece) return;
    const { picture, tile } = piece;
    this.caster.cast(`coarse${picture.layer}`, ...rush.size, picture, { coarseness: rush.coarseness, tile });
    rush.inFlight += 1;
    this.turns.wait((ms) => this.finishPiece(rush, ms));
  }

  /** Go on after a piece that the GPU has ended; returns whether the picture is whole. */
  finishPiece(rush: Rush, ms: number) {
    rush.inFlight -= 1;
    rush.spent += Math.max(0, ms - HEARD_MS);
    if (this.rush !== rush) return false;
    if (!this.caster.isReady) {
      this.rush = null; // another volume is on its way, which will be drawn whole
      return false;
    }
    if (rush.pieces.length > 0) this.#piece(rush); // the GPU does not wait for the page between two of them
    if (rush.inFlight > 0) return false;
    this.#finishRush(rush);
    return true;
  }

  #finishRush(rush: Rush) {
    this.rush = null;
    this.screen.quickInputs = rush.inputs;
    for (const layer of rush.layers) this.screen.drawn[layer] = `coarse${layer}`;
    this.screen.show();
    const ms = performance.now() - rush.start;
    this.times.drag = [...this.times.drag.slice(-49), ms];
    this.times.frames += 1;
    const [width, height] = rush.size;
    this.quick.learn(rush.spent, width * height, this.options().target);
  }

  /** Make the changes that were requested while a picture was being drawn. */
  #settle() {
    this.catchUp();
    const { change } = this;
    this.change = null;
    if (change) change();
  }

  /** Begin a pass of the full picture, the first or the one after `last`. */
  #begin(last: Work | null): Work {
    const { screen, size } = this,
      pictures = last ? last.pictures : screen.choosePictures(size),
      stages = this.full.stages(pictures, size, screen.layer),
      { pass, spent, passes } = last ?? { pass: -1, spent: 0, passes: 1 };
    this.work = { pass: pass + 1, stages, pictures, size, spent, passes };
    return this.work;
  }

  /** Draw pieces of the full picture for about TILE_MS. */
  #refine() {
    this.#settle();
    const work = this.work ?? this.#begin(null),
      [w, h] = work.size,
      [stage] = work.stages;
    if (w !== this.size[0] || h !== this.size[1]) {
      this.touch();
      return;
    }
    if (!stage) return;
    let pixels = 0;
    while (pixels * this.full.cost < TILE_MS) {
      const piece = stage.pieces.pop();
      if (!piece) break;
      this.caster.cast(stage.shows, w, h, piece.picture, { tile: piece.at, pass: work.pass });
      pixels += piece.at[2] * piece.at[3];
    }
    this.turns.wait((ms) => {
      this.full.learn(ms, pixels);
      if (this.work !== work) return false;
      work.spent += ms;
      if (stage.pieces.length > 0) return false;
      work.stages.shift();
      this.screen.drawn[stage.layer] = stage.shows;
      if (work.stages.length === 0) this.#finished(work);
      if (!this.screen.isSeen(stage.layer)) return false;
      this.screen.show();
      return true;
    });
  }

  #finished(work: Work) {
    if (work.pass === 0) {
      this.times.full = work.spent;
      const passes = this.caster.gpu.isSoftware ? SOFTWARE_PASSES : PASSES;
      work.passes = (passes.find(([limit]) => work.spent < limit) ?? [0, 1])[1];
    }
    this.times.passes = work.pass + 1;
    if (work.pass + 1 < work.passes) this.#begin(work);
    else this.report(this);
  }

  /** Draw the full picture at once, for a screenshot: the page waits. */
  drawNow(passes = 2) {
    this.rush = null;
    this.#settle();
    const { screen } = this,
      [w, h] = this.size,
      pictures = screen.choosePictures([w, h]).filter((p) => screen.isSeen(p.layer));
    for (const picture of pictures) {
      for (let pass = 0; pass < passes; pass++) this.caster.cast(`full${picture.layer}`, w, h, picture, { pass });
    }
    for (const { layer } of pictures) screen.drawn[layer] = `full${layer}`;
    screen.show();
  }
}
