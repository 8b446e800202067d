// The page of a live view without its volume: canvas, captions, cube, notice, and the camera. view/live_view.js adds the rest.

import { Camera } from "../maths/camera.js";
import { clipOf, isClipped } from "../maths/clipping.js";
import { OWN_KEYS, pageElement } from "../ui/dom.js";
import { OrientationCube } from "../ui/orientation_cube.js";
import {
  aboutShown, boxCorners, captionsOf, Flicker, Frames, listen, measuredBy, opened, PageTheme, picturesOf, remarksOn,
  sized,
} from "../ui/view_parts.js";
import { MemoryError, NOT_HELD, RayCaster } from "../webgl/raycaster.js";
import { FieldLink, fieldOf } from "./follow_editor.js";
import { StillPicture } from "./pictures.js";
import { TimeLink } from "./playback.js";
import { Hands } from "./pointer.js";
import { FrameLoop } from "./render_loop.js";
import { SpacePoints } from "./space_points.js";
import { floatsOf, VolumeLoader } from "./volume_loader.js";

class VolumePage {
  constructor(model, el) {
    this.model = model;
    this.id = Math.random().toString(36).slice(2, 12);
    this.camera = new Camera();
    this.field = null;
    this.info = null;
    this.still = null; // a StillPicture, where WebGL is missing
    this.handlers = [];
    this.#build(el);
  }

  // -- the page ------------------------------------------------------------------------------------------------------

  #build(el) {
    this.host = el;
    this.root = pageElement("div", "dnb-view", el);
    this.canvas = pageElement("canvas", "dnb-canvas", this.root, { tabindex: "0", role: "img", ...OWN_KEYS });
    this.frames = new Frames(this.root);
    this.cube = new OrientationCube(this.root, (view) => this.showView(view), () => this.reset());
    this.badge = pageElement("div", "dnb-badge", this.root);
    this.progress = pageElement("div", "dnb-progress", this.root, { role: "progressbar", "aria-label": "loading the volume" });
    this.notice = pageElement("div", "dnb-notice", this.root, { role: "status", hidden: "" });
    this.theme = new PageTheme(this.root, () => this.setBackground());
    this.flicker = new Flicker(this.root, (layer) => this.flip(layer));
    this.setBackground();
    this.size();
    this.observer = new ResizeObserver(() => this.size());
    this.observer.observe(this.root);
  }

  size() {
    const [w, h] = sized(this.root, this.host, this.model).map((n) => Math.max(1, n));
    if (this.canvas.width === w && this.canvas.height === h) return;
    this.reframed(() => { this.canvas.width = w; this.canvas.height = h; });
    if (this.loop) { this.loop.again(); this.touch(); }
  }

  get background() {
    const wanted = this.model.get("background");
    return wanted === "auto" ? this.theme.name : wanted;
  }

  setBackground() {
    this.root.dataset.background = this.background;
    if (!this.caster || this.caster.background === this.background) return;
    this.caster.background = this.background;
    this.loop?.again();
    this.touch();
  }

  get shows() { return this.model.get("shows") || "deformed"; }

  setShows() {
    this.reframed(() => { this.shown = this.shows; });
    this.flicker.set(this.shows === "flicker" && Boolean(this.loop));
    this.caption();
    if (this.loop) this.loop.flip(0);
    this.touch();
    this.still?.ask();
  }

  setClip() {
    const clip = clipOf(this.model);
    if (this.caster) this.caster.clip = isClipped(clip) ? clip : null;
    this.touch();
    this.still?.ask();
  }

  caption() {
    this.frames.show(captionsOf(this.shows, this.still ? 0 : this.flicker.layer));
    this.canvas.setAttribute("aria-label", `${this.model.get("label") || "Volume"}${aboutShown(this.shows)}`);
  }

  flip(layer) {
    this.caption();
    if (this.loop) this.loop.flip(layer);
  }

  /** What is seen in a canvas of this size: see FrameLoop. */
  pictures(width, height) {
    return picturesOf(this.shows, width).map((picture) => ({ ...picture, camera: this.seen(picture.width / height) }));
  }

  /** Width by height of one picture. */
  get aspect() { return this.canvas.width / (this.shown === "side_by_side" ? 2 : 1) / this.canvas.height; }

  /** Does what changes the shape of the picture or of the box: the zoom stays, not the scale. */
  reframed(change) {
    const zoom = this.info ? this.camera.fit(this.corners(), this.aspect) / this.camera.height : 0;
    change();
    if (zoom) this.camera.height = this.camera.fit(this.corners(), this.aspect) / zoom;
  }

  /** again: what a button behind the text does. */
  say(text, again = null) {
    this.notice.textContent = text || "";
    this.notice.hidden = !text;
    if (!again) return;
    const button = pageElement("button", "dnb-again", this.notice, { type: "button", ...OWN_KEYS });
    button.textContent = "Try again";
    button.addEventListener("click", again);
  }

  // -- the camera ----------------------------------------------------------------------------------------------------

  get box() { return (this.field && this.field.box) || this.info.box; }

  /** The corners of what is shown, from its middle, in space. */
  corners() {
    return boxCorners(this.box, this.info.axes);
  }

  seen(aspect) {
    const { low, high } = this.box, middle = low.map((l, i) => (l + high[i]) / 2);
    return this.camera.inFrame(this.info.to_frame, middle, aspect);
  }

  readCamera(force = false) {
    // While a hand turns the picture it goes first; what it has done is said when it lets go.
    if (!this.info || (!force && (this.writing || this.hands?.isBusy))) return;
    const wanted = this.model.get("camera") || {};
    this.camera.look(wanted.direction || [0.4, 1, -0.3], wanted.up);
    this.camera.pan = [...(wanted.pan || [0, 0])];
    this.camera.bend = wanted.perspective ? 0.7 : 0;
    this.camera.height = this.camera.fit(this.corners(), this.aspect) / (wanted.zoom || 1);
    this.touch();
  }

  writeCamera() {
    const { direction, up, pan, height } = this.camera;
    this.writing = true; // our own change must not come back as if Python had made it
    this.model.set("camera", { ...this.model.get("camera"), direction, up, pan: [...pan],
      zoom: this.camera.fit(this.corners(), this.aspect) / height });
    this.model.save_changes();
    this.writing = false;
    this.still?.ask();
  }

  showView(view) {
    const { direction, up } = this.info.views[view];
    this.camera.look(direction, up);
    this.seeAll();
  }

  reset() {
    const { direction, up } = this.info.views.home;
    this.camera.look(direction, up);
    this.seeAll();
  }

  seeAll() {
    this.camera.pan = [0, 0];
    this.camera.height = this.camera.fit(this.corners(), this.aspect);
    this.touch();
    this.writeCamera();
  }
}

// The live view: a volume, turned and deformed in the browser. Joined behind the files that deformnb/widgets/view/live_view.py
// names.
// To Python: hello, chunk, still, drawn, screenshot, seen, stats. From Python: chunk, field, drawn, info, screenshot.

const FEWEST = 32 ** 3; // voxels that are still worth a look

class LiveViewPage extends VolumePage {
  constructor(model, el) {
    super(model, el);
    this.values = null;
    this.sent = { received: 0 };
    this.cuts = {}; // distances to the cuts that came last
    this.#listen();
    this.#start();
  }

  // -- start, loss and return of WebGL -------------------------------------------------------------------------------

  #start() {
    try {
      this.caster = new RayCaster(this.canvas);
    } catch (error) {
      this.caster = null;
      this.fall(`Drawn in Python: ${error.message}.`);
    }
    if (this.caster) {
      this.#prepare();
      this.caster.present(null);
    }
    this.hello();
    this.setShows();
    this.setTable();
    this.setInfo();
  }

  /** voxels: how many the card holds at most, where it has been found not to hold all. */
  hello(voxels = null) {
    const { largest = 0, name = "", isSoftware = true } = this.caster || {};
    this.send({ type: "hello", largest, renderer: name, software: isSoftware, background: this.theme.name,
      ...(voxels && { voxels }) });
  }

  /** The card does not hold the volume: Python is asked for half of the voxels, until they are too few to look at. */
  #askForFewer(why) {
    const fewer = Math.floor(this.info.shape.reduce((product, n) => product * n, 1) / 2);
    if (fewer < FEWEST) throw why;
    this.isScarce = true;
    this.loader = null;
    this.values = null;
    this.hello(fewer);
  }

  #prepare() {
    this.loop = new FrameLoop(this.caster, (width, height) => this.pictures(width, height),
      () => ({ target: this.model.get("target_ms"), settle: this.model.get("settle_ms") }), () => this.tell(),
      () => this.link.catchUp());
    this.caster.projection = this.model.get("projection");
    this.caster.background = this.background;
    this.setFolds();
    this.setClip();
  }

  setFolds() { if (this.caster) { this.caster.showFolds = this.model.get("show_folds") ?? true; this.touch(); } }

  /** No WebGL: somebody else has to draw. */
  fall(text) {
    this.say(text);
    this.still ??= new StillPicture(this, text);
    this.flicker.set(false); // a still of it is the deformed volume
    this.caption();
    this.still.ask();
  }

  lost(event) {
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
    this.say("");
    this.caster = null;
    try { this.caster = new RayCaster(this.canvas); } catch (error) { this.fall(`Drawn in Python: ${error.message}.`); return; }
    this.#prepare();
    this.setShows();
    this.setTable();
    if (this.values && this.wasTooMuch) this.#askForFewer(new MemoryError(NOT_HELD));
    else if (this.values) this.upload().catch((error) => this.fail(error));
  }

  // -- what comes from Python ----------------------------------------------------------------------------------------

  send(content) { this.model.send({ view: this.id, ...content }); }

  on(name, handler) { listen(this.model, name, handler, this.handlers, (error) => this.fail(error)); }

  fail(error) { console.error(error); this.say(`The live view has failed: ${error.message || error}`); }

  #listen() {
    this.on("msg:custom", (content, buffers) => this.receive(content, buffers || []));
    this.on("change:volume_info", () => this.setInfo());
    this.on("change:table", () => this.setTable());
    this.on("change:camera", () => this.readCamera());
    this.on("change:projection", () => { if (this.caster) this.caster.projection = this.model.get("projection"); this.touch(); });
    this.on("change:show_folds", () => { this.setFolds(); this.mark(); });
    this.on("change:background", () => this.setBackground());
    this.on("change:shows", () => this.setShows());
    this.on("change:clip", () => this.setClip());
    this.on("change:label", () => this.caption());
    for (const name of ["width", "height", "fill"]) this.on(`change:${name}`, () => this.size());
    this.on("change:editor", () => this.link.follow(this.model.get("editor")));
    this.link = new FieldLink(this.model, (...maps) => this.planarFromLink(...maps), (isMoving) => this.movedByLink(isMoving));
    this.link.follow(this.model.get("editor")).catch((error) => this.fail(error));
    this.times = new TimeLink(this);
    this.on("change:player", () => this.times.follow(this.model.get("player")));
    this.times.follow(this.model.get("player")).catch((error) => this.fail(error));
    this.hands = new Hands(this);
    this.spacePoints = new SpacePoints(this);
  }

  receive(content, buffers) {
    if (content.view && content.view !== this.id) return undefined; // for another page of the same view
    if (content.type === "chunk") return this.receiveChunk(content, buffers[0]);
    if (content.type === "field") return this.receiveField(content, buffers);
    if (content.type === "still") return this.receiveStill(buffers[0]);
    if (content.type === "drawn") return this.still?.drawn(content.info);
    if (content.type === "info") return this.still?.inform(content.info);
    if (content.type === "screenshot") return this.screenshot(content);
    return undefined;
  }

  setInfo() {
    const info = this.model.get("volume_info") || {};
    if (!info.shape) return;
    if (this.info && this.info.id === info.id) return;
    this.info = info;
    this.values = null;
    this.mark();
    this.readCamera(true);
    if (!this.caster) { this.still?.ask(); return; }
    if (this.loader) this.loader.close();
    this.loader = new VolumeLoader(info, (index) => this.send({ type: "chunk", id: info.id, index }),
      (share) => this.setProgress(0.8 * share), (isStuck) => this.setStuck(isStuck));
  }

  setStuck(isStuck) {
    if (!isStuck) { this.say(""); return; }
    this.say("The volume does not come. Is the kernel running?", () => {
      if (!this.field) this.hello();
      this.loader.again();
    });
  }

  mark() { this.badge.textContent = remarksOn(this); }

  setProgress(share) {
    this.progress.style.setProperty("--share", share);
    this.progress.setAttribute("aria-valuenow", Math.round(100 * share));
    this.progress.hidden = share >= 1;
  }

  receiveStill(png) {
    if (!this.still) this.fall(NOT_HELD); // nobody here can make the volume smaller
    this.still.receive(png);
  }

  async receiveChunk(content, packed) {
    const { loader } = this;
    if (!loader || loader.id !== content.id) return;
    this.sent.received += packed.byteLength;
    const values = await loader.receive(content, packed);
    if (!values) return;
    this.values = values;
    await this.upload();
  }

  async upload() {
    const info = this.info, caster = this.caster;
    const frame = () => new Promise((resolve) => { setTimeout(resolve, 0); });
    const { low, high } = info.box;
    const { shape, spacing, outside, grey, share, is_labels: isLabels } = info;
    const tick = (share) => { this.setProgress(0.8 + 0.19 * share); return frame(); };
    const about = { shape, spacing, outside, isLabels, grey, share, box: { low, high }, ownBox: info.box };
    let done = false;
    try {
      done = await caster.setVolume(this.values, about, tick);
    } catch (error) {
      if (!(error instanceof MemoryError)) throw error;
      if (caster === this.caster && info === this.info) this.#askForFewer(error);
      return;
    }
    if (!done || caster !== this.caster) return;
    this.loader = null;
    this.setTable();
    if (!this.field) this.hello(); // lost on its way
    this.applyField();
    this.setProgress(1);
    this.touch();
  }

  setTable() {
    const bytes = this.model.get("table");
    if (!this.caster || !bytes || !bytes.byteLength) return;
    if (this.loader && this.caster.volume) return; // of voxels that are on their way: see upload
    this.caster.setTable(floatsOf(bytes), this.model.get("unit"));
    this.touch();
  }

  receiveField(content, buffers) {
    this.sent.received += buffers.reduce((sum, b) => sum + b.byteLength, 0);
    this.times.drop();
    const field = content.frames ? this.times.take(content, buffers) : fieldOf(content, buffers, this.cuts);
    if (!field) { this.hello(); return; } // which is answered with all of it
    this.reframed(() => { // a larger field of view is seen whole
      this.field = { ...field, planar: this.link.merged(field.planar, content.follow || null) };
    });
    this.mark();
    this.applyField();
    this.touch();
    this.confirm(content.seq);
  }

  /** Python sends the next field when this one is on the screen. */
  confirm(seq) {
    if (!seq) return;
    const tell = () => { if (!this.closed) this.send({ type: "seen", seq }); };
    if (this.still) this.still.then(tell);
    else if (this.loop && this.caster.isReady) this.loop.after.push(tell);
    else tell();
  }

  applyField() {
    const { caster, loop } = this;
    if (!caster || !caster.volume || !this.field || !loop) return;
    loop.apply(() => { // the field of then, which may be a newer one
      if (!caster.volume) return;
      caster.setPlanar(this.field.planar);
      if (caster.space !== this.field.space) caster.setSpace(this.field.space); // an editor moves the planar part only
      caster.volume.box = this.field.box || this.info.box;
      this.mark();
    });
  }

  /** New maps from the editor in this page: no byte goes to Python. */
  planarFromLink(planar, isDrawing) {
    if (!this.field) this.field = { box: null, space: null };
    this.field.planar = planar;
    this.applyField();
    if (!isDrawing && this.caster?.volume) this.touch(this.link.isMoving);
  }

  /** A point is on its way: its maps are made with the next picture, or now if none is drawn here. */
  movedByLink(isMoving) {
    if (!isMoving && this.loop?.held) this.loop.release();
    if (!isMoving) return;
    if (this.loop && this.caster.volume) this.touch(true);
    else this.link.catchUp();
  }

  async screenshot({ id }) {
    if (!this.loop || !this.caster.isReady) return;
    this.loop.drawNow();
    const blob = await new Promise((resolve) => { this.canvas.toBlob(resolve, "image/png"); });
    this.model.send({ view: this.id, type: "screenshot", id }, undefined, [await blob.arrayBuffer()]);
  }

  tell() {
    this.stats = { ...measuredBy(this.loop), received: this.sent.received, edits: this.link.count, edit_ms: this.link.ms };
    this.send({ type: "stats", ...this.stats });
  }

  touch(held = false) {
    if (this.info) { this.frames.write(this.camera, this.info.unit); this.cube.draw(this.info.views, this.camera); }
    this.spacePoints?.draw();
    if (this.loop) this.loop.touch(held);
  }

  close() {
    this.closed = true;
    for (const [name, handler] of this.handlers) this.model.off(name, handler);
    this.link.close();
    this.times.close();
    this.hands.close();
    this.spacePoints.close();
    this.observer.disconnect();
    this.theme.close();
    this.flicker.close();
    if (this.loader) this.loader.close();
    if (this.loop) this.loop.close();
    if (this.caster) this.caster.dispose();
    this.still?.close();
    this.root.remove();
  }
}

function render({ model, el }) { return opened(new LiveViewPage(model, el)); }

export default { render };
