// What a view of a volume has, whoever draws it: elements around the picture, and its messages.

import { CompareControls } from "../ui/compare_controls.js";
import { OWN_KEYS, pageElement, saveFile } from "../ui/dom.js";
import { OrientationCube } from "../ui/orientation_cube.js";
import { Theme } from "../ui/theme.js";
import { aboutShown, captionsOf, Flicker, Frames, listen, sized } from "../ui/view_parts.js";

/** @import { Model } from "../types.d.ts" */
/** @import { ViewCamera } from "./view_camera.js" */
/** @import { Message } from "./volume_loader.js" */

const SCREENSHOT = "M2.5 5h2.3l1-1.5h4.4l1 1.5h2.3v8h-11zM8 6.5a2.4 2.4 0 1 1-.01 0";
const FULL_SCREEN = "M2.5 6V2.5H6M10 2.5h3.5V6M13.5 10v3.5H10M6 13.5H2.5V10";

/**
 * @typedef {object} ElementActions what the elements call
 * @property {(view: string) => void} showView  a side of the cube was pressed
 * @property {() => void} rethemed  the page around has another theme
 * @property {(layer: number) => void} flip  the other picture of two in turn is seen
 * @property {() => void} compared  the line between original and deformed was moved, or the slider of their mixture
 * @property {() => void} resized
 * @property {() => Promise<Blob | null>} picture  a PNG of what is seen; null for nothing
 */

/** The canvas and what stands around it: captions, directions, scale, cube, a remark and a notice. */
export class ViewElements {
  /**
   * @param {Model} model
   * @param {HTMLElement} host
   * @param {string} kind  a class of the root
   * @param {ElementActions} actions
   */
  constructor(model, host, kind, actions) {
    this.model = model;
    this.host = host;
    this.root = pageElement("div", `dnb-view ${kind}`, host);
    this.canvas = pageElement("canvas", "dnb-canvas", this.root, { tabindex: "0", role: "img", ...OWN_KEYS });
    this.frames = new Frames(this.root);
    this.followed = ""; // what frames and cube show
    this.frame = 0; // the request of the next one, or 0
    // Of the picture in CSS pixels, as last laid out: asking again lays out the page in every frame of a drag.
    this.box = { width: 0, height: 0 };
    this.cube = new OrientationCube(this.root, actions.showView, () => actions.showView("home"));
    this.cube.addButton("dnb-screenshot", SCREENSHOT, "Save a picture of the view (PNG)",
      () => this.#save(actions.picture).catch((error) => this.showMessage(`The picture could not be saved: ${error.message}`)));
    this.cube.addButton("dnb-full", FULL_SCREEN, "Whole screen", () => {
      if (document.fullscreenElement) document.exitFullscreen();
      else this.root.requestFullscreen();
    });
    this.badge = pageElement("div", "dnb-badge", this.root);
    this.notice = pageElement("div", "dnb-notice", this.root, { role: "status", hidden: "" });
    this.theme = new Theme(this.root, actions.rethemed);
    this.flicker = new Flicker(this.root, actions.flip);
    this.compare = new CompareControls(this.root, actions.compared);
    this.observer = new ResizeObserver(actions.resized);
    this.observer.observe(this.root);
  }

  /** @param {ElementActions["picture"]} picture */
  async #save(picture) {
    const blob = await picture(), label = String(this.model.get("label") || "volume");
    const name = label.replace(/[^\p{L}\p{N}-]+/gu, "_").replace(/^_|_$/g, "");
    if (blob) saveFile(blob, `${name || "volume"}.png`);
    else this.showMessage("There is no picture yet.");
  }

  /** What is shown: a value of the trait. @returns {string} */
  get shows() { return this.model.get("shows") || "deformed"; }

  /** @returns {string} */
  get background() {
    const background = this.model.get("background");
    return background === "auto" ? this.theme.name : background;
  }

  /** Takes the size of the traits, as far as there is room; the picture's own in pixels. */
  fit() {
    const { ratio, ...box } = sized(this.root, this.host, this.model);
    this.box = box;
    return [box.width * ratio, box.height * ratio].map(Math.round);
  }

  /** @param {string} text */
  showMessage(text) {
    this.notice.textContent = text || "";
    this.notice.hidden = !text;
  }

  /** Names what is shown; layer: the one that is seen of two in turn. @param {number} layer */
  caption(layer) {
    this.frames.show(captionsOf(this.shows, layer));
    this.canvas.setAttribute("aria-label", `${this.model.get("label") || "Volume"}${aboutShown(this.shows)}`);
  }

  /**
   * Follows the camera in the next frame.
   * @param {ViewCamera} camera
   */
  follow(camera) {
    if (!this.frame) this.frame = requestAnimationFrame(() => { this.frame = 0; this.#write(camera); });
  }

  /**
   * Where nothing has changed nothing is written: in every frame of an animation it would cost a software renderer more
   * than the volume.
   * @param {ViewCamera} camera
   */
  #write(camera) {
    const { right, up, direction, height, bend, info } = camera, shown = this.frames.frames.map(({ frame }) => frame.hidden);
    const state = JSON.stringify([right, up, direction, height, bend, info, this.box, shown]);
    if (state === this.followed) return;
    this.followed = state;
    this.frames.write(camera, info.unit, this.box);
    this.cube.draw(info.views, camera);
  }

  close() {
    cancelAnimationFrame(this.frame);
    this.observer.disconnect();
    this.theme.close();
    this.flicker.close();
    this.root.remove();
  }
}

/** The traits and messages of a view; other views of its model have other numbers. */
export class ViewMessages {
  /**
   * @param {Model} model
   * @param {(error: unknown) => void} fail  called with the error of a handler
   */
  constructor(model, fail) {
    this.model = model;
    this.fail = fail;
    this.id = Math.random().toString(36).slice(2, 12);
    /** @type {[string, (...given: any[]) => void][]} */
    this.handlers = [];
  }

  /**
   * @param {Message} content
   * @param {ArrayBuffer[]} [buffers]
   */
  send(content, buffers) { this.model.send({ view: this.id, ...content }, undefined, buffers); }

  /**
   * @param {string} name
   * @param {(...given: any[]) => unknown} handler
   */
  on(name, handler) { listen(this.model, name, handler, this.handlers, this.fail); }

  close() { for (const [name, handler] of this.handlers) this.model.off(name, handler); }
}
