// The editor's tools for points: single edits, the mirror, the grid and locks.

import type { PointsEdit } from "../generated.ts";
import { isNamed, labelOf } from "../maths/point_names.ts";
import {
  freeIds,
  includeRims,
  newPoint,
  removePoints,
  renamePoint,
  resetPoints,
  samePoints,
  toggleLocks,
  togglePoints,
  translatePoints,
} from "../maths/points.ts";
import { RbfError } from "../maths/rbf.ts";
import { type FitChange, MOST_CHARACTERS } from "../sync/edits.ts";
import type { FitSettings, PicturePoint, Vector2 } from "../types.ts";
import { treeOf } from "../ui/dom.ts";
import type { MapState } from "./fold_stop.ts";
import type { Moved } from "./gesture.ts";
import { pointLabel } from "./handles.ts";
import { PointMirror } from "./mirror.ts";
import type { EditorParts } from "./parts.ts";
import { SnapGrid } from "./snap_grid.ts";

const NEAR = 6; // CSS pixels: a new handle nearer than this to an old one selects that
/** Dependencies of the tools on the editor. */
export type PointEditor = EditorParts<
  "model" | "sender" | "frames" | "messages" | "stage" | "viewport" | "points" | "map" | "picture",
  "foldStop",
  "handles",
  "names"
>;

/** Edits of the control points. */
export class PointTools {
  mirror: PointMirror;
  snap: SnapGrid;

  constructor(readonly editor: PointEditor) {
    this.mirror = new PointMirror(editor);
    this.snap = new SnapGrid(editor);
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /**
   * Replace the list of points, unless it cannot be fitted while the present one can: then the reason is shown.
   * @param kind the name of the edit
   * @param join edits with the same one in quick succession are undone as one
   * @param fit settings of the fit that the edit changes too
   */
  edit(
    points: PicturePoint[],
    kind: PointsEdit["kind"] = "move",
    join: string | null = null,
    fit: FitChange | null = null,
  ) {
    const { editor } = this;
    if (editor.points.isLocked || (!fit && samePoints(points, editor.points.list))) return false;
    if (!editor.map.error && !this.accepts(points, { ...editor.points.shapes, ...fit })) return false;
    if (JSON.stringify(points).length > MOST_CHARACTERS) {
      editor.messages.show("These are too many points to send in one message. Remove some, or edit in Python.");
      return false;
    }
    editor.sender.edit(points, kind, join, fit); // which notifies all views, this one too
    return true;
  }

  /** The same with its mirror image, if the mirror is on. */
  change(points: PicturePoint[], kind: PointsEdit["kind"], join: string | null = null) {
    return this.edit(this.mirror.edit(this.editor.points.list, points, 0, kind === "add"), kind, join);
  }

  /** The same by a key, as far as tissue does not fold: `make(1)` of the points, or a share of the way. */
  changeAsFar(make: (share: number) => PicturePoint[], kind: PointsEdit["kind"], join: string) {
    const {
      points: { list, shapes },
      tools: { foldStop },
    } = this.editor;
    foldStop.begin();
    const { points } = foldStop.limit<MapState>((share) => ({ points: this.mirror.edit(list, make(share)), shapes }));
    this.edit(points, kind, join);
    foldStop.end();
  }

  /** Whether a fit is possible; if not, the reason is shown. */
  accepts(points: PicturePoint[], shapes: Partial<FitSettings> = this.editor.points.shapes) {
    const { editor } = this;
    try {
      editor.map.fitOf(points, shapes);
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      const { message } = error;
      editor.messages.show(message, true);
      editor.layers.handles.blink(points.filter((p, k) => isNamed(message, labelOf(p, k + 1))).map((p) => p.id));
      return false;
    }
    return true;
  }

  // ---- single edits -------------------------------------------------------------------------------------------------

  /** Ids that may be changed, with those of their rims; a hint if there are none. */
  movableIds(ids: number[]) {
    const free = freeIds(this.editor.points.list, includeRims(this.editor.points.list, ids));
    if (ids.length && !free.length) this.hintLocked(ids);
    return free;
  }

  hintLocked([id]: number[]) {
    const p = this.editor.points.withId(id!);
    if (p)
      this.editor.messages.hint(
        `${p.name || `Point ${this.editor.points.numberOf(p.id)}`} is locked; L frees it`,
        4000,
      );
  }

  /**
   * Move the selected points, or the one in focus, by so many pixels of the picture; without any, move the view.
   */
  nudge(focused: number | null, [dx, dy]: Vector2, pixels: number, what: Moved) {
    const { editor } = this,
      ids = editor.points.idsAt(focused);
    if (ids.length === 0) {
      editor.viewport.panBy(-dx * pixels * 4, -dy * pixels * 4);
      return;
    }
    if (focused !== null && !editor.points.selected.has(focused)) editor.points.select([focused]);
    const [du, dv] = editor.model.get("raster").spacing,
      free = this.movableIds(ids);
    const before = editor.points.list;
    this.changeAsFar(
      (share) => translatePoints(before, free, share * dx * pixels * du, share * dy * pixels * dv, what),
      "nudge",
      `nudge ${ids}`,
    );
    const p = editor.points.withId(ids[0]!);
    if (p && ids.length === 1) editor.messages.announce(pointLabel(p, editor.points.numberOf(p.id)));
  }

  /**
   * Add a point that holds the tissue visible at a place of the view: its source is where the map leads, so nothing
   * moves.
   * @param at CSS pixels
   * @returns its id, that of a point which is there already, or null in a gap
   */
  addAt([x, y]: Vector2, isLoose = false): number | null {
    const { editor } = this,
      [near] = editor.points.list
        .map((p) => {
          const [px, py] = editor.viewport.toView(p.target);
          return { id: p.id, away: Math.hypot(px - x, py - y) };
        })
        .sort((p, q) => p.away - q.away);
    if (near && near.away < NEAR) {
      editor.points.select([near.id]);
      editor.layers.handles.focus(near.id);
      return near.id;
    }
    const place = editor.viewport.placeAt([x, y]),
      target = isLoose ? place : this.snap.placeOf(place);
    const source = editor.map.sourcesOf(editor.map.fitAt([x, y]))(target);
    if (source === null) {
      editor.messages.hint("This is a gap: there is nothing here to drag");
      return null;
    }
    const id = editor.points.nextId();
    if (!this.change([...editor.points.list, newPoint(id, source, target)], "add")) return id;
    this.present(id, "added");
    return id;
  }

  addInMiddle() {
    this.addAt([this.editor.viewport.view.width / 2, this.editor.viewport.view.height / 2]);
  }

  /** Select a point, give it the focus, and describe it to a screen reader. */
  present(id: number, remark: string) {
    const { editor } = this,
      p = editor.points.withId(id);
    editor.points.select([id]);
    editor.frames.drawNow();
    editor.layers.handles.focus(id);
    if (p) editor.messages.announce(`${pointLabel(p, editor.points.numberOf(id))}, ${remark}`);
  }

  remove(wanted: number[]) {
    const { editor } = this,
      ids = this.movableIds(wanted),
      at = editor.points.list.findIndex((p) => p.id === ids[0]);
    const hadFocus = editor.stage.svg.contains(treeOf(editor.stage.root).activeElement);
    if (!ids.length || !this.change(removePoints(editor.points.list, ids), "remove")) return;
    editor.messages.announce(ids.length === 1 ? `point ${at + 1} deleted` : `${ids.length} points deleted`);
    const next = editor.points.list[Math.min(at, editor.points.list.length - 1)];
    editor.frames.drawNow();
    if (hadFocus && next) editor.layers.handles.focus(next.id);
    else if (hadFocus) editor.stage.focus();
  }

  rename(id: number) {
    const { editor } = this,
      p = editor.points.withId(id);
    if (!p || editor.points.isLocked) return;
    editor.panels.names.prompt(p.name, `point ${editor.points.numberOf(id)}`, editor.viewport.toView(p.target), {
      take: (text) => {
        this.edit(renamePoint(editor.points.list, id, text), "rename");
      },
      focus: () => editor.layers.handles.focus(id),
    });
  }

  switch(ids: number[]) {
    this.change(togglePoints(this.editor.points.list, ids), "switch");
  }

  /** Reset these points to their sources, all if there are none. */
  reset(ids: number[]) {
    const points = this.editor.points.list;
    this.change(resetPoints(points, this.movableIds(ids.length ? ids : points.map((p) => p.id))), "reset");
  }

  // ---- locks --------------------------------------------------------------------------------------------------------

  toggleLock(ids: number[]) {
    const { editor } = this;
    if (!ids.length) {
      editor.messages.hint("Select points to lock them");
      return;
    }
    if (!this.edit(toggleLocks(editor.points.list, ids), "lock")) return;
    const isLocked = editor.points.withId(ids[0]!)?.locked;
    editor.messages.announce(
      `${ids.length === 1 ? `point ${editor.points.numberOf(ids[0]!)}` : `${ids.length} points`} ${isLocked ? "locked" : "free"}`,
    );
  }
}
