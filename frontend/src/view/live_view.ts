// The live view: a volume, turned and deformed in the browser.
// To Python: hello, chunk, still, drawn, follows, screenshot, seen, stats, bye. From Python: chunk, field, drawn, info, screenshot.
// Frames of movies: see movie_frames.js.

import type { FieldMaps, LiveViewToFrontEnd, ScreenshotRequest } from "../generated.ts";
import { clipOf, isClipped } from "../maths/clipping.ts";
import { floatsOf, joinFragments } from "../sync/buffers.ts";
import type { Model, Vector2 } from "../types.ts";
import type { SavedPicture } from "../ui/saved_picture.ts";
import { closerOf, picturesOf, remarksOn, renderStats } from "../ui/view_parts.ts";
import { RayCaster } from "../webgl/raycaster.ts";
import type { Picture } from "../webgl/types.ts";
import { NOT_HELD } from "../webgl/voxel_textures.ts";
import { VolumeFrontEnd } from "./front_end.ts";
import { LiveField } from "./live_field.ts";
import { Movies } from "./movie_frames.ts";
import { FrameLoop } from "./render_loop.ts";
import { StillPicture } from "./server_view.ts";
import { snapshot } from "./snapshot.ts";
import type { Bytes, VolumeInfo } from "./types.ts";
import { LiveVoxels } from "./voxels.ts";

/** Settings of the ray caster by the names of their traits. */
const CASTER_TRAITS: Record<string, (caster: RayCaster, model: Model) => void> = {
  projection: (caster, model) => {
    caster.projection = model.get("projection");
  },
  show_folds: (caster, model) => {
    caster.showFolds = model.get("show_folds") ?? true;
  },
  ambient_occlusion: (caster, model) => {
    caster.occlusion = model.get("ambient_occlusion") ?? true;
  },
  clip: (caster, model) => {
    const clip = clipOf(model);
    caster.clip = isClipped(clip) ? clip : null;
  },
};

export class LiveVolumeView extends VolumeFrontEnd {
  pixels: Vector2;
  caster: RayCaster | null = null; // null where WebGL is missing
  loop: FrameLoop | null = null;
  still: StillPicture | null = null; // where WebGL is missing
  wasTooMuch = false; // whether the graphics context was lost because of the voxels
  stats: Record<string, number> | null = null; // measurements of the last full picture
  voxels: LiveVoxels;
  shownField: LiveField;
  movies: Movies;

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-live", "The live view");
    const { canvas } = this.elements;
    this.pixels = [canvas.width, canvas.height];
    canvas.addEventListener("webglcontextlost", (event) => this.#handleContextLoss(event));
    canvas.addEventListener("webglcontextrestored", () => this.#handleContextRestore());
    this.voxels = new LiveVoxels(this);
    this.setBackground();
    this.size();
    this.#listen();
    this.shownField = new LiveField(this);
    this.movies = new Movies(this);
    this.#prepare();
    this.caster?.present(null);
    this.hello();
    this.setShows();
    this.setTable();
    this.setInfo();
  }

  /** The voxels, once all have arrived. */
  get values() {
    return this.voxels.values;
  }

  /** The displacement that is shown. */
  get field() {
    return this.shownField?.shown;
  }

  // -- canvas, captions, messages ------------------------------------------------------------------------------------

  size() {
    const { width, height } = this.elements.fit(),
      [w, h] = [Math.max(1, width), Math.max(1, height)];
    if (this.pixels[0] === w && this.pixels[1] === h) return;
    this.camera.reframe(() => {
      this.pixels = [w, h];
    });
    this.caster?.resize(w, h);
    if (this.loop) {
      this.loop.screen.again();
      this.touch();
    }
  }

  setBackground() {
    const { background } = this.elements;
    this.elements.root.dataset.background = background;
    if (!this.caster || this.caster.background === background) return;
    this.caster.background = background;
    this.loop?.screen.again();
    this.touch();
  }

  setShows() {
    this.takeShows(this.loop !== null);
    this.#setMixture();
    this.loop?.flip(0);
    this.touch();
    this.still?.request();
  }

  /** The line or the slider between original and deformed was moved. */
  handleComparison() {
    if (this.elements.shows !== "fade") {
      this.touch();
      return;
    }
    this.#setMixture();
    this.loop?.screen.again(); // both are drawn
  }

  #setMixture() {
    if (this.loop) this.loop.screen.mixture = this.elements.shows === "fade" ? this.elements.compare.share : null;
  }

  flip(layer: number) {
    this.caption();
    if (this.loop) this.loop.flip(layer);
  }

  /** The pictures that fill a canvas of this size. */
  pictures(width: number, height: number): Picture[] {
    const pictures = picturesOf(this.elements.shows, width, this.elements.compare.share);
    return pictures.map((picture) => ({
      ...picture,
      camera: this.camera.forAspect((picture.whole ?? picture).width / height),
    }));
  }

  mark() {
    const { caster, field, info, voxels } = this;
    const remarks = remarksOn({ caster, field, info, isScarce: voxels.isScarce });
    for (const [source, kind, text] of remarks) this.elements.messages.set(source, text, { kind });
  }

  // -- the camera ----------------------------------------------------------------------------------------------------

  override handleRest() {
    this.still?.request();
  }

  // -- start, loss and return of WebGL -------------------------------------------------------------------------------

  /** Begin to draw; without WebGL Python draws. */
  #prepare() {
    this.caster = null;
    try {
      this.caster = new RayCaster(this.elements.canvas);
    } catch (error) {
      this.fall(`Drawn in Python: ${(error as Error).message}.`);
      return;
    }
    const { caster, model } = this;
    caster.resize(...this.pixels);
    caster.background = this.elements.background;
    for (const apply of Object.values(CASTER_TRAITS)) apply(caster, model);
    this.loop = new FrameLoop(
      caster,
      (width, height) => this.pictures(width, height),
      () => ({ target: model.get("target_ms"), settle: model.get("settle_ms") }),
      (loop) => this.sendStats(loop),
      () => this.shownField.catchUp(),
    );
  }

  /** @param voxels the most that the GPU holds, where it has been found not to hold all */
  hello(voxels = 0) {
    const { caster } = this;
    this.messages.send({
      type: "hello",
      largest: caster?.gpu.largest ?? 0,
      renderer: caster?.gpu.name ?? "",
      software: caster?.gpu.isSoftware ?? true,
      background: this.elements.theme.name,
      ...(voxels > 0 && { voxels }),
    });
  }

  /** Switch to Python's pictures, as there is no WebGL. */
  fall(text: string) {
    this.elements.messages.set("renderer", text);
    this.still ??= new StillPicture(this, text);
    this.elements.flicker.set(false); // a still of it is the deformed volume
    this.elements.compare.set(""); // and of these it has the line in the middle, or half of each
    this.caption();
    this.still.request();
  }

  #handleContextLoss(event: Event) {
    event.preventDefault(); // else the context is never restored
    if (this.closed) return;
    if (this.loop) this.loop.close();
    this.loop = null;
    this.wasTooMuch = Boolean(this.caster?.voxels.volume && !this.caster.voxels.volume.loaded); // lost by the latest data
    this.fall("Drawn in Python until the lost graphics context comes back.");
  }

  #handleContextRestore() {
    if (this.closed) return;
    this.still?.close();
    this.still = null;
    this.elements.messages.set("renderer", "");
    this.#prepare();
    if (!this.caster) return;
    this.setShows();
    this.setTable();
    const { info, values, voxels } = this;
    if (!values || !info) return;
    if (this.wasTooMuch) voxels.requestFewer(info.shape);
    else voxels.upload(info, values).catch((error) => this.fail(error));
  }

  // -- messages and traits -------------------------------------------------------------------------------------------

  #listen() {
    this.messages.on(
      "msg:custom",
      joinFragments((content, buffers) => this.receive(content, buffers)),
    );
    this.messages.on("change:volume_info", () => this.setInfo());
    this.messages.on("change:table", () => this.setTable());
    this.messages.on("change:camera", () => this.readCamera());
    for (const [name, apply] of Object.entries(CASTER_TRAITS)) {
      this.messages.on(`change:${name}`, () => {
        if (this.caster) apply(this.caster, this.model);
        this.mark();
        this.touch();
        this.still?.request();
      });
    }
    this.messages.on("change:background", () => this.setBackground());
    this.messages.on("change:shows", () => this.setShows());
    this.messages.on("change:label", () => this.caption());
    for (const name of ["width", "height", "fill"]) this.messages.on(`change:${name}`, () => this.size());
  }

  /** Take a message of Python, or the picture of a page without Python. */
  receive(content: LiveViewToFrontEnd | { type: "still" }, buffers: Bytes[]) {
    if ("view" in content && content.view && content.view !== this.messages.id) return undefined; // for another front end of the same view
    if (content.type === "chunk") return this.voxels.receive(content, buffers[0]!);
    if (content.type === "field") return this.receiveField(content, buffers);
    if (content.type === "still") {
      if (!this.still) this.fall(NOT_HELD); // no Python that could make the volume smaller
      return this.still?.receive(buffers[0]!);
    }
    if (content.type === "drawn") return this.still?.replaceFrontEnd(content.info as unknown as VolumeInfo);
    if (content.type === "info") return this.still?.inform(content.info as unknown as VolumeInfo);
    if (content.type === "screenshot") return this.screenshot(content);
    if (content.type === "movie_frame") return this.movies.draw(content, buffers);
    if (content.type === "movie_end") return this.movies.close();
    return undefined;
  }

  setInfo() {
    const info: VolumeInfo | null = this.model.get("volume_info");
    if (!info?.shape || this.info?.id === info.id) return;
    this.info = info;
    this.voxels.drop();
    this.mark();
    this.readCamera(true);
    if (this.caster) this.voxels.load(info);
    else this.still?.request();
  }

  /** All voxels are on the GPU. */
  handleUpload() {
    if (!this.field) this.hello(); // lost in transit
    this.shownField.apply();
    this.touch();
  }

  setTable() {
    const bytes: Bytes | null = this.model.get("table");
    if (!this.caster || !bytes?.byteLength) return;
    if (this.voxels.loader && this.caster.voxels.volume) return; // of voxels in flight: see upload
    this.caster.voxels.setTable(floatsOf(bytes), this.model.get("unit"));
    this.touch();
  }

  receiveField(content: FieldMaps, buffers: Bytes[]) {
    const found = this.shownField.receive(content, buffers);
    if (found === "missing")
      this.hello(); // which is answered with all of it
    else this.confirm(content.seq, found === "same");
  }

  /** Let Python send the next field when this one is being drawn: so it computes that while the GPU draws this. */
  confirm(seq: number | undefined, isDrawn: boolean) {
    if (!seq) return;
    const confirm = () => {
      if (!this.closed) this.messages.send({ type: "seen", seq });
    };
    if (this.still) this.still.callWhenShown(confirm);
    else if (this.loop && this.caster?.isReady && !isDrawn) this.loop.begun.push(confirm);
    else confirm();
  }

  async picture(wanted: SavedPicture): Promise<Blob | null> {
    if (this.still) return this.still.png;
    const { caster, elements, loop } = this;
    return loop && caster?.isReady ? snapshot({ caster, elements, loop }, wanted) : null;
  }

  /** What is on the screen as a PNG, drawn in full. */
  async #drawnPicture(): Promise<Blob | null> {
    if (!this.loop || !this.caster?.isReady) return null;
    this.loop.drawNow();
    return new Promise((resolve) => {
      this.elements.canvas.toBlob(resolve, "image/png");
    });
  }

  async screenshot({ id }: ScreenshotRequest) {
    const blob = this.still ? null : await this.#drawnPicture();
    if (blob) this.messages.send({ type: "screenshot", id }, [await blob.arrayBuffer()]);
  }

  sendStats(loop: FrameLoop) {
    const { link, spaceLink } = this.shownField;
    this.elements.root.removeAttribute("data-drawing");
    this.stats = {
      ...renderStats(loop),
      received: this.voxels.received + this.shownField.received,
      edits: link.count + spaceLink.count,
      edit_ms: link.ms,
    };
    this.messages.send({ type: "stats", ...this.stats });
  }

  touch(held = false) {
    this.follow();
    if (this.loop && this.caster?.voxels.volume) this.elements.root.toggleAttribute("data-drawing", true);
    this.loop?.touch(held);
  }

  override release() {
    this.loop?.release();
  }

  override close() {
    for (const part of [this.movies, this.shownField, this.voxels.loader, this.loop, this.still]) part?.close();
    this.caster?.dispose();
    super.close();
  }
}

function render({ model, el }: { model: Model; el: HTMLElement }) {
  return closerOf(new LiveVolumeView(model, el));
}

export default { render };
