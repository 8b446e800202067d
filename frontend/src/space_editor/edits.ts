// Edits of the points in space: one at a time, or shown while a drag moves them.

import type { PointsEdit } from "../generated.ts";
import { samePoints } from "../maths/points.ts";
import { updateSources } from "../maths/space.ts";
import { busOf, publishPoints, settingsOf } from "../sync/bus.ts";
import { type FitChange, MOST_CHARACTERS } from "../sync/edits.ts";
import type { PointsDetail, SpacePoint } from "../types.ts";
import type { SpaceParts } from "./parts.ts";

export class SpaceEdits {
  id = Math.random().toString(36).slice(2, 12); // of the view, where others follow it

  /** The points before the drag, or null. */
  drag0: SpacePoint[] | null = null;

  constructor(
    readonly editor: SpaceParts<"model" | "sender" | "frames" | "messages" | "points" | "shapes" | "foldStop">,
  ) {
    editor.points.draggers = [this];
  }

  /** Whether there is nothing to edit: slices to look at. */
  get isViewer() {
    const { model, points } = this.editor;
    return Boolean(model.get("read_only")) && points.list.length === 0;
  }

  /**
   * Make an edit. Returns whether there is one.
   * @param join edits with the same are undone as one
   * @param fit settings of the fit that the edit changes too
   */
  edit(
    list: SpacePoint[],
    kind: PointsEdit["kind"] = "move",
    join: string | null = null,
    fit: FitChange | null = null,
  ) {
    const { messages, points, sender } = this.editor;
    if (points.isLocked || (!fit && samePoints(list, points.list))) return false;
    if (JSON.stringify(list).length > MOST_CHARACTERS) {
      messages.show("These are too many points to send in one message. Remove some, or edit in Python.");
      return false;
    }
    sender.edit(list, kind, join, fit); // which notifies all views, this one too
    return true;
  }

  beginDrag() {
    const { foldStop, points } = this.editor;
    if (points.isLocked) return;
    this.drag0 = points.list;
    foldStop.begin();
  }

  /** Show moving points. */
  show(list: SpacePoint[]) {
    this.publish(list, "move");
    this.editor.sender.move(list);
  }

  endDrag(isCancelled: boolean, kind: PointsEdit["kind"] = "move") {
    const { foldStop, points, sender } = this.editor,
      { drag0 } = this,
      { list } = points;
    this.drag0 = null;
    if (!drag0) return;
    points.list = drag0;
    const isEdit = !isCancelled && this.edit(list, kind);
    foldStop.end(isCancelled);
    if (isEdit) return;
    this.publish(sender.points, "end"); // Python may have moved them meanwhile
    sender.move(points.list); // Python has received the drag, and now its end
  }

  /** Show points here and in the views that follow them. */
  publish(list: SpacePoint[], phase: "move" | "end") {
    const { frames, model, points } = this.editor;
    points.list = list;
    const settings = { ...settingsOf(model), parts: points.shapes.parts };
    publishPoints(busOf(model), { origin: this.id, points: list, settings, fit: null, phase });
    if (phase === "move") frames.markMoving();
    else frames.invalidate();
  }

  /** Take the points of this window, wherever they came from. */
  receive() {
    const {
      points,
      sender: { points: list, shapes },
    } = this.editor;
    if (points.isDragging && !this.drag0) return;
    if (this.drag0) {
      // Python has found a new point's source; the pointer's values stay
      this.drag0 = updateSources(this.drag0, list);
      points.list = updateSources(points.list, list);
      return;
    }
    if (samePoints(list, points.list) && shapes === points.shapes) return;
    this.editor.shapes.follow(shapes);
    this.publish(list, "end");
    points.select([...points.selected]);
  }

  /** Take over the points of another view. */
  receiveMove({ origin, points: list, phase }: PointsDetail) {
    const { frames, points } = this.editor;
    if (origin === this.id || points.isDragging) return;
    if (phase === "move") {
      points.list = list as SpacePoint[];
      frames.markMoving();
    } else this.receive();
  }
}
