// The live view: a volume, turned and deformed in the browser. Joined behind the files that deformnb/widgets/live_view.py
// names.
// To Python: hello, chunk, still, screenshot, stats. From Python: chunk, field, still, screenshot.

const IN_FLIGHT = 2; // pieces of the volume on their way at once: the second hides the round trip of the first
const VIEW_NAMES = { "+y": "A", "-y": "P", "-x": "L", "+x": "R", "-z": "S", "+z": "I" };
const VIEW_TITLES = { A: "from the front", P: "from behind", L: "from the left", R: "from the right", S: "from above",
  I: "from below" };

const bytesOf = (b) => (b instanceof DataView ? new Uint8Array(b.buffer, b.byteOffset, b.byteLength) : new Uint8Array(b));
// A copy: the buffer of a message may start at an odd place, which a Float32Array refuses.
const floatsOf = (b) => new Float32Array(bytesOf(b).slice().buffer);

async function unpacked(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function element(tag, className, parent, attributes = {}) {
  const made = document.createElement(tag);
  made.className = className;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  parent.append(made);
  return made;
}

class LiveViewPage {
  constructor(model, el) {
    this.model = model;
    this.id = Math.random().toString(36).slice(2, 12);
    this.camera = new Camera();
    this.field = null;
    this.values = null;
    this.info = null;
    this.sent = { received: 0 };
    this.handlers = [];
    this.#build(el);
    this.#listen();
    this.#start();
  }

  // -- the page ------------------------------------------------------------------------------------------------------

  #build(el) {
    this.root = element("div", "dnb-view", el);
    this.canvas = element("canvas", "dnb-canvas", this.root, { tabindex: "0", role: "img" });
    this.letters = ["left", "right", "top", "bottom"].map((s) => element("span", `dnb-letter dnb-${s}`, this.root));
    this.bar = element("div", "dnb-bar", this.root, { role: "toolbar", "aria-label": "view direction" });
    for (const [view, letter] of Object.entries(VIEW_NAMES)) {
      const button = element("button", "dnb-button", this.bar, { type: "button", title: `${VIEW_TITLES[letter]} (${view})`,
        "aria-label": `view ${VIEW_TITLES[letter]}` });
      button.textContent = letter;
      button.addEventListener("click", () => this.showView(view));
    }
    const home = element("button", "dnb-button", this.bar, { type: "button", title: "reset (0 or double click)",
      "aria-label": "reset the view" });
    home.textContent = "\u27f2";
    home.addEventListener("click", () => this.reset());
    this.badge = element("div", "dnb-badge", this.root);
    this.progress = element("div", "dnb-progress", this.root, { role: "progressbar", "aria-label": "loading the volume" });
    this.notice = element("div", "dnb-notice", this.root, { role: "status", hidden: "" });
    this.size();
    this.observer = new ResizeObserver(() => this.size());
    this.observer.observe(this.root);
  }

  size() {
    const width = this.model.get("width"), height = this.model.get("height");
    this.root.style.width = `${width}px`;
    this.root.style.aspectRatio = `${width} / ${height}`;
    this.root.dataset.background = this.model.get("background");
    this.canvas.setAttribute("aria-label", this.model.get("label") || "Volume");
    const ratio = Math.min(2, window.devicePixelRatio || 1), box = this.root.getBoundingClientRect();
    const w = Math.max(1, Math.round((box.width || width) * ratio)), h = Math.max(1, Math.round((box.height || height) * ratio));
    if (this.canvas.width === w && this.canvas.height === h) return;
    this.canvas.width = w;
    this.canvas.height = h;
    if (this.loop) { this.loop.again(); this.touch(); }
  }

  get aspect() { return this.canvas.width / this.canvas.height; }

  say(text) {
    this.notice.textContent = text || "";
    this.notice.hidden = !text;
  }

  // -- start, loss and return of WebGL -------------------------------------------------------------------------------

  #start() {
    try {
      this.caster = new RayCaster(this.canvas);
    } catch (error) {
      this.caster = null;
      this.fall(`No live view: ${error.message}. A still picture made by Python is shown.`);
    }
    if (this.caster) {
      this.loop = new FrameLoop(this.caster, (aspect) => this.seen(aspect),
        () => ({ target: this.model.get("target_ms"), settle: this.model.get("settle_ms") }), () => this.tell());
      this.caster.projection = this.model.get("projection");
      this.caster.background = this.model.get("background");
      this.caster.present(null);
    }
    this.send({ type: "hello", largest: this.caster ? this.caster.largest : 0, renderer: this.caster ? this.caster.name : "",
      software: this.caster ? this.caster.isSoftware : true });
    this.setTable();
    this.setInfo();
  }

  /** No WebGL: a message and a picture that Python renders, anew for every button pressed. */
  fall(text) {
    this.say(text);
    if (!this.still) this.still = element("img", "dnb-still", this.root, { alt: this.model.get("label") || "Volume" });
    this.askStill();
  }

  askStill() { this.send({ type: "still", width: this.model.get("width"), height: this.model.get("height") }); }

  lost(event) {
    event.preventDefault(); // else it never comes back
    if (this.closed) return;
    if (this.loop) this.loop.close();
    this.loop = null;
    this.fall("The graphics context was lost. A still picture made by Python is shown until it comes back.");
  }

  restored() {
    if (this.closed) return;
    if (this.still) { this.still.remove(); this.still = null; }
    this.say("");
    this.caster = null;
    try { this.caster = new RayCaster(this.canvas); } catch (error) { this.fall(`No live view: ${error.message}.`); return; }
    this.loop = new FrameLoop(this.caster, (aspect) => this.seen(aspect),
      () => ({ target: this.model.get("target_ms"), settle: this.model.get("settle_ms") }), () => this.tell());
    this.caster.projection = this.model.get("projection");
    this.caster.background = this.model.get("background");
    this.setTable();
    if (this.values) this.upload();
  }

  // -- what comes from Python ----------------------------------------------------------------------------------------

  send(content) { this.model.send({ view: this.id, ...content }); }

  on(name, handler) {
    const guarded = (...args) => {
      try {
        const result = handler(...args);
        if (result && result.catch) result.catch((error) => this.fail(error));
      } catch (error) { this.fail(error); }
    };
    this.model.on(name, guarded);
    this.handlers.push([name, guarded]);
  }

  fail(error) { console.error(error); this.say(`The live view has failed: ${error.message || error}`); }

  #listen() {
    this.on("msg:custom", (content, buffers) => this.receive(content, buffers || []));
    this.on("change:volume_info", () => this.setInfo());
    this.on("change:table", () => this.setTable());
    this.on("change:camera", () => this.readCamera());
    this.on("change:projection", () => { if (this.caster) this.caster.projection = this.model.get("projection"); this.touch(); });
    this.on("change:background", () => { this.size(); if (this.caster) this.caster.background = this.model.get("background"); this.touch(); });
    for (const name of ["width", "height", "label"]) this.on(`change:${name}`, () => this.size());
    this.on("change:editor", () => this.link.follow(this.model.get("editor")));
    this.link = new FieldLink(this.model, (planar) => { this.planarFromLink(planar); });
    this.link.follow(this.model.get("editor")).catch((error) => this.fail(error));
    this.hands = new Hands(this);
  }

  receive(content, buffers) {
    if (content.view && content.view !== this.id) return undefined; // for another page of the same view
    if (content.type === "chunk") return this.receiveChunk(content, buffers[0]);
    if (content.type === "field") return this.receiveField(content, buffers);
    if (content.type === "still") return this.receiveStill(buffers[0]);
    if (content.type === "screenshot") return this.screenshot(content);
    return undefined;
  }

  setInfo() {
    const info = this.model.get("volume_info") || {};
    if (!info.shape) { this.badge.textContent = ""; return; }
    if (this.info && this.info.id === info.id) return;
    this.info = info;
    this.values = null;
    this.badge.textContent = info.note || "";
    this.readCamera(true);
    if (!this.caster) { this.askStill(); return; }
    this.arrived = 0;
    this.asked = 0;
    this.incoming = new Uint8Array(info.shape[0] * info.shape[1] * info.shape[2]);
    this.setProgress(0);
    while (this.asked < Math.min(IN_FLIGHT, info.chunks)) this.askChunk();
  }

  askChunk() { this.send({ type: "chunk", id: this.info.id, index: this.asked++ }); }

  setProgress(share) {
    this.progress.style.setProperty("--share", share);
    this.progress.setAttribute("aria-valuenow", Math.round(100 * share));
    this.progress.hidden = share >= 1;
  }

  async receiveChunk({ id, index, start }, packed) {
    const info = this.info;
    if (!info || info.id !== id || index !== Math.floor(index)) return; // of a volume that is shown no longer
    this.sent.received += packed.byteLength;
    const voxels = await unpacked(bytesOf(packed));
    if (this.info !== info) return;
    this.incoming.set(voxels, start);
    this.arrived += 1;
    this.setProgress(0.8 * this.arrived / info.chunks);
    if (this.asked < info.chunks) this.askChunk();
    if (this.arrived === info.chunks) { this.values = this.incoming; this.incoming = null; await this.upload(); }
  }

  async upload() {
    const info = this.info, caster = this.caster;
    const frame = () => new Promise((resolve) => { setTimeout(resolve, 0); });
    const { low, high } = info.box;
    const done = await caster.setVolume(this.values, { shape: info.shape, spacing: info.spacing, outside: info.outside,
      isLabels: info.is_labels, grey: info.grey, box: { low, high } },
    (share) => { this.setProgress(0.8 + 0.19 * share); return frame(); });
    if (!done || caster !== this.caster) return;
    this.applyField();
    this.setProgress(1);
    this.touch();
  }

  setTable() {
    const bytes = this.model.get("table");
    if (!this.caster || !bytes || !bytes.byteLength) return;
    this.caster.setTable(floatsOf(bytes), this.model.get("unit"));
    this.touch();
  }

  receiveField(content, buffers) {
    const [maps, weights, space] = content.planar ? [buffers[0], buffers[1], buffers[2]] : [null, null, buffers[0]];
    this.sent.received += buffers.reduce((sum, b) => sum + b.byteLength, 0);
    // A larger field of view is seen whole: the zoom stays, not the scale.
    const zoom = this.info ? this.camera.fit(this.corners(), this.aspect) / this.camera.height : 0;
    this.field = {
      box: content.box,
      planar: content.planar ? { ...content.planar, maps: floatsOf(maps), weights: floatsOf(weights) } : null,
      space: content.space ? { ...content.space, values: floatsOf(space) } : null,
    };
    this.link.base = this.field.planar;
    this.applyField();
    this.link.again();
    if (zoom) this.camera.height = this.camera.fit(this.corners(), this.aspect) / zoom;
    this.touch();
  }

  applyField() {
    if (!this.caster || !this.caster.volume || !this.field) return;
    this.caster.setPlanar(this.field.planar);
    this.caster.setSpace(this.field.space);
    this.caster.volume.box = this.field.box || this.info.box;
  }

  /** New maps from the editor in this page: no byte goes to Python. */
  planarFromLink(planar) {
    if (!this.field) this.field = { box: null, space: null };
    this.field.planar = planar;
    if (this.caster && this.caster.volume) { this.caster.setPlanar(planar); this.touch(this.link.isMoving); }
  }

  receiveStill(png) {
    if (!this.still) return;
    URL.revokeObjectURL(this.still.src);
    this.still.src = URL.createObjectURL(new Blob([bytesOf(png)], { type: "image/png" }));
  }

  async screenshot({ id }) {
    if (!this.loop || !this.caster.isReady) return;
    this.loop.drawNow();
    const blob = await new Promise((resolve) => { this.canvas.toBlob(resolve, "image/png"); });
    this.model.send({ view: this.id, type: "screenshot", id }, undefined, [await blob.arrayBuffer()]);
  }

  tell() {
    const { drag, full, passes, frames } = this.loop.times, sorted = [...drag].sort((a, b) => a - b);
    this.stats = { drag_ms: sorted[sorted.length >> 1] || 0, full_ms: full, passes, frames,
      scale: this.loop.scale, width: this.canvas.width, height: this.canvas.height, received: this.sent.received,
      edits: this.link.count, edit_ms: this.link.ms };
    this.send({ type: "stats", ...this.stats });
  }

  // -- the camera ----------------------------------------------------------------------------------------------------

  get box() { return (this.field && this.field.box) || this.info.box; }

  /** The corners of what is shown, from its middle, in space. */
  corners() {
    const { low, high } = this.box, half = low.map((l, i) => (high[i] - l) / 2), axes = this.info.axes;
    return [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((row) => [0, 1, 2].reduce((sum, j) => (
      sum + axes[row][j] * (k & (1 << j) ? half[j] : -half[j])), 0)));
  }

  seen(aspect) {
    const { low, high } = this.box, middle = low.map((l, i) => (l + high[i]) / 2);
    return this.camera.inFrame(this.info.to_frame, middle, aspect);
  }

  readCamera(force = false) {
    if (!this.info || (!force && this.writing)) return;
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
    if (this.still) this.askStill();
  }

  showView(view) {
    const { direction, up } = this.info.views[view];
    this.camera.look(direction, up);
    this.reframe();
  }

  reset() {
    const { direction, up } = this.info.views.home;
    this.camera.look(direction, up);
    this.reframe();
  }

  reframe() {
    this.camera.pan = [0, 0];
    this.camera.height = this.camera.fit(this.corners(), this.aspect);
    this.touch();
    this.writeCamera();
  }

  touch(held = false) {
    if (this.info) this.drawLetters();
    if (this.loop) this.loop.touch(held);
  }

  drawLetters() {
    const right = this.camera.right, { up } = this.camera;
    const texts = [sideOf(scaled(right, -1)), sideOf(right), sideOf(up), sideOf(scaled(up, -1))];
    this.letters.forEach((letter, i) => { letter.textContent = texts[i]; });
  }

  close() {
    this.closed = true;
    for (const [name, handler] of this.handlers) this.model.off(name, handler);
    this.link.close();
    this.hands.close();
    this.observer.disconnect();
    if (this.loop) this.loop.close();
    if (this.caster) this.caster.dispose();
    if (this.still) URL.revokeObjectURL(this.still.src);
    this.root.remove();
  }
}

function render({ model, el }) {
  const page = new LiveViewPage(model, el);
  page.root.deformnb = page; // for tests and for whoever looks into the page
  return () => page.close();
}

export default { render };
