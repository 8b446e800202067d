// The front end of a volume that Python draws: its pictures and its camera. The volume view's own, and that of a live
// view where a browser cannot draw.
// To Python: hello, size, camera, seen, bye. From Python: frame, notice, badge, trame.

import type { FrameSent, ToServerRenderer, TrameAddress, VolumeViewToFrontEnd } from "../generated.ts";
import { COMPARISONS, LARGEST_SIDE } from "../generated.ts";
import { bytesOf, joinFragments } from "../sync/buffers.ts";
import type { Model, ModelHandler, Vector2 } from "../types.ts";
import { pageElement } from "../ui/dom.ts";
import { pngOf, type SavedPicture, savedCanvas } from "../ui/saved_picture.ts";
import { closerOf } from "../ui/view_parts.ts";
import { VolumeFrontEnd } from "./front_end.ts";
import { addScale } from "./snapshot.ts";
import type { Bytes, VolumeInfo } from "./types.ts";
import type { ViewElements, ViewMessages } from "./view_elements.ts";

const CAMERAS_IN_FLIGHT = 2; // the newest waits until a picture shows one of those before it
const PATIENCE = 700; // milliseconds after which a camera without a picture is given up
const LONG = 12000; // milliseconds without a first picture, after which something is likely to be wrong

export class ServerVolumeView extends VolumeFrontEnd {
  layers: ImageBitmap[] = []; // the latest pictures
  drawn = 0; // their number in Python
  count = 0; // of pictures that have been drawn
  isFull = false;
  number = 0; // of the camera that was sent last
  answered = 0; // and of the one that was drawn last
  sentAt = 0;
  isLate = false; // whether a newer camera is to be sent
  retry = 0;
  sized = ""; // the size that was sent last
  resizing = 0;
  inner: HTMLIFrameElement | null = null;
  waiting: HTMLDivElement;
  greeting: number;

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-volume", "The volume view");
    this.waiting = pageElement("div", "dnb-waiting", this.elements.root, { role: "status" });
    this.wait("Preparing the picture \u2026");
    this.#listen();
    this.readInfo();
    this.size();
    this.takeShows();
    this.greeting = setTimeout(() => {
      if (!this.drawn) this.wait("No picture has arrived yet. Is the kernel running?");
    }, LONG);
  }

  #listen() {
    const { messages } = this;
    messages.on(
      "msg:custom",
      joinFragments((content, buffers) => this.receive(content, buffers)),
    );
    messages.on("change:volume_info", () => this.readInfo());
    messages.on("change:camera", () => this.readCamera());
    messages.on("change:shows", () => this.takeShows());
    messages.on("change:label", () => this.caption());
    for (const name of ["width", "height", "fill", "background"]) messages.on(`change:${name}`, () => this.size());
  }

  setBackground() {
    this.size(); // which has the theme
  }

  flip() {
    this.caption();
    this.paint();
  }

  handleComparison() {
    this.paint();
  }

  async picture({ hasScale }: SavedPicture): Promise<Blob | null> {
    if (!this.drawn) return null;
    const { elements } = this,
      saved = savedCanvas(elements.box),
      context = saved.getContext("2d")!;
    context.imageSmoothingQuality = "high";
    context.drawImage(elements.canvas, 0, 0, saved.width, saved.height);
    if (hasScale) addScale(context, elements);
    return pngOf(saved);
  }

  wait(text: string) {
    this.waiting.textContent = text;
    this.waiting.hidden = !text;
  }

  // -- size, theme, captions -----------------------------------------------------------------------------------------

  size() {
    if (this.closed) return;
    const { background, theme } = this.elements;
    this.elements.root.dataset.background = background;
    const { width, height } = this.elements.fit(),
      within = (n: number) => Math.min(LARGEST_SIDE, Math.max(16, n));
    const now = {
      width: within(width),
      height: within(height),
      background: theme.name,
      ...(this.isFramed && { origin: window.location.origin }),
    }; // our frame may be shown in pages of it
    const sent = JSON.stringify(now);
    if (sent === this.sized) return;
    this.camera.reframe(() => {
      this.elements.canvas.width = now.width;
      this.elements.canvas.height = now.height;
    });
    this.paint();
    this.follow();
    clearTimeout(this.resizing);
    const report = () => {
      if (this.sized) this.messages.send({ type: "size", ...now });
      else this.messages.send({ type: "hello", ...now });
      this.sized = sent;
    };
    // A window that is dragged larger sends it once.
    if (this.sized) this.resizing = setTimeout(report, 120);
    else report();
  }

  /** True if the pictures come by a separate server, to a frame over the canvas that turns them as well. */
  get isFramed() {
    return this.model.get("transport") === "trame";
  }

  frame({ view, url }: TrameAddress) {
    if (view !== this.messages.id || !/^http:\/\/(127\.0\.0\.1|\[::1\]|localhost):\d+\/index\.html\?/.test(url)) return;
    this.inner?.remove();
    this.inner = pageElement("iframe", "dnb-inner", this.elements.root, {
      src: url,
      title: this.elements.canvas.getAttribute("aria-label") ?? "",
    });
    this.elements.root.classList.add("dnb-framed");
    this.drawn = this.drawn || 1;
    this.wait("");
  }

  // -- pictures ------------------------------------------------------------------------------------------------------

  receive(content: VolumeViewToFrontEnd, buffers: Bytes[]) {
    if (content.type === "notice") {
      this.elements.messages.set("notice", String(content.text), { kind: "error" });
      if (!this.drawn) this.wait("");
    }
    if (content.type === "trame") this.frame(content);
    if (content.type === "badge") this.elements.messages.set("folds", String(content.text), { kind: "warning" });
    return content.type === "frame" ? this.receiveFrame(content, buffers) : undefined;
  }

  async receiveFrame({ seq, full, camera, by }: FrameSent, buffers: Bytes[]) {
    if (by === this.messages.id) this.#answer(camera);
    try {
      const made = await Promise.all(
        buffers.map((b) => createImageBitmap(new Blob([bytesOf(b)], { type: "image/jpeg" }))),
      );
      const isOld = this.closed || seq < this.drawn; // a newer one was faster
      for (const bitmap of isOld ? made : this.layers) bitmap.close();
      if (isOld) return;
      this.layers = made;
      this.drawn = seq;
      this.isFull = full;
      this.count += 1;
      this.wait("");
      this.paint();
    } finally {
      if (!this.closed) this.messages.send({ type: "seen", seq });
    }
  }

  paint() {
    const bitmap = this.layers[this.elements.flicker.isOn ? this.elements.flicker.layer : 0] || this.layers[0];
    const context = bitmap && this.elements.canvas.getContext("2d");
    if (!context) return;
    context.imageSmoothingQuality = "high";
    const { width, height } = this.elements.canvas,
      [, original] = this.layers;
    context.drawImage(bitmap, 0, 0, width, height);
    const { share } = this.elements.compare;
    if (!original || !(COMPARISONS as readonly string[]).includes(this.shown)) return;
    const [part, opacity] = this.shown === "wipe" ? [share, 1] : [1, share];
    context.globalAlpha = opacity;
    context.drawImage(original, 0, 0, original.width * part, original.height, 0, 0, width * part, height);
    context.globalAlpha = 1;
  }

  // -- the camera ----------------------------------------------------------------------------------------------------

  readInfo() {
    const info: VolumeInfo | null = this.model.get("volume_info");
    if (!info?.box) {
      this.wait("");
      return;
    }
    this.info = info;
    this.readCamera(true);
  }

  get pixels(): Vector2 {
    return [this.elements.canvas.width, this.elements.canvas.height];
  }

  override cameraRead() {
    this.follow();
  }

  /** Request a picture from the camera, which has moved. */
  touch() {
    this.follow();
    const isGivenUp = performance.now() - this.sentAt > PATIENCE;
    if (this.number - this.answered < CAMERAS_IN_FLIGHT || isGivenUp) this.#sendCamera();
    else this.isLate = true;
    clearTimeout(this.retry);
    this.retry = setTimeout(() => {
      if (this.isLate && !this.closed) this.#sendCamera();
    }, PATIENCE);
  }

  #sendCamera() {
    this.isLate = false;
    this.number += 1;
    this.sentAt = performance.now();
    this.messages.send({ type: "camera", camera: this.camera.trait, number: this.number });
  }

  #answer(number: number) {
    this.answered = Math.max(this.answered, number);
    if (this.isLate) this.#sendCamera();
  }

  override close() {
    for (const timer of [this.greeting, this.resizing, this.retry]) clearTimeout(timer);
    super.close();
    for (const bitmap of this.layers) bitmap.close();
  }
}

/** A front end that cannot draw */
export interface UndrawnView {
  model: Model;
  messages: ViewMessages;
  elements: ViewElements;
}

/**
 * A picture in place of a front end that cannot draw: pictures by Python, or without Python the existing one.
 */
export class StillPicture {
  pictures: ServerVolumeView | null = null; // as soon as Python draws
  after: (() => void) | null = null; // called when a picture is shown
  info: VolumeInfo | null = null;
  image: HTMLImageElement;
  png: Blob | null = null; // the picture itself: a page may forbid to fetch it from its address

  constructor(
    readonly view: UndrawnView,
    readonly why: string,
  ) {
    this.image = pageElement("img", "dnb-still", view.elements.root, { alt: view.model.get("label") || "Volume" });
  }

  /** Request pictures; Python confirms, and draws from then on. */
  request() {
    if (!this.pictures) this.view.messages.send({ type: "still", background: this.view.elements.theme.name });
  }

  /** Call `callback` when there is a picture of the present state; with Python's own pictures immediately. */
  callWhenShown(callback: () => void) {
    if (this.pictures) {
      callback();
      return;
    }
    this.after = callback;
    this.request();
  }

  receive(png: Bytes) {
    URL.revokeObjectURL(this.image.src);
    this.png = new Blob([bytesOf(png)], { type: "image/png" });
    this.image.src = URL.createObjectURL(this.png);
    this.#runCallback();
  }

  /** Replace a front end that cannot draw by Python's pictures. */
  replaceFrontEnd(info: VolumeInfo | null) {
    if (info) this.inform(info);
    if (this.pictures) return;
    const { view } = this,
      { model } = view;
    const part: Model = {
      get: (name) => (name === "volume_info" && this.info) || model.get(name),
      set: (name, value) => model.set(name, value),
      save_changes: () => model.save_changes(),
      on: (name: string, call: ModelHandler) => model.on(name, call),
      off: (name, call) => model.off(name, call),
      widget_manager: model.widget_manager,
      send: (content) => model.send({ type: "drawn", view: view.messages.id, say: content } satisfies ToServerRenderer),
    };
    view.elements.pane.hidden = true;
    this.pictures = new ServerVolumeView(part, view.elements.host);
    this.pictures.elements.messages.set("renderer", this.why);
    closerOf(this.pictures);
    this.#runCallback();
  }

  /** Take the box that Python's pictures show, which is the result's and not always the volume's own. */
  inform(info: VolumeInfo) {
    this.info = info;
    this.pictures?.readInfo();
  }

  #runCallback() {
    const { after } = this;
    this.after = null;
    after?.();
  }

  close() {
    this.pictures?.close();
    this.view.elements.pane.hidden = false;
    URL.revokeObjectURL(this.image.src);
    this.image.remove();
  }
}
