// Following the points of an editor in space in the same window: while they move, their fit is sampled here by
// maths/rbf.js at as many nodes as Python would, and no displacement comes from Python. At rest Python's field is shown,
// which has more nodes. Where Python's field is not the fit of these points alone it reports so, and makes all of them.

import { perAxis } from "../maths/axes.ts";
import { forwardFit, forwardOnLattice } from "../maths/forward_fit.ts";
import { pointsKey } from "../maths/points.ts";
import { RbfError, rbfFit, rbfOnLattice } from "../maths/rbf.ts";
import { fitInFrame } from "../maths/space.ts";
import { FollowedModel, settingsOf } from "../sync/bus.ts";
import { senderOf } from "../sync/edits.ts";
import type { Bus, Model, Point, PointsDetail, RbfFit, Vector3 } from "../types.ts";
import type { SpaceField } from "../webgl/types.ts";
import type { VolumeInfo } from "./types.ts";

/** The points whose fit a field of Python is, and the numbers of nodes along the axes while they move. */
export type Moved = { points: Point[]; shape: Vector3 };

export type Detail = Pick<PointsDetail, "points" | "settings">;

export class SpaceLink {
  view: {
    info: () => VolumeInfo | null;
    apply: (space: SpaceField, isMoving: boolean) => void;
    move: (isMoving: boolean) => void;
    follows: (sender: string) => void;
  };
  followed: FollowedModel;
  editor: Model | null = null;
  bus: Bus | null = null;
  given: { space: SpaceField; key: string; shape: Vector3 } | null = null; // by Python, if it is the fit of the points alone
  shown: SpaceField | null = null;
  awaited: Detail | null = null; // the newest movement, if its field has not been made
  count = 0; // fits that were sampled here

  /**
   * @param model the view's
   */
  constructor(
    model: Model,
    view: {
      /** Of the volume that is shown */
      info: () => VolumeInfo | null;
      /** Take a new field */
      apply: (space: SpaceField, isMoving: boolean) => void;
      /** As of FieldLink */
      move: (isMoving: boolean) => void;
      /** Report whose edits are followed */
      follows: (sender: string) => void;
    },
  ) {
    this.view = view;
    this.followed = new FollowedModel(model);
  }

  async follow(reference: string | Model | null) {
    if (reference === this.followed.reference) return; // following again removes no listener
    this.close();
    const found = await this.followed.choose(reference);
    if (!found) return;
    const { model: editor, bus } = found;
    this.editor = editor;
    this.bus = bus;
    this.followed.hear(bus, "deformnb:points", ({ detail }) => this.followMove(detail));
    this.view.follows(senderOf(bus, editor).channel.id);
  }

  /** The field to show when Python has sent one: that of points changed since is sampled here. */
  merge(space: SpaceField | null, moved: Moved | null) {
    const { bus, editor } = this,
      isMoving = bus?.latest?.phase === "move";
    this.given = space && moved && { space, key: pointsKey(moved.points), shape: moved.shape };
    this.shown = space;
    if (!bus || !editor || !this.given) return space;
    const { points } = isMoving && bus.latest ? bus.latest : senderOf(bus, editor);
    if (pointsKey(points) !== this.given.key)
      this.shown = this.#sampleField({ points, settings: settingsOf(editor) }) ?? space;
    return this.shown;
  }

  followMove(detail: PointsDetail) {
    if (!this.given) return;
    const isMoving = detail.phase === "move";
    this.awaited = isMoving ? detail : null;
    this.view.move(isMoving); // also of an end at which nothing is new: the view waits for one
    if (!isMoving) this.#show(detail, false);
  }

  /** Make the field of the newest movement, unless it has been made. */
  catchUp() {
    const { awaited } = this;
    this.awaited = null;
    if (awaited) this.#show(awaited, true);
  }

  #show(detail: Detail, isMoving: boolean) {
    const { given } = this;
    const space = given && (pointsKey(detail.points) === given.key ? given.space : this.#sampleField(detail));
    if (!space || space === this.shown) return; // a failed fit leaves the last good picture, as in Python
    this.shown = space;
    this.view.apply(space, isMoving);
  }

  #sampleField({ points, settings }: Detail): SpaceField | null {
    const { given } = this,
      info = this.view.info();
    if (!given || !info) return null;
    const {
      space: { shape: nodes, spacing: steps, origin },
      shape,
    } = given;
    const spacing = perAxis((k) => (steps[k] * (nodes[k] - 1)) / (shape[k] - 1));
    try {
      const isForward = settings.direction === "forward",
        lattice = { shape, spacing, origin };
      const found = isForward ? forwardFit(points, settings, 3).forward : rbfFit(points, settings, 3);
      const fit = fitInFrame(found as RbfFit, info.to_frame, info.origin);
      this.count += 1;
      return { ...lattice, values: isForward ? forwardOnLattice(fit, lattice) : rbfOnLattice(fit, lattice) };
    } catch (error) {
      if (!(error instanceof RbfError)) throw error; // the editor shows what is wrong
      return null;
    }
  }

  close() {
    this.followed.end();
    this.given = this.shown = this.awaited = null;
    this.editor = this.bus = null;
  }
}
