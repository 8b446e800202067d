// The live view: a volume, turned and deformed in the browser.
// To Python: hello, chunk, still, drawn, follows, screenshot, seen, stats, bye. From Python: chunk, field, drawn, info, screenshot.
// Frames of movies: see movie_frames.js.

import type {
  Chunk,
  FieldMaps,
  LiveViewToFrontEnd,
  LiveViewToPython,
  MovieFrame,
  ScreenshotRequest,
} from "../generated.ts";
import { clipOf, isClipped } from "../maths/clipping.ts";
import type { Model, ModelHandler, Vector2, Vector3, Without } from "../types.ts";
import { OWN_KEYS, pageElement, setText } from "../ui/dom.ts";
import type { Flicker, Shows, ViewName } from "../ui/view_parts.ts";
import { measuredBy, opened, picturesOf, remarksOn } from "../ui/view_parts.ts";
import { MemoryError, NOT_HELD, RayCaster } from "../webgl/raycaster.ts";
import type { Picture, PlanarField, SpaceField, VolumeData } from "../webgl/types.ts";
import type { KnownCuts } from "./follow_editor.ts";
import { FieldLink, fieldOf } from "./follow_editor.ts";
import { SpaceLink } from "./follow_space.ts";
import { MovieFrames } from "./movie_frames.ts";
import { TimeLink } from "./playback.ts";
import { PointerControls } from "./pointer.ts";
import { FrameLoop } from "./render_loop.ts";
import { StillPicture } from "./server_view.ts";
import { SpacePoints } from "./space_points.ts";
import type { Bytes, Field, VolumeInfo } from "./types.ts";
import { ViewCamera } from "./view_camera.ts";
import { ViewElements, ViewMessages } from "./view_elements.ts";
import { floatsOf, VolumeLoader } from "./volume_loader.ts";

const FEWEST = 32 ** 3; // voxels that are still worth a look

export class LiveVolumeView {
  closed = false;
  messages: ViewMessages;
  elements: ViewElements;
  root: HTMLDivElement;
  canvas: HTMLCanvasElement;
  pixels: Vector2;
  flicker: Flicker;
  shown: Shows;
  info: VolumeInfo | null = null;
  field: Field | null = null;
  values: Uint8Array | null = null; // the voxels, once all are here
  loader: VolumeLoader | null = null;
  caster: RayCaster | null = null; // null where WebGL is missing
  loop: FrameLoop | null = null;
  still: StillPicture | null = null; // where WebGL is missing
  isScarce = false; // whether the GPU did not hold all voxels
  wasTooMuch = false;
  sent: { received: number };
  movie: MovieFrames | null = null; // that is drawn for Python
  cuts: KnownCuts = {};
  stats: Record<string, number> | null = null; // measurements of the last full picture
  camera: ViewCamera;
  progress: HTMLDivElement;
  link: FieldLink;
  times: TimeLink;
  spaceLink: SpaceLink;
  pointer: PointerControls;
  spacePoints: SpacePoints;

  constructor(
    readonly model: Model,
    el: HTMLElement,
  ) {
    this.messages = new ViewMessages(model, (error) => this.fail(error));
    this.elements = new ViewElements(model, el, "dnb-live", {
      showView: (view) => this.showView(view),
      rethemed: () => this.setBackground(),
      flip: (layer) => this.flip(layer),
      compared: () => this.compared(),
      resized: () => this.size(),
      picture: () => this.picture(),
    });
    this.root = this.elements.root;
    this.canvas = this.elements.canvas;
    this.pixels = [this.canvas.width, this.canvas.height]; // of the full picture
    this.flicker = this.elements.flicker;
    this.shown = this.elements.shows;
    this.sent = { received: 0 };
    this.camera = new ViewCamera(this);
    this.progress = pageElement("div", "dnb-progress", this.root, {
      role: "progressbar",
      "aria-label": "loading the volume",
    });
    this.setBackground();
    this.size();

    this.#listen();
    this.link = new FieldLink(
      model,
      (planar, isDrawing) => this.planarFromLink(planar, isDrawing),
      (isMoving) => this.movedByLink(isMoving),
    );
    this.times = new TimeLink(this);
    this.spaceLink = new SpaceLink(model, {
      info: () => this.info,
      move: (isMoving) => this.movedByLink(isMoving),
      apply: (space, isMoving) => this.spaceFromLink(space, isMoving),
      follows: (sender) => this.send({ type: "follows", sender }),
    });
    for (const [link, name] of [
      [this.link, "editor"],
      [this.times, "player"],
      [this.spaceLink, "points_editor"],
    ] as const) {
      this.on(`change:${name}`, () => link.follow(model.get(name)));
      link.follow(model.get(name)).catch((error) => this.fail(error));
    }
    this.pointer = new PointerControls(this);
    this.spacePoints = new SpacePoints(this);
    this.#start();
  }

  // -- canvas, captions, notice --------------------------------------------------------------------------------------

  size() {
    const { width, height } = this.elements.fit(),
      [w, h] = [Math.max(1, width), Math.max(1, height)];
    if (this.pixels[0] === w && this.pixels[1] === h) return;
    this.camera.reframed(() => {
      this.pixels = [w, h];
    });
    this.caster?.resize(w, h);
    if (this.loop) {
      this.loop.again();
      this.touch();
    }
  }

  setBackground() {
    const { background } = this.elements;
    this.root.dataset.background = background;
    if (!this.caster || this.caster.background === background) return;
    this.caster.background = background;
    this.loop?.again();
    this.touch();
  }

  setShows() {
    const { shows } = this.elements;
    this.camera.reframed(() => {
      this.shown = shows;
    });
    this.flicker.set(shows === "flicker" && Boolean(this.loop));
    this.elements.compare.set(this.loop ? shows : "");
    this.caption();
    this.#setMixture();
    if (this.loop) this.loop.flip(0);
    this.touch();
    this.still?.request();
  }

  /** The line or the slider between original and deformed was moved. */
  compared() {
    if (this.elements.shows !== "fade") {
      this.touch();
      return;
    }
    this.#setMixture();
    this.loop?.again(); // both are drawn
  }

  #setMixture() {
    if (this.loop) this.loop.mixture = this.elements.shows === "fade" ? this.elements.compare.share : null;
  }

  setClip() {
    const clip = clipOf(this.model);
    if (this.caster) this.caster.clip = isClipped(clip) ? clip : null;
    this.touch();
    this.still?.request();
  }

  caption() {
    this.elements.caption(this.still ? 0 : this.flicker.layer);
  }

  flip(layer: number) {
    this.caption();
    if (this.loop) this.loop.flip(layer);
  }

  /** The pictures that fill a canvas of this size. */
  pictures(width: number, height: number): Picture[] {
    const pictures = picturesOf(this.elements.shows, width, this.elements.compare.share);
    return pictures.map((picture) => ({ ...picture, camera: this.seen((picture.whole ?? picture).width / height) }));
  }

  showMessage(text: string) {
    this.elements.showMessage(text);
  }

  mark() {
    setText(this.elements.badge, remarksOn(this));
  }

  // -- the camera ----------------------------------------------------------------------------------------------------

  /** The camera in the volume's own frame, for a picture of this width by height. */
  seen(aspect: number) {
    return this.camera.seen(aspect);
  }

  readCamera(isForced = false) {
    if (this.camera.read(isForced)) this.touch();
  }

  writeCamera() {
    this.camera.write();
    this.still?.request();
  }

  showView(view: ViewName) {
    if (!this.info) return;
    this.camera.seeAll(this.info.views[view]);
    this.touch();
    this.writeCamera();
  }

  // -- start, loss and return of WebGL -------------------------------------------------------------------------------

  #start() {
    this.caster = this.#newCaster();
    if (this.caster) {
      this.#prepare(this.caster);
      this.caster.present(null);
    }
    this.hello();
    this.setShows();
    this.setTable();
    this.setInfo();
  }

  /** Null without WebGL, and then Python draws. */
  #newCaster() {
    try {
      const caster = new RayCaster(this.canvas);
      caster.resize(...this.pixels);
      return caster;
    } catch (error) {
      this.fall(`Drawn in Python: ${(error as Error).message}.`);
      return null;
    }
  }

  /** @param voxels the most that the GPU holds, where it has been found not to hold all */
  hello(voxels: number | null = null) {
    const { caster } = this;
    this.send({
      type: "hello",
      largest: caster?.largest ?? 0,
      renderer: caster?.name ?? "",
      software: caster?.isSoftware ?? true,
      background: this.elements.theme.name,
      ...(voxels && { voxels }),
    });
  }

  /**
   * Requests half of the voxels from Python, since the GPU does not hold the volume, until they are too few to look at.
   */
  #requestFewerVoxels(why: MemoryError, shape: Vector3) {
    const fewer = Math.floor((shape[0] * shape[1] * shape[2]) / 2);
    if (fewer < FEWEST) throw why;
    this.isScarce = true;
    this.loader = null;
    this.values = null;
    this.hello(fewer);
  }

  #prepare(caster: RayCaster) {
    this.loop = new FrameLoop(
      caster,
      (width, height) => this.pictures(width, height),
      () => ({ target: this.model.get("target_ms"), settle: this.model.get("settle_ms") }),
      (loop) => this.sendStats(loop),
      () => this.catchUp(),
    );
    caster.projection = this.model.get("projection");
    caster.background = this.elements.background;
    this.setFolds();
    this.setOcclusion();
    this.setClip();
  }

  setFolds() {
    if (this.caster) {
      this.caster.showFolds = this.model.get("show_folds") ?? true;
      this.touch();
    }
  }

  setOcclusion() {
    if (this.caster) this.caster.occlusion = this.model.get("ambient_occlusion") ?? true;
    this.touch();
  }

  /** Lets Python draw, as there is no WebGL. */
  fall(text: string) {
    this.showMessage(text);
    this.still ??= new StillPicture(this, text);
    this.flicker.set(false); // a still of it is the deformed volume
    this.elements.compare.set(""); // and of these it has the line in the middle, or half of each
    this.caption();
    this.still.request();
  }

  lost(event: Event) {
    event.preventDefault(); // else it never comes back
    if (this.closed) return;
    if (this.loop) this.loop.close();
    this.loop = null;
    this.wasTooMuch = Boolean(this.caster?.volume && !this.caster.volume.loaded); // lost by what it was just given
    this.fall("Drawn in Python until the lost graphics context comes back.");
  }

  restored() {
    if (this.closed) return;
    this.still?.close();
    this.still = null;
    this.showMessage("");
    this.caster = null;
    this.caster = this.#newCaster();
    if (!this.caster) return;
    this.#prepare(this.caster);
    this.setShows();
    this.setTable();
    if (!this.values || !this.info) return;
    if (this.wasTooMuch) this.#requestFewerVoxels(new MemoryError(NOT_HELD), this.info.shape);
    else this.upload(this.info, this.values).catch((error) => this.fail(error));
  }

  // -- messages and traits -------------------------------------------------------------------------------------------

  send(content: Without<LiveViewToPython, "view">, buffers?: ArrayBuffer[]) {
    this.messages.send(content, buffers);
  }

  on(name: string, handler: (...given: Parameters<ModelHandler>) => unknown) {
    this.messages.on(name, handler);
  }

  fail(error: unknown) {
    console.error(error);
    this.showMessage(`The live view has failed: ${(error instanceof Error && error.message) || error}`);
  }

  #listen() {
    this.on("msg:custom", (content, buffers) => this.receive(content, buffers || []));
    this.on("change:volume_info", () => this.setInfo());
    this.on("change:table", () => this.setTable());
    this.on("change:camera", () => this.readCamera());
    this.on("change:projection", () => {
      if (this.caster) this.caster.projection = this.model.get("projection");
      this.touch();
    });
    this.on("change:show_folds", () => {
      this.setFolds();
      this.mark();
    });
    this.on("change:ambient_occlusion", () => this.setOcclusion());
    this.on("change:background", () => this.setBackground());
    this.on("change:shows", () => this.setShows());
    this.on("change:clip", () => this.setClip());
    this.on("change:label", () => this.caption());
    for (const name of ["width", "height", "fill"]) this.on(`change:${name}`, () => this.size());
  }

  /** Takes a message of Python, or the picture of a page without Python. */
  receive(content: LiveViewToFrontEnd | { type: "still" }, buffers: Bytes[]) {
    if ("view" in content && content.view && content.view !== this.messages.id) return undefined; // for another front end of the same view
    if (content.type === "chunk") return this.receiveChunk(content, buffers[0]!);
    if (content.type === "field") return this.receiveField(content, buffers);
    if (content.type === "still") return this.receiveStill(buffers[0]!);
    if (content.type === "drawn") return this.still?.drawn(content.info as unknown as VolumeInfo);
    if (content.type === "info") return this.still?.inform(content.info as unknown as VolumeInfo);
    if (content.type === "screenshot") return this.screenshot(content);
    if (content.type === "movie_frame") return this.movieFrame(content, buffers);
    if (content.type === "movie_end") return this.endMovie();
    return undefined;
  }

  setInfo() {
    const info: VolumeInfo | null = this.model.get("volume_info");
    if (!info?.shape || this.info?.id === info.id) return;
    this.info = info;
    this.values = null;
    this.mark();
    this.readCamera(true);
    if (!this.caster) {
      this.still?.request();
      return;
    }
    if (this.loader) this.loader.close();
    this.loader = new VolumeLoader(
      info,
      (index) => this.send({ type: "chunk", id: info.id, index }),
      (share) => this.setProgress(0.8 * share),
      (isStuck) => this.setStuck(isStuck),
    );
  }

  setStuck(isStuck: boolean) {
    this.showMessage(isStuck ? "The volume does not come. Is the kernel running?" : "");
    if (!isStuck) return;
    const button = pageElement("button", "dnb-again", this.elements.notice, { type: "button", ...OWN_KEYS });
    button.textContent = "Try again";
    button.addEventListener("click", () => {
      if (!this.field) this.hello();
      this.loader?.again();
    });
  }

  setProgress(share: number) {
    this.progress.style.setProperty("--share", String(share));
    this.progress.setAttribute("aria-valuenow", String(Math.round(100 * share)));
    this.progress.hidden = share >= 1;
  }

  receiveStill(png: Bytes) {
    if (!this.still) this.fall(NOT_HELD); // no Python that could make the volume smaller
    this.still?.receive(png);
  }

  async receiveChunk(content: Chunk, packed: Bytes) {
    const { loader } = this;
    if (!loader || loader.id !== content.id) return;
    this.sent.received += packed.byteLength;
    const values = await loader.receive(content, packed);
    if (!values || !this.info) return;
    this.values = values;
    await this.upload(this.info, values);
  }

  /** What a ray caster is told of the volume beside its values. */
  about({ shape, spacing, outside, grey, share, is_labels: isLabels, box }: VolumeInfo): VolumeData {
    return { shape, spacing, outside, isLabels, grey, share, box: { low: box.low, high: box.high }, ownBox: box };
  }

  async upload(info: VolumeInfo, values: Uint8Array) {
    const { caster } = this;
    if (!caster) return;
    const { shape } = info;
    const tick = (done: number) =>
      new Promise<void>((resolve) => {
        this.setProgress(0.8 + 0.19 * done);
        setTimeout(resolve, 0);
      });
    let done = false;
    try {
      const uploaded = caster.setVolume(values, this.about(info), tick);
      this.loader = null;
      this.setTable(); // now, for these voxels: once they are up it would be fitted to them a second time
      done = await uploaded;
    } catch (error) {
      if (!(error instanceof MemoryError)) throw error;
      if (caster === this.caster && info === this.info) this.#requestFewerVoxels(error, shape);
      return;
    }
    if (!done || caster !== this.caster) return;
    if (!this.field) this.hello(); // lost on its way
    this.applyField();
    this.setProgress(1);
    this.touch();
  }

  setTable() {
    const bytes: Bytes | null = this.model.get("table");
    if (!this.caster || !bytes?.byteLength) return;
    if (this.loader && this.caster.volume) return; // of voxels that are on their way: see upload
    this.caster.setTable(floatsOf(bytes), this.model.get("unit"));
    this.touch();
  }

  receiveField(content: FieldMaps, buffers: Bytes[]) {
    this.sent.received += buffers.reduce((sum, b) => sum + b.byteLength, 0);
    this.times.drop();
    const field = content.frames
      ? this.times.take(content, content.frames, buffers as [Bytes, Bytes])
      : fieldOf(content, buffers, this.cuts);
    if (!field) {
      this.hello();
      return;
    } // which is answered with all of it
    this.camera.reframed(() => {
      // a larger field of view is seen whole
      this.field = {
        ...field,
        planar: this.link.merged(field.planar, content.follow || null),
        space: this.spaceLink.merged(field.space, content.moved || null),
      };
    });
    this.mark();
    this.applyField();
    this.touch();
    this.confirm(content.seq);
  }

  /** Lets Python send the next field when this one is being drawn: so it computes that while the GPU has this. */
  confirm(seq: number | undefined) {
    if (!seq) return;
    const confirm = () => {
      if (!this.closed) this.send({ type: "seen", seq });
    };
    if (this.still) this.still.whenShown(confirm);
    else if (this.loop && this.caster?.isReady) this.loop.begun.push(confirm);
    else confirm();
  }

  applyField() {
    const { caster, loop } = this;
    if (!caster?.volume || !this.field || !loop) return;
    loop.apply(() => {
      const { field } = this; // of then, which may be a newer one
      if (!caster.volume || !field) return;
      caster.setPlanar(field.planar);
      caster.setSpace(field.space);
      caster.volume.box = this.camera.box;
      this.mark();
    });
  }

  /** Shows new maps from the editor in this window: no byte goes to Python. */
  planarFromLink(planar: PlanarField, isDrawing: boolean) {
    if (this.field) this.field.planar = planar;
    else this.field = { box: null, planar, space: null };
    this.applyField();
    if (!isDrawing && this.caster?.volume) this.touch(this.link.isMoving);
  }

  /** The same of a displacement in space. */
  spaceFromLink(space: SpaceField, isMoving: boolean) {
    if (!this.field) return;
    this.field.space = space;
    this.applyField();
    if (!isMoving && this.caster?.volume) this.touch();
  }

  /** Makes the maps and the displacement of the newest movements. */
  catchUp() {
    this.link.catchUp();
    this.spaceLink.catchUp();
  }

  /** Shows that a point is on its way: its maps are made with the next picture, or now if none is drawn here. */
  movedByLink(isMoving: boolean) {
    if (!isMoving && this.loop?.held) this.loop.release();
    if (!isMoving) return;
    if (this.loop && this.caster?.volume) this.touch(true);
    else this.catchUp();
  }

  /** What is seen, as a PNG, drawn in full. */
  async picture(): Promise<Blob | null> {
    if (this.still) return this.still.image.src ? (await fetch(this.still.image.src)).blob() : null;
    if (!this.loop || !this.caster?.isReady) return null;
    this.loop.drawNow();
    return new Promise((resolve) => {
      this.canvas.toBlob(resolve, "image/png");
    });
  }

  async screenshot({ id }: ScreenshotRequest) {
    const blob = this.still ? null : await this.picture();
    if (blob) this.messages.send({ type: "screenshot", id }, [await blob.arrayBuffer()]);
  }

  movieFrame(content: MovieFrame, buffers: Bytes[]) {
    if (this.movie?.id !== content.id) {
      this.endMovie();
      try {
        this.movie = new MovieFrames(this, content);
      } catch (error) {
        this.send({ type: "movie_failed", id: content.id, message: String(error) });
        return undefined;
      }
    }
    return this.movie?.draw(content, buffers);
  }

  endMovie() {
    this.movie?.close();
    this.movie = null;
  }

  sendStats(loop: FrameLoop) {
    this.stats = {
      ...measuredBy(loop),
      received: this.sent.received,
      edits: this.link.count + this.spaceLink.count,
      edit_ms: this.link.ms,
    };
    const looked = this.model.get("tissue_check"); // of a page without Python, which looks itself
    this.send({ type: "stats", ...this.stats, ...(looked && { sides: loop.caster.exceededSides(looked) }) });
  }

  touch(held = false) {
    if (this.info) this.elements.follow(this.camera);
    this.spacePoints.draw();
    if (this.loop) this.loop.touch(held);
  }

  close() {
    this.closed = true;
    this.send({ type: "bye" });
    this.messages.close();
    this.endMovie();
    this.link.close();
    this.spaceLink.close();
    this.times.close();
    this.pointer.close();
    this.spacePoints.close();
    this.loader?.close();
    this.loop?.close();
    this.caster?.dispose();
    this.still?.close();
    this.elements.close();
  }
}

function render({ model, el }: { model: Model; el: HTMLElement }) {
  return opened(new LiveVolumeView(model, el));
}

export default { render };
