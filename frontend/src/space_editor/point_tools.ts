// Edits of the points of the editor in space: adding, moving and removing them, the mirror, the lattice to which they
// snap, turning and scaling.

import type { Moved } from "../editor/gesture.ts";
import type { PointsEdit } from "../generated.ts";
import { added, difference, dot, scaled } from "../maths/camera.ts";
import { formatLength } from "../maths/numbers.ts";
import { addPoint, freeIds, mirrorEdit, mirrorSide, removePoints, toggleLocks, turnOfKey } from "../maths/points.ts";
import { fromPane, rotateInSpace, toPane, translateInSpace, vectorFromPane } from "../maths/space.ts";
import { setTrait } from "../sync/edits.ts";
import type { Mirror, PaneInfo, SpacePoint, Vector2, Vector3 } from "../types.ts";
import { treeOf } from "../ui/dom.ts";
import type { SpacePane } from "./pane.ts";
import type { SpaceParts } from "./parts.ts";
import { SnapLattice } from "./snap_lattice.ts";

export const SPACE_NEAR = 6; // CSS pixels: a new handle nearer than this to an old one on the slice selects that

/** Dependencies of the tools on the editor. */
export type SpaceToolEditor = SpaceParts<
  "model" | "sender" | "frames" | "messages" | "row" | "points" | "edits" | "foldStop" | "cursor"
>;

export class SpacePointTools {
  lattice: SnapLattice;

  constructor(readonly editor: SpaceToolEditor) {
    this.lattice = new SnapLattice(editor);
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /**
   * An edit, and the same on the other side of the mirror if there is one.
   * @param join edits with the same are undone as one
   */
  change(points: SpacePoint[], kind: PointsEdit["kind"], join: string | null = null) {
    return this.editor.edits.edit(this.symmetric(this.editor.points.list, points), kind, join);
  }

  /** An edit by a key, as far as tissue does not fold. */
  #changeAsFar(make: (share: number) => SpacePoint[], kind: PointsEdit["kind"], join: string) {
    const { edits, foldStop, points } = this.editor,
      before = points.list;
    foldStop.begin();
    edits.edit(
      foldStop.limit((share) => this.symmetric(before, make(share))),
      kind,
      join,
    );
    foldStop.end();
    this.editor.frames.invalidate();
  }

  /**
   * A step of a drag: points moved by CSS pixels in a picture from where they were.
   * @param id the point under the pointer
   */
  drag(pane: SpacePane, ids: number[], by: Vector2, what: Moved, id: number, isLoose: boolean) {
    const { edits } = this.editor,
      { k } = pane.viewport.view,
      way = vectorFromPane(pane.info, by[0] / k, by[1] / k);
    this.translate(
      ids,
      this.lattice.snapMove(
        pane.info,
        edits.drag0?.find((q) => q.id === id),
        way,
        what,
        isLoose,
      ),
      what,
      id,
    );
  }

  /** The same by a displacement in space, in which all three coordinates snap. */
  dragInSpace(ids: number[], way: Vector3, what: Moved, id: number, isLoose: boolean) {
    const p = this.editor.edits.drag0?.find((q) => q.id === id),
      isSnapping = p && !isLoose && what === "target";
    this.translate(ids, isSnapping ? difference(this.lattice.nodeAt(added(p.target, way)), p.target) : way, what, id);
  }

  translate(ids: number[], way: Vector3, what: Moved, id: number) {
    const { edits, foldStop } = this.editor,
      { drag0 } = edits;
    if (!drag0) return;
    const free = freeIds(drag0, ids),
      lead = this.#sideOfPoint(id);
    if (!free.length) this.announceLocked(id);
    const make = (share: number) =>
      this.symmetric(drag0, translateInSpace(drag0, free, scaled(way, share), what), lead);
    edits.show(foldStop.limit(make));
  }

  /**
   * Move points by voxels of a picture, or the cross-hair if there are none.
   * @param id the point in focus
   */
  nudge(pane: SpacePane, id: number | null, [dx, dy]: Vector2, voxels: number, what: Moved) {
    const {
      spacing: [du, dv],
    } = pane.info;
    this.#nudgeBy(id, vectorFromPane(pane.info, dx * voxels * du, dy * voxels * dv), what);
  }

  /** Move points across the slices. */
  nudgeDepth(pane: SpacePane, id: number | null, voxels: number) {
    const by = voxels * pane.info.spacing[2];
    if (this.editor.points.idsAt(id).length) this.#nudgeBy(id, scaled(pane.info.n, by), "target");
  }

  #nudgeBy(id: number | null, way: Vector3, what: Moved) {
    const { editor } = this,
      ids = editor.points.idsAt(id);
    if (ids.length === 0) {
      editor.cursor.set(added(editor.cursor.place, way), true);
      return;
    }
    if (id !== null && !editor.points.selected.has(id)) editor.points.select([id]);
    this.nudgePoints(ids, way, what);
  }

  nudgePoints(ids: number[], way: Vector3, what: Moved = "target") {
    const { editor } = this;
    const free = freeIds(editor.points.list, ids);
    if (!free.length) this.announceLocked(ids[0]!);
    this.#changeAsFar(
      (share) => translateInSpace(editor.points.list, free, scaled(way, share), what),
      "nudge",
      `nudge ${ids}`,
    );
    const p = ids.length === 1 ? editor.points.withId(ids[0]!) : null;
    if (p)
      editor.messages.announce(`point ${editor.points.numberOf(p.id)} at ${p.target.map(formatLength).join(", ")}`);
  }

  /**
   * Add a point that holds the tissue visible at its place: Python finds its source, and nothing moves.
   * A point that is there already is selected instead. Returns its id, or null.
   * @param at in pixels
   */
  addAt(pane: SpacePane, at: Vector2) {
    const { editor } = this;
    const near = pane.flatPoints().find(({ isFar, target }) => {
      const [x, y] = pane.viewport.toView(target);
      return !isFar && Math.hypot(x - at[0], y - at[1]) < SPACE_NEAR;
    });
    if (near) {
      editor.points.select([near.id]);
      pane.handles.focus(near.id);
      return near.id;
    }
    if (!pane.isInside(at)) {
      editor.messages.hint("Points are put inside the volume");
      return null;
    }
    return this.addPlace(fromPane(pane.info, this.lattice.nodeIn(pane.info, toPane(pane.info, pane.under(at)))), pane);
  }

  addPlace(place: Vector3, pane: SpacePane | null) {
    const { editor } = this,
      id = editor.points.nextId();
    if (!this.change(addPoint(editor.points.list, id, place, place), "add")) return null;
    editor.points.select([id]);
    editor.frames.drawNow();
    pane?.handles.focus(id);
    editor.messages.announce(`point ${editor.points.numberOf(id)} added at ${place.map(formatLength).join(", ")}`);
    return id;
  }

  announceLocked(id: number) {
    const p = this.editor.points.withId(id);
    if (p)
      this.editor.messages.hint(`${p.name || `Point ${this.editor.points.numberOf(id)}`} is locked; L frees it`, 4000);
  }

  toggleLock(ids: number[]) {
    const { editor } = this;
    if (!ids.length) editor.messages.hint("Select points to lock them");
    else if (editor.edits.edit(toggleLocks(editor.points.list, ids), "lock")) {
      editor.messages.announce(editor.points.withId(ids[0]!)?.locked ? "locked" : "free");
    }
  }

  remove(wanted: number[]) {
    const { editor } = this,
      ids = freeIds(editor.points.list, wanted);
    if (wanted.length && !ids.length) this.announceLocked(wanted[0]!);
    const at = editor.points.list.findIndex((p) => p.id === ids[0]),
      pane = editor.row.paneOf(document.activeElement);
    const hadFocus = editor.row.root.contains(treeOf(editor.row.root).activeElement);
    if (!ids.length || !this.change(removePoints(editor.points.list, ids), "remove")) return;
    editor.messages.announce(ids.length === 1 ? `point ${at + 1} deleted` : `${ids.length} points deleted`);
    editor.frames.drawNow();
    const next = editor.points.list[Math.min(at, editor.points.list.length - 1)];
    if (hadFocus && !(next && pane.handles.focus(next.id))) pane.stage.focus({ preventScroll: true });
  }

  // ---- the mirror ---------------------------------------------------------------------------------------------------

  /**
   * The picture whose depth runs most nearly along an axis of space.
   * @param axis "x", "y" or "z"
   */
  #facing(axis: string) {
    const k = "xyz".indexOf(axis);
    return this.editor.cursor.panes.reduce((p, q) => (Math.abs(q.n[k]!) > Math.abs(p.n[k]!) ? q : p));
  }

  /**
   * The mirror. Its normal points to the positive side of the axis, so in an upright volume `at` is a coordinate.
   */
  get mirror() {
    const { on = false, axis = "x", at = null } = this.editor.model.get("mirror") ?? {},
      pane = this.#facing(axis);
    const sign = Math.sign(pane.n["xyz".indexOf(axis)]!) || 1,
      normal = scaled(pane.n, sign);
    return { on, axis, at: at ?? dot(normal, fromPane(pane, [0, 0, (pane.box[4] + pane.box[5]) / 2])), normal };
  }

  /** The lengths within which a source is on the plane, and a partner is found. */
  get #mirrorNear() {
    const { spacing } = this.editor.cursor.panes[0]!;
    return { axis: 0.5 * Math.min(...spacing), partner: Math.max(...spacing) };
  }

  /** @param at null for the middle */
  #setMirror(on: boolean, axis: string, at: number | null) {
    const { editor } = this;
    setTrait(editor.model, "mirror", { on, axis, at });
    if (at === null) setTrait(editor.model, "mirror", { on, axis, at: this.mirror.at });
    if (on) editor.messages.hint(`What you do on one side of the plane across ${axis} is done on the other too`, 4000);
  }

  toggleMirror() {
    const { on, axis, at } = this.mirror;
    this.#setMirror(!on, axis, at);
  }

  /** Make the plane perpendicular to the next axis. */
  turnMirror() {
    this.#setMirror(true, "xyz"[("xyz".indexOf(this.mirror.axis) + 1) % 3]!, null);
  }

  /** Move the plane to a place in space; Python gets it at the end. */
  moveMirror(place: Vector3, isEnd: boolean) {
    const { model } = this.editor,
      { on, axis, normal } = this.mirror,
      pane = this.#facing(axis);
    const ends = [pane.box[4], pane.box[5]].map((depth) => dot(normal, fromPane(pane, [0, 0, depth])));
    const at = Math.max(Math.min(...ends), Math.min(Math.max(...ends), dot(normal, place)));
    model.set("mirror", { on, axis, at });
    if (isEnd) model.save_changes();
    this.editor.frames.invalidate();
  }

  /**
   * The plane as a picture perpendicular to it shows it: "a" and "b" as of a flat mirror, null where it faces the
   * viewer.
   */
  mirrorIn(pane: PaneInfo): Mirror | null {
    const { on, at, normal } = this.mirror,
      a = dot(normal, pane.u),
      b = dot(normal, pane.v);
    if (!on || Math.max(Math.abs(a), Math.abs(b)) < 0.9) return null;
    const place = toPane(pane, scaled(normal, at)),
      k = Math.abs(a) > Math.abs(b) ? 0 : 1;
    return { on, axis: "ab"[k], at: place[k] };
  }

  #sideOfPoint(id: number) {
    const p = this.editor.points.withId(id),
      { mirror } = this;
    return p && mirror.on ? mirrorSide(mirror, p.source, this.#mirrorNear.axis) : 0;
  }

  /**
   * An edit, and the same on the other side.
   * @param lead the side that decides where both have changed
   */
  symmetric(before: SpacePoint[], after: SpacePoint[], lead: number = 0) {
    const { mirror } = this;
    if (!mirror.on) return after;
    const id = this.editor.points.nextId(after);
    return mirrorEdit(mirror, before, after, { near: this.#mirrorNear, lead, id });
  }

  // ---- turning and scaling ------------------------------------------------------------------------------------------

  /** The ids that a rotation moves; null, and a hint, where there is nothing to turn. */
  #turnables() {
    const { editor } = this,
      chosen = [...editor.points.selected],
      free = freeIds(editor.points.list, chosen);
    if (editor.points.isLocked || !chosen.length) return null;
    if (!free.length) this.announceLocked(chosen[0]!);
    else if (free.length < 2) editor.messages.hint("Select two points or more to turn them", 4000);
    return free.length < 2 ? null : free;
  }

  /**
   * Turn or scale by a key, in the plane of a picture. Quick presses are undone as one.
   * @param way 1 or -1
   */
  turnKey(pane: SpacePane, way: number, how: { isLarge: boolean; isScale: boolean }) {
    const { editor } = this,
      ids = this.#turnables(),
      [angle, factor] = turnOfKey(way, how);
    const kind = angle ? "turn" : "scale";
    if (!ids) return;
    this.#changeAsFar(
      (share) => rotateInSpace(editor.points.list, ids, pane.info, share * angle, factor ** share),
      kind,
      `${kind} ${pane.index} ${ids}`,
    );
    editor.messages.announce(
      angle ? `turned by ${formatLength((angle * 180) / Math.PI)} degrees` : `scaled by ${factor.toFixed(2)}`,
    );
  }

  /** Begin a drag of the handle that turns. Returns the ids, or null. */
  beginTurn() {
    const ids = this.#turnables();
    if (ids) this.editor.edits.beginDrag();
    return ids;
  }

  /** A step of such a drag. */
  turnTo(pane: SpacePane, ids: number[], angle: number, factor: number) {
    const { editor } = this,
      { drag0 } = editor.edits;
    if (drag0) {
      const make = (share: number) =>
        this.symmetric(drag0, rotateInSpace(drag0, ids, pane.info, share * angle, factor ** share));
      editor.edits.show(editor.foldStop.limit(make));
    }
    editor.messages.hint(
      factor === 1 ? `${formatLength((angle * 180) / Math.PI)}\u00b0` : `\u00d7 ${factor.toFixed(2)}`,
    );
  }
}
