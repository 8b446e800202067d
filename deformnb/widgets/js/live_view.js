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
