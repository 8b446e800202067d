// The front end of a volume, for any renderer: its elements, messages, camera, pointer and points in space.

import type { Model, Vector2 } from "../types.ts";
import type { SavedPicture } from "../ui/saved_picture.ts";
import type { Shows, ViewName } from "../ui/view_parts.ts";
import { PicturePlane } from "./picture_plane.ts";
import { PointerControls } from "./pointer.ts";
import { SpacePoints } from "./space_points.ts";
import type { VolumeInfo, VolumeViewLike } from "./types.ts";
import { ViewCamera } from "./view_camera.ts";
import { ViewElements, ViewMessages } from "./view_elements.ts";

export abstract class VolumeFrontEnd implements VolumeViewLike {
  closed = false;
  info: VolumeInfo | null = null;
  shown: Shows;
  messages: ViewMessages;
  elements: ViewElements;
  camera: ViewCamera;
  pointer: PointerControls;
  spacePoints: SpacePoints;
  plane: PicturePlane;

  /**
   * @param kind a class of the root
   * @param title names it in its errors
   */
  constructor(
    readonly model: Model,
    el: HTMLElement,
    kind: string,
    private readonly title: string,
  ) {
    this.messages = new ViewMessages(model, (error) => this.fail(error));
    this.elements = new ViewElements(model, el, kind, {
      showView: (view) => this.showView(view),
      rethemed: () => this.setBackground(),
      flip: (layer) => this.flip(layer),
      handleComparison: () => this.handleComparison(),
      resized: () => this.size(),
      picture: (wanted) => this.picture(wanted),
    });
    this.shown = this.elements.shows;
    this.camera = new ViewCamera(this);
    this.pointer = new PointerControls(this);
    this.plane = new PicturePlane(this);
    this.spacePoints = new SpacePoints(this);
  }

  /** Width and height of the full picture in pixels. */
  abstract get pixels(): Vector2;

  abstract size(): void;

  abstract setBackground(): void;

  /** Called when the second of two alternating layers is shown, or the first. */
  abstract flip(layer: number): void;

  /** The line or the slider between original and deformed was moved. */
  abstract handleComparison(): void;

  /** The picture that the camera button saves, as a PNG; null for none. */
  abstract picture(wanted: SavedPicture): Promise<Blob | null>;

  /** Draw again, as something has changed. `held`: a finger or a button is still down. */
  abstract touch(held?: boolean): void;

  /** Called when the finger or the button is lifted. */
  release() {}

  fail(error: unknown) {
    console.error(error);
    const reason = (error instanceof Error && error.message) || error;
    this.elements.messages.set("failure", `${this.title} has failed: ${reason}`, { kind: "error" });
  }

  /** Show the trait "shows"; two alternating or compared only where that is drawn here. */
  takeShows(isDrawn = true) {
    const { elements } = this,
      { shows } = elements;
    this.camera.reframe(() => {
      this.shown = shows;
    });
    elements.flicker.set(shows === "flicker" && isDrawn);
    elements.compare.set(isDrawn ? shows : "");
    this.caption();
  }

  caption() {
    this.elements.caption(this.elements.flicker.layer);
  }

  /** Let the elements around and over the picture follow the camera. */
  follow() {
    if (!this.info) return;
    this.elements.follow(this.camera);
    this.spacePoints.draw();
    this.plane.draw();
  }

  readCamera(isForced = false) {
    if (this.camera.read(isForced)) this.cameraRead();
  }

  /** Called when Python or a button has changed the camera. */
  cameraRead() {
    this.touch();
  }

  /** Write the camera to its trait, only when a movement has ended: a trait costs more than a message. */
  writeCamera() {
    this.camera.write();
    this.handleRest();
  }

  /** Called when the camera is at rest. */
  handleRest() {}

  showView(view: ViewName) {
    if (!this.info) return;
    this.camera.seeAll(this.info.views[view]);
    this.cameraRead();
    this.writeCamera();
  }

  close() {
    this.closed = true;
    this.messages.send({ type: "bye" });
    for (const part of [this.messages, this.pointer, this.spacePoints, this.plane, this.elements]) part.close();
  }
}
