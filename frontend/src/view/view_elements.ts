// The parts of a view of a volume for any renderer: elements around the picture, and its traits and messages to Python.

import type { LiveViewToPython, VolumeViewToPython } from "../generated.ts";
import type { Handlers, Model, ModelHandler, Without } from "../types.ts";
import { CompareControls } from "../ui/compare_controls.ts";
import { canFillScreen, fillScreen, OWN_KEYS, pageElement } from "../ui/dom.ts";
import { MessageRow } from "../ui/messages.ts";
import { OrientationCube } from "../ui/orientation_cube.ts";
import { type SavedPicture, SavedPictureMenu } from "../ui/saved_picture.ts";
import { Theme } from "../ui/theme.ts";
import {
  altText,
  captionsOf,
  Flicker,
  Frames,
  listen,
  type Shows,
  stageSize,
  type ViewName,
} from "../ui/view_parts.ts";
import type { Background } from "../webgl/raycaster.ts";
import type { ViewCamera } from "./view_camera.ts";

const SCREENSHOT = "M2.5 5h2.3l1-1.5h4.4l1 1.5h2.3v8h-11zM8 6.5a2.4 2.4 0 1 1-.01 0";
const FULL_SCREEN = "M2.5 6V2.5H6M10 2.5h3.5V6M13.5 10v3.5H10M6 13.5H2.5V10";

/** Callbacks of the elements */
export interface ElementActions {
  /** A side of the cube was pressed */
  showView: (view: ViewName) => void;
  /** The host page has changed its theme */
  rethemed: () => void;
  /** The other one of two alternating pictures is visible */
  flip: (layer: number) => void;
  /** The line between original and deformed was moved, or the slider of their mixture */
  handleComparison: () => void;
  resized: () => void;
  /** The picture that the camera button saves, as a PNG; null for none */
  picture: (wanted: SavedPicture) => Promise<Blob | null>;
}

/** The canvas, the elements over it (captions, directions, scale, cube), and below it a row of messages. */
export class ViewElements {
  pane: HTMLDivElement; // of the root and the row
  root: HTMLDivElement;
  canvas: HTMLCanvasElement;
  frames: Frames;
  followed = ""; // what frames and cube show
  frame = 0; // the request of the next one, or 0
  box: { width: number; height: number };
  cube: OrientationCube;
  messages: MessageRow;
  theme: Theme;
  flicker: Flicker;
  compare: CompareControls;
  observer: ResizeObserver;

  /** @param kind a class of the root */
  constructor(
    readonly model: Model,
    readonly host: HTMLElement,
    kind: string,
    actions: ElementActions,
  ) {
    host.classList.add("dnb-view-host");
    this.pane = pageElement("div", "dnb-view-pane", host);
    this.root = pageElement("div", `dnb-view ${kind}`, this.pane);
    this.messages = new MessageRow(this.pane);
    this.canvas = pageElement("canvas", "dnb-canvas", this.root, { tabindex: "0", role: "img", ...OWN_KEYS });
    this.frames = new Frames(this.root);
    // Of the picture in CSS pixels, as last laid out: measuring again lays out the page in every frame of a drag.
    this.box = { width: 0, height: 0 };
    this.cube = new OrientationCube(this.root, actions.showView, () => actions.showView("home"));
    const camera = this.cube.addButton("dnb-screenshot", SCREENSHOT, "Save a picture of the view (PNG)", () =>
      pictures.toggle(),
    );
    const pictures: SavedPictureMenu = new SavedPictureMenu(
      camera,
      this.root,
      () => String(this.model.get("label") || "volume"),
      actions.picture,
      (message) => this.messages.set("picture", message, { kind: "error" }),
    );
    if (canFillScreen())
      this.cube.addButton("dnb-full", FULL_SCREEN, "Full screen", async () => {
        const isDone = await fillScreen(this.pane);
        this.messages.set("screen", isDone ? "" : "The browser refused full screen", { kind: "error" });
      });
    this.theme = new Theme(this.root, actions.rethemed);
    this.flicker = new Flicker(this.root, actions.flip);
    this.compare = new CompareControls(this.root, actions.handleComparison);
    this.observer = new ResizeObserver(actions.resized);
    this.observer.observe(this.root);
  }

  /** The mode of comparison: a value of the trait. */
  get shows(): Shows {
    return this.model.get("shows") || "deformed";
  }

  get background(): Background {
    const background: Background | "auto" = this.model.get("background");
    return background === "auto" ? this.theme.name : background;
  }

  /** Take the size of the traits, as far as there is room; the picture's own in pixels. */
  fit() {
    const { ratio, ...box } = stageSize(this.root, this.host, this.model);
    this.box = box;
    return { width: Math.round(box.width * ratio), height: Math.round(box.height * ratio) };
  }

  /** Caption the pictures; layer: the visible one of two alternating ones. */
  caption(layer: number) {
    this.frames.show(captionsOf(this.shows, layer));
    this.canvas.setAttribute("aria-label", `${this.model.get("label") || "Volume"}${altText(this.shows)}`);
  }

  /** Follow the camera in the next frame. */
  follow(camera: ViewCamera) {
    if (!this.frame)
      this.frame = requestAnimationFrame(() => {
        this.frame = 0;
        this.#write(camera);
      });
  }

  /**
   * Only changes are written: in every frame of an animation it would cost a software renderer more
   * than the volume.
   */
  #write(camera: ViewCamera) {
    const { right, up, direction, height, bend, info } = camera,
      shown = this.frames.frames.map(({ frame }) => frame.hidden);
    const state = JSON.stringify([right, up, direction, height, bend, info, this.box, shown]);
    if (state === this.followed) return;
    this.followed = state;
    this.frames.write(camera, info.unit, this.box, info.anatomical);
    this.cube.draw(info.views, camera, info.anatomical);
  }

  close() {
    cancelAnimationFrame(this.frame);
    this.observer.disconnect();
    this.theme.close();
    this.flicker.close();
    this.messages.close();
    this.pane.remove();
  }
}

/** The traits and messages of a view; other views of its model have other numbers. */
export class ViewMessages {
  id: string;
  handlers: Handlers = [];

  /** @param fail called with the error of a handler */
  constructor(
    readonly model: Model,
    readonly fail: (error: unknown) => void,
  ) {
    this.id = Math.random().toString(36).slice(2, 12);
  }

  send(content: Without<LiveViewToPython | VolumeViewToPython, "view">, buffers?: ArrayBuffer[]) {
    this.model.send({ view: this.id, ...content }, undefined, buffers);
  }

  on(name: string, handler: (...given: Parameters<ModelHandler>) => unknown) {
    listen(this.model, name, handler, this.handlers, this.fail);
  }

  close() {
    for (const [name, handler] of this.handlers) this.model.off(name, handler);
  }
}
