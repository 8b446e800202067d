// Frames of a movie, drawn by the page of a live view: as its screenshots are, but by a ray caster and from a camera of
// their own, so that whoever turns the view meanwhile turns no frame.
// From Python: movie_frame, movie_end. To Python: movie_piece, movie_failed.

import { isClipped } from "../maths/clipping.js";
import { picturesOf } from "../ui/view_parts.js";
import { RayCaster } from "../webgl/raycaster.js";
import { fieldOf } from "./follow_editor.js";
import { FrameLoop } from "./render_loop.js";
import { ViewCamera } from "./view_camera.js";
import { floatsOf } from "./volume_loader.js";

/** @import { Model } from "../types.d.ts" */
/** @import { VolumeData } from "../webgl/types.d.ts" */
/** @import { Bytes, Field, VolumeInfo, VolumeViewLike } from "./types.d.ts" */
/** @import { Message } from "./volume_loader.js" */

const PIECE = 2 ** 18; // bytes in a message: proxies refuse large ones

/**
 * @typedef {object} MovieSource the live view whose volume and colours are drawn
 * @property {Model} model
 * @property {VolumeInfo | null} info
 * @property {Uint8Array | null} values
 * @property {(content: Message, buffers?: ArrayBuffer[]) => void} send
 * @property {(info: VolumeInfo) => VolumeData} about
 */

export class MovieFrames {
  /**
   * @param {MovieSource} view
   * @param {Message} first the first request for a frame: its size and looks are those of all
   */
  constructor(view, { id, size: [width, height], looks }) {
    this.view = view;
    this.id = id;
    this.looks = looks;
    this.canvas = Object.assign(document.createElement("canvas"), { width, height });
    this.caster = new RayCaster(this.canvas);
    const { model, info } = view;
    // What a camera needs of a view, as it is in the movie.
    const like = { info, shown: looks.shows, pixels: [width, height], pointer: { isBusy: false },
      field: /** @type {Field | null} */ (null), model: { get: (/** @type {string} */ name) => looks[name] } };
    this.seen = like;
    this.camera = new ViewCamera(/** @type {VolumeViewLike} */ (/** @type {unknown} */ (like)));
    this.loop = new FrameLoop(this.caster, (w, h) => this.#pictures(w, h), () => ({ target: 0, settle: 0 }), () => {},
      () => {});
    if (looks.shows === "fade") this.loop.mixture = 0.5;
    Object.assign(this.caster, { projection: looks.projection, background: looks.background,
      showFolds: looks.show_folds, occlusion: looks.ambient_occlusion, clip: isClipped(looks.clip) ? looks.clip : null });
    this.caster.setTable(floatsOf(model.get("table")), model.get("unit"));
    this.isReady = this.#load();
  }

  async #load() {
    const { values, info, about } = this.view;
    if (!values || !info) throw new Error("the volume has not come yet");
    const pause = () => new Promise((/** @type {(value: void) => void} */ resolve) => { setTimeout(resolve, 0); });
    await this.caster.setVolume(values, about(info), pause);
  }

  /**
   * @param {number} width
   * @param {number} height
   */
  #pictures(width, height) {
    return picturesOf(this.looks.shows, width).map((picture) => (
      { ...picture, camera: this.camera.seen((picture.whole ?? picture).width / height) }));
  }

  /**
   * Draws a frame and sends its PNG in pieces.
   * @param {Message} content
   * @param {Bytes[]} buffers
   */
  async draw(content, buffers) {
    const { view, id, caster, camera } = this, { index } = content;
    try {
      await this.isReady;
      const field = /** @type {Field} */ (fieldOf(content, buffers, {}));
      this.seen.field = field;
      camera.read(true);
      caster.setPlanar(field.planar);
      caster.setSpace(field.space);
      if (caster.volume) caster.volume.box = camera.box;
      this.loop.drawNow();
      if (caster.gl.isContextLost()) throw new Error("the graphics card has given up");
      const png = await new Promise((/** @type {(blob: Blob | null) => void} */ resolve) => {
        this.canvas.toBlob(resolve, "image/png");
      });
      if (!png) throw new Error("the browser made no picture");
      const bytes = await png.arrayBuffer();
      for (let offset = 0; offset < bytes.byteLength; offset += PIECE) {
        view.send({ type: "movie_piece", id, index, offset, size: bytes.byteLength },
          [bytes.slice(offset, offset + PIECE)]);
      }
    } catch (error) {
      view.send({ type: "movie_failed", id, message: String((error instanceof Error && error.message) || error) });
    }
  }

  close() {
    this.loop.close();
    this.caster.dispose();
  }
}
