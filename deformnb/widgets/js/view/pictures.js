// The page of a volume that Python draws: its pictures, and where the viewer stands. The volume view's own, and that of
// a live view where a browser cannot draw.
// To Python: hello, size, camera, seen, bye. From Python: frame, notice, badge, trame.

import { Camera } from "../maths/camera.js";
import { OWN_KEYS, pageElement } from "../ui/dom.js";
import { OrientationCube } from "../ui/orientation_cube.js";
import { aboutShown, captionsOf, Flicker, Frames, listen, PageTheme, sized } from "../ui/view_parts.js";
import { Hands } from "./pointer.js";
import { SpacePoints } from "./space_points.js";
import { bytesOf } from "./volume_loader.js";

const CAMERAS_IN_FLIGHT = 2; // the newest waits until a picture shows one of those before it
const PATIENCE = 700; // milliseconds after which a camera without a picture is given up
const LONG = 12000; // milliseconds without a first picture, after which something is likely to be wrong

const dataOf = (b) => (b instanceof DataView ? new Uint8Array(b.buffer, b.byteOffset, b.byteLength) : new Uint8Array(b));

export class PicturesPage {
  constructor(model, el) {
    Object.assign(this, { model, host: el, id: Math.random().toString(36).slice(2, 12), camera: new Camera(), info: null,
      layers: [], drawn: 0, count: 0, handlers: [], number: 0, answered: 0, sentAt: 0, later: 0, sized: "" });
    this.loop = { release() {} }; // Python decides when to draw
    this.#build(el);
    this.#listen();
    this.readInfo();
    this.size();
    this.setShows();
    this.ask = setTimeout(() => { if (!this.drawn) this.wait("No picture has come yet. Is the kernel running?"); }, LONG);
  }

  #build(el) {
    this.root = pageElement("div", "dnb-view dnb-volume", el);
    this.canvas = pageElement("canvas", "dnb-canvas", this.root, { tabindex: "0", role: "img", ...OWN_KEYS });
    this.frames = new Frames(this.root);
    this.cube = new OrientationCube(this.root, (view) => this.showView(view), () => this.reset());
    this.waiting = pageElement("div", "dnb-waiting", this.root, { role: "status" });
    this.notice = pageElement("div", "dnb-notice", this.root, { role: "status", hidden: "" });
    this.badge = pageElement("div", "dnb-badge", this.root);
    this.theme = new PageTheme(this.root, () => this.size());
    this.flicker = new Flicker(this.root, () => { this.caption(); this.paint(); });
    this.wait("Preparing the picture \u2026");
    this.observer = new ResizeObserver(() => this.size());
    this.observer.observe(this.root);
  }

  #listen() {
    this.on("msg:custom", (content, buffers) => this.receive(content, buffers || []));
    this.on("change:volume_info", () => this.readInfo());
    this.on("change:camera", () => this.readCamera());
    this.on("change:shows", () => this.setShows());
    this.on("change:label", () => this.caption());
    for (const name of ["width", "height", "fill", "background"]) this.on(`change:${name}`, () => this.size());
    this.hands = new Hands(this);
    this.spacePoints = new SpacePoints(this);
  }

  on(name, handler) { listen(this.model, name, handler, this.handlers, (error) => this.fail(error)); }

  send(content) { this.model.send({ view: this.id, ...content }); }

  say(text) { this.notice.textContent = text || ""; this.notice.hidden = !text; }

  wait(text) { this.waiting.textContent = text; this.waiting.hidden = !text; }

  fail(error) { console.error(error); this.say(`The volume view has failed: ${error.message || error}`); }

  // -- size, theme, captions -----------------------------------------------------------------------------------------

  size() {
    if (this.closed) return;
    const wanted = this.model.get("background");
    this.root.dataset.background = wanted === "auto" ? this.theme.name : wanted;
    const [w, h] = sized(this.root, this.host, this.model).map((n) => Math.min(4096, Math.max(16, n)));
    const now = { width: w, height: h, background: this.theme.name };
    if (this.isFramed) now.origin = window.location.origin; // a frame of ours may be shown in pages of it
    const said = JSON.stringify(now);
    if (said === this.sized) return;
    this.reframed(() => { this.canvas.width = now.width; this.canvas.height = now.height; });
    this.paint();
    this.touchParts();
    clearTimeout(this.resizing);
    const tell = () => { this.send({ type: this.sized ? "size" : "hello", ...now }); this.sized = said; };
    if (this.sized) this.resizing = setTimeout(tell, 120); else tell(); // a window that is dragged larger says it once
  }

  // Whether the pictures come by a server of their own, to a frame over the canvas that turns them as well.
  get isFramed() { return this.model.get("transport") === "trame"; }

  frame({ view, url }) {
    if (view !== this.id || !/^http:\/\/(127\.0\.0\.1|\[::1\]|localhost):\d+\/index\.html\?/.test(url)) return;
    this.inner?.remove();
    this.inner = pageElement("iframe", "dnb-inner", this.root, { src: url, title: this.canvas.getAttribute("aria-label") });
    this.root.classList.add("dnb-framed");
    this.drawn = this.drawn || 1;
    this.wait("");
  }

  get shows() { return this.model.get("shows") || "deformed"; }

  setShows() {
    this.reframed(() => { this.shown = this.shows; });
    this.flicker.set(this.shows === "flicker");
    this.caption();
  }

  caption() {
    this.frames.show(captionsOf(this.shows, this.flicker.layer));
    this.canvas.setAttribute("aria-label", `${this.model.get("label") || "Volume"}${aboutShown(this.shows)}`);
  }

  // -- pictures ------------------------------------------------------------------------------------------------------

  receive(content, buffers) {
    if (content.type === "notice") { this.say(String(content.text)); if (!this.drawn) this.wait(""); }
    if (content.type === "trame") this.frame(content);
    if (content.type === "badge") this.badge.textContent = String(content.text);
    return content.type === "frame" ? this.receiveFrame(content, buffers) : undefined;
  }

  async receiveFrame({ seq, full, camera, by }, buffers) {
    if (by === this.id) this.#answered(camera);
    try {
      const made = await Promise.all(buffers.map((b) => createImageBitmap(new Blob([dataOf(b)], { type: "image/jpeg" }))));
      if (this.closed || seq < this.drawn) { made.forEach((bitmap) => bitmap.close()); return; } // a newer one was faster
      this.layers.forEach((bitmap) => bitmap.close());
      Object.assign(this, { layers: made, drawn: seq, isFull: full, count: this.count + 1 });
      this.wait("");
      this.paint();
    } finally {
      if (!this.closed) this.send({ type: "seen", seq });
    }
  }

  paint() {
    const bitmap = this.layers[this.flicker?.isOn ? this.flicker.layer : 0] || this.layers[0];
    if (!bitmap) return;
    const context = this.canvas.getContext("2d");
    context.imageSmoothingQuality = "high";
    context.drawImage(bitmap, 0, 0, this.canvas.width, this.canvas.height);
  }

  // -- the camera ----------------------------------------------------------------------------------------------------

  get aspect() { return this.canvas.width / (this.shown === "side_by_side" ? 2 : 1) / this.canvas.height; }

  /** The corners of what is shown, from its middle, in space. */
  corners() {
    const { box: { low, high }, axes } = this.info, half = low.map((l, i) => (high[i] - l) / 2);
    return [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((row) => [0, 1, 2].reduce((sum, j) => (
      sum + axes[row][j] * (k & (1 << j) ? half[j] : -half[j])), 0)));
  }

  /** Does what changes the shape of the picture or of the box: the zoom stays, not the scale. */
  reframed(change) {
    const zoom = this.info ? this.camera.fit(this.corners(), this.aspect) / this.camera.height : 0;
    change();
    if (zoom) this.camera.height = this.camera.fit(this.corners(), this.aspect) / zoom;
  }

  readInfo() {
    const info = this.model.get("volume_info") || {};
    if (!info.box) { this.wait(""); return; }
    this.info = info;
    this.readCamera(true);
  }

  readCamera(force = false) {
    // While a hand turns the picture it goes first; what it has done is said when it lets go.
    if (!this.info || (!force && (this.writing || this.hands?.isBusy))) return;
    const wanted = this.model.get("camera") || {};
    this.camera.look(wanted.direction || [0.4, 1, -0.3], wanted.up);
    this.camera.pan = [...(wanted.pan || [0, 0])];
    this.camera.bend = wanted.perspective ? 0.7 : 0;
    this.camera.height = this.camera.fit(this.corners(), this.aspect) / (wanted.zoom || 1);
    this.touchParts();
  }

  get seen() {
    const { direction, up, pan, height } = this.camera;
    return { ...this.model.get("camera"), direction, up, pan: [...pan],
      zoom: this.camera.fit(this.corners(), this.aspect) / height };
  }

  /** Only when a movement has ended: a trait is more than a message. */
  writeCamera() {
    this.writing = true; // our own change must not come back as if Python had made it
    this.model.set("camera", this.seen);
    this.model.save_changes();
    this.writing = false;
  }

  touchParts() {
    if (!this.info) return;
    this.frames.write(this.camera, this.info.unit);
    this.cube.draw(this.info.views, this.camera);
    this.spacePoints?.draw();
  }

  /** The camera has moved. */
  touch() {
    this.touchParts();
    if (this.number - this.answered < CAMERAS_IN_FLIGHT || performance.now() - this.sentAt > PATIENCE) this.#sendCamera();
    else this.isLate = true;
    clearTimeout(this.retry);
    this.retry = setTimeout(() => { if (this.isLate && !this.closed) this.#sendCamera(); }, PATIENCE);
  }

  #sendCamera() {
    this.isLate = false;
    this.number += 1;
    this.sentAt = performance.now();
    this.send({ type: "camera", camera: this.seen, number: this.number });
  }

  #answered(number) {
    this.answered = Math.max(this.answered, number);
    if (this.isLate) this.#sendCamera();
  }

  showView(view) { this.#look(this.info.views[view]); }

  reset() { this.#look(this.info.views.home); }

  #look({ direction, up }) {
    this.camera.look(direction, up);
    this.camera.pan = [0, 0];
    this.camera.height = this.camera.fit(this.corners(), this.aspect);
    this.touchParts();
    this.writeCamera();
  }

  lost() {} // a canvas of pictures has no context that could be lost

  restored() {}

  close() {
    this.closed = true;
    for (const timer of [this.ask, this.resizing, this.retry]) clearTimeout(timer);
    this.send({ type: "bye" });
    for (const [name, handler] of this.handlers) this.model.off(name, handler);
    this.hands.close();
    this.spacePoints.close();
    this.observer.disconnect();
    this.theme.close();
    this.flicker.close();
    this.layers.forEach((bitmap) => bitmap.close());
    this.root.remove();
  }
}

// What is seen in place of a view whose page cannot draw: pictures by Python, or in a page without Python the one it has.

export class StillPicture {
  constructor(page, why) {
    Object.assign(this, { page, why, pictures: null, after: null, info: null });
    this.image = pageElement("img", "dnb-still", page.root, { alt: page.model.get("label") || "Volume" });
  }

  /** Asks whoever is there; Python answers that it draws, and does so from then on. */
  ask() {
    if (!this.pictures) this.page.send({ type: "still", background: this.page.theme.name });
  }

  /** Calls `tell` when what is shown now has a picture; Python's own pictures are no business of a field's. */
  then(tell) {
    if (this.pictures) { tell(); return; }
    this.after = tell;
    this.ask();
  }

  receive(png) {
    URL.revokeObjectURL(this.image.src);
    this.image.src = URL.createObjectURL(new Blob([bytesOf(png)], { type: "image/png" }));
    this.#tell();
  }

  /** Python draws: its page takes the place of the one that cannot. */
  drawn(info) {
    if (info) this.inform(info);
    if (this.pictures) return;
    const { page } = this, { model } = page;
    const part = { get: (name) => (name === "volume_info" && this.info) || model.get(name), set: (name, value) => model.set(name, value),
      save_changes: () => model.save_changes(), on: (name, call) => model.on(name, call),
      off: (name, call) => model.off(name, call), widget_manager: model.widget_manager,
      send: (content) => model.send({ type: "drawn", view: page.id, say: content }) };
    page.root.hidden = true;
    this.pictures = new PicturesPage(part, page.host);
    this.pictures.root.deformnb = this.pictures;
    this.pictures.say(this.why);
    this.#tell();
  }

  /** The box that Python's pictures show, which is the result's and not always the volume's own. */
  inform(info) {
    this.info = info;
    this.pictures?.readInfo();
  }

  #tell() {
    const { after } = this;
    this.after = null;
    after?.();
  }

  close() {
    this.pictures?.close();
    this.page.root.hidden = false;
    URL.revokeObjectURL(this.image.src);
    this.image.remove();
  }
}
