// The points and shapes of one view of an editor, as they are during a drag, and which of them are selected.

import { numberOf } from "../maths/point_names.ts";
import { nextId } from "../maths/points.ts";
import { RestingTrait, type Sender } from "../sync/edits.ts";
import type { Point, Shapes, Vector } from "../types.ts";
import type { Parts } from "./parts.ts";

/** Dependencies of the points on the editor. */
export type PointsEditor<V extends Vector> = Pick<Parts, "model" | "frames" | "messages"> & {
  sender: Sender<V>;
  picture?: { readonly isBefore: boolean };
};

export class EditedPoints<V extends Vector> {
  list: Point<V>[];
  shapes: Shapes;
  selected: Set<number>;
  selection: RestingTrait;

  /** The tools that drag points or shapes. */
  draggers: { readonly drag0: unknown }[] = [];

  /** Called when points are selected: then no shape is chosen. */
  onSelect: () => void = () => {};

  constructor(readonly editor: PointsEditor<V>) {
    const { model, sender } = editor;
    this.list = sender.points;
    this.shapes = sender.shapes;
    this.selected = new Set(model.get("selected"));
    this.selection = new RestingTrait(model, "selected");
  }

  get isWaiting() {
    return Boolean(this.editor.model.get("waiting"));
  }

  get isLocked() {
    return this.isWaiting || Boolean(this.editor.model.get("read_only")) || Boolean(this.editor.picture?.isBefore);
  }

  /** Whether points, a shape or a part are being dragged. */
  get isDragging() {
    return this.draggers.some(({ drag0 }) => drag0 !== null);
  }

  /** The id of the next point that is added to a list. */
  nextId(list = this.list) {
    return nextId(list, this.editor.sender.nextId);
  }

  /** The number of a point in the list, from 1: people know it by that. */
  numberOf(id: number) {
    return numberOf(this.list, id);
  }

  withId(id: number) {
    return this.list.find((p) => p.id === id);
  }

  /** @param isShared whether Python gets the selection */
  select(ids: Iterable<number>, isShared: boolean = true) {
    const known = new Set(this.list.map((p) => p.id)),
      next = new Set([...(ids ?? [])].filter((id) => known.has(id)));
    const isSame = next.size === this.selected.size && [...next].every((id) => this.selected.has(id));
    this.selected = next;
    if (next.size) this.onSelect();
    this.editor.frames.invalidate();
    if (isSame || !isShared) return;
    this.selection.sendSoon([...this.selected]);
  }

  toggle(id: number) {
    this.select(this.selected.has(id) ? [...this.selected].filter((other) => other !== id) : [...this.selected, id]);
  }

  /** The selected points, or the one in focus if that is not selected. */
  idsAt(focused: number | null) {
    return focused !== null && !this.selected.has(focused) ? [focused] : [...this.selected];
  }

  /** Undo or redo an edit. */
  step(way: "undo" | "redo") {
    const { sender, messages } = this.editor;
    if (this.isDragging || this.isLocked || !sender.step(way)) return;
    messages.announce(way === "undo" ? "undone" : "redone");
  }
}
