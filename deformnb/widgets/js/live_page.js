// The page of a live view without its volume: canvas, captions, cube, notice, and the camera. live_view.js adds the rest.

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
