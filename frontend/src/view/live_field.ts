// The displacement that a live view shows: of Python, or of an editor or a player in the same window.

import type { FieldMaps } from "../generated.ts";
import type { Model } from "../types.ts";
import type { RayCaster } from "../webgl/raycaster.ts";
import type { PlanarField, SpaceField } from "../webgl/types.ts";
import type { KnownCuts } from "./follow_editor.ts";
import { FieldLink, fieldOf } from "./follow_editor.ts";
import { SpaceLink } from "./follow_space.ts";
import { TimeLink } from "./playback.ts";
import type { FrameLoop } from "./render_loop.ts";
import { isSameField, isSamePlanar } from "./same_field.ts";
import type { Bytes, Field, VolumeInfo } from "./types.ts";
import type { ViewCamera } from "./view_camera.ts";
import type { ViewMessages } from "./view_elements.ts";

/** Dependencies of the field on its view. */
export interface FieldView {
  model: Model;
  messages: ViewMessages;
  camera: ViewCamera;
  readonly info: VolumeInfo | null;
  readonly caster: RayCaster | null;
  readonly loop: FrameLoop | null;
  readonly still: { request(): void } | null;
  touch(held?: boolean): void;
  mark(): void;
  fail(error: unknown): void;
}

export class LiveField {
  shown: Field | null = null;
  cuts: KnownCuts = {};
  received = 0; // bytes
  link: FieldLink;
  times: TimeLink;
  spaceLink: SpaceLink;

  constructor(private readonly view: FieldView) {
    const { messages, model } = view;
    this.link = new FieldLink(
      model,
      (planar, isDrawing) => this.#follow(planar, isDrawing),
      (isMoving) => this.#handleMove(isMoving),
    );
    this.times = new TimeLink(model, (planar, isPlaying) => this.#play(planar, isPlaying));
    this.spaceLink = new SpaceLink(model, {
      info: () => view.info,
      move: (isMoving) => this.#handleMove(isMoving),
      apply: (space, isMoving) => this.#followSpace(space, isMoving),
      follows: (sender) => messages.send({ type: "follows", sender }),
    });
    for (const [link, name] of [
      [this.link, "editor"],
      [this.times, "player"],
      [this.spaceLink, "points_editor"],
    ] as const) {
      messages.on(`change:${name}`, () => link.follow(model.get(name)));
      link.follow(model.get(name)).catch((error) => view.fail(error));
    }
  }

  /** Take a message of Python: "missing" where its field is not here, "same" where that is shown already. */
  receive(content: FieldMaps, buffers: Bytes[]): "missing" | "same" | "new" {
    const { view } = this,
      before = this.shown;
    this.received += buffers.reduce((sum, b) => sum + b.byteLength, 0);
    this.times.drop();
    const field = content.frames
      ? this.times.take(content, content.frames, buffers as [Bytes, Bytes])
      : fieldOf(content, buffers, this.cuts);
    if (!field) return "missing";
    const next: Field = {
      ...field,
      planar: this.link.merge(field.planar, content.follow || null),
      space: this.spaceLink.merge(field.space, content.moved || null),
    };
    if (before && view.loop && isSameField(before, next)) return "same"; // the answer to an edit that was drawn here
    view.camera.reframe(() => {
      this.shown = next; // a larger field of view is fully visible
    });
    view.mark();
    this.apply();
    view.touch();
    return "new";
  }

  apply() {
    const { camera, caster, loop } = this.view;
    if (!caster?.voxels.volume || !this.shown || !loop) return;
    loop.apply(() => {
      const { shown } = this; // of then, which may be a newer one
      if (!caster.voxels.volume || !shown) return;
      const { planar } = caster.fields;
      if (!planar || !shown.planar || !isSamePlanar(planar, shown.planar)) caster.fields.setPlanar(shown.planar);
      caster.fields.setSpace(shown.space);
      caster.voxels.volume.box = camera.box;
      this.view.mark();
      if (!this.link.isMoving) this.#reportSides();
    });
  }

  /**
   * Report to a page without Python the sides of the box beyond which there is tissue, as soon as an edit ends: where the
   * map is not the same at every depth, the editor cannot tell.
   */
  #reportSides() {
    const { caster, messages, model } = this.view,
      looked = model.get("tissue_check");
    if (looked && caster?.isReady) messages.send({ type: "stats", sides: caster.exceededSides(looked) });
  }

  /** Show new maps from the editor in this window: no byte is sent to Python. */
  #follow(planar: PlanarField, isDrawing: boolean) {
    const { caster, loop } = this.view,
      before = this.shown?.planar ?? null;
    if (this.shown) this.shown.planar = planar;
    else this.shown = { box: null, planar, space: null };
    this.apply();
    if (isDrawing || !caster?.voxels.volume) return;
    // A drop where the last movement was drawn: the full picture may begin.
    if (loop && !this.link.isMoving && before && isSamePlanar(before, planar)) loop.release();
    else this.view.touch(this.link.isMoving);
  }

  /** The same for a displacement in space. */
  #followSpace(space: SpaceField, isMoving: boolean) {
    if (!this.shown) return;
    this.shown.space = space;
    this.apply();
    if (!isMoving && this.view.caster?.voxels.volume) this.view.touch();
  }

  #play(planar: PlanarField, isPlaying: boolean) {
    if (!this.shown) return;
    this.shown = { ...this.shown, planar };
    this.apply();
    this.view.touch(isPlaying);
    if (!isPlaying) this.view.still?.request();
  }

  /** Make the maps and the displacement of the newest movements. */
  catchUp() {
    this.link.catchUp();
    this.spaceLink.catchUp();
  }

  /** A point is moving: its maps are made with the next picture, or now if none is drawn here. */
  #handleMove(isMoving: boolean) {
    const { caster, loop } = this.view;
    if (!isMoving && loop?.movement.isHeld) loop.release();
    if (!isMoving) return;
    for (const { bus } of [this.link, this.spaceLink]) if (bus && caster) bus.isShared = caster.gpu.isSoftware;
    if (loop && caster?.voxels.volume) this.view.touch(true);
    else this.catchUp();
  }

  close() {
    for (const link of [this.link, this.spaceLink, this.times]) link.close();
  }
}
