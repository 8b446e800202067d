// The points of an editor as a view of the volume shows and edits them: in space, or of a picture (lifted_points.ts).
// An editor that is drawn in this window edits them by its own tools; the points of another one are sent from here.

import type { Moved } from "../editor/gesture.ts";
import type { Chosen } from "../editor/shape_handles.ts";
import { numberOf } from "../maths/point_names.ts";
import { addPoint, nextId, removePoints, samePoints } from "../maths/points.ts";
import { translateInSpace, updateSources } from "../maths/space.ts";
import { spacePartsOf } from "../maths/space_parts.ts";
import { FollowedModel, publishPoints, settingsOf } from "../sync/bus.ts";
import type { Sender } from "../sync/edits.ts";
import { senderOf, setTrait } from "../sync/edits.ts";
import type { Bus, EditorTools, Model, PicturePoint, Plane, Point, SpacePoint, Vector3 } from "../types.ts";
import { LiftedPoints } from "./lifted_points.ts";
import type { EditedParts } from "./part_loops.ts";

/** The model of an editor, and what its views in the window share. */
interface Edited {
  editor: Model;
  bus: Bus;
  sender: Sender<Vector3>;
}

/** The trait of the view that names an editor, in space or of a picture. */
export type EditorTrait = "points_editor" | "picture_editor";

export class FollowedPoints {
  /** In space */
  list: SpacePoint[] = [];
  selected = new Set<number>();
  /** The points as a drag began; null without one */
  before: SpacePoint[] | null = null;
  /** Of the points of a picture; null of points in space */
  lifted: LiftedPoints | null = null;
  #id = Math.random().toString(36).slice(2, 12);
  #followed: FollowedModel;
  #edited: Edited | null = null;
  #moved: { ids: number[]; depths: Map<number, number> } | null = null; // of a picture, in a drag

  /**
   * @param draw called when the points have changed
   * @param middle returns a place in the middle of what is seen
   */
  constructor(
    owner: Model,
    readonly draw: () => void,
    readonly middle: () => Vector3,
  ) {
    this.#followed = new FollowedModel(owner);
  }

  async follow(reference: string | Model | null) {
    const followed = this.#followed;
    if (reference === followed.reference) return; // following again removes no listener
    this.leave();
    const found = await followed.choose(reference);
    if (!found) return;
    const { model: editor, bus } = found;
    const sender = senderOf<Vector3>(bus, editor);
    this.#edited = { editor, bus, sender };
    followed.hear(bus, "deformnb:points", ({ detail }) => {
      if (detail.origin === this.#id || (this.before && !this.tools)) return;
      this.#take(detail.phase === "move" ? detail.points : sender.points);
    });
    const chosen = () => {
      this.selected = new Set(editor.get("selected") ?? []);
      this.draw();
    };
    const placed = () => {
      this.#lift();
      this.#take(sender.points);
    };
    const unlisten = sender.listen((what: string) => {
      if (what === "points") this.receive();
    });
    editor.on("change:selected", chosen);
    editor.on("change:plane", placed);
    editor.on("change:chosen_shape", this.draw);
    followed.ends.push(
      unlisten,
      () => editor.off("change:selected", chosen),
      () => editor.off("change:plane", placed),
      () => editor.off("change:chosen_shape", this.draw),
    );
    sender.receive();
    placed();
    chosen();
  }

  #lift() {
    const plane = this.edited.editor.get("plane") as Plane | Record<string, never> | undefined;
    const isPlane = plane !== undefined && "origin" in plane;
    this.lifted = isPlane ? new LiftedPoints(plane as Plane, 0) : null;
    if (isPlane) this.lifted = new LiftedPoints(plane as Plane, this.lifted!.depth(this.middle()));
  }

  #take(points: readonly Point[]) {
    this.list = this.lifted ? this.lifted.lift(points as PicturePoint[]) : (points as SpacePoint[]);
    this.draw();
  }

  leave() {
    this.#followed.end();
    this.#edited = this.before = this.lifted = this.#moved = null;
    this.list = [];
    this.draw();
  }

  get isFollowing() {
    return this.#edited !== null;
  }

  /** The editor and the state that its views share; there must be one. */
  get edited() {
    if (!this.#edited) throw new Error("no points are edited");
    return this.#edited;
  }

  /** The tools of the editor, if it is drawn in this window. */
  get tools(): EditorTools | null {
    return this.#edited?.bus.tools?.at(-1) ?? null;
  }

  /** The rigid parts of points in space, as they are during a drag in this window. */
  get parts(): EditedParts {
    const { bus, editor, sender } = this.edited,
      { latest } = bus,
      { what = "", index = 0 } = (editor.get("chosen_shape") ?? {}) as Partial<Chosen>,
      parts = latest?.phase === "move" ? latest.settings.parts : sender.shapes.parts;
    return {
      parts: this.lifted ? [] : spacePartsOf(parts ?? []),
      chosen: what === "parts" ? index : null,
      panes: editor.get("panes") ?? [],
    };
  }

  get isLocked() {
    const { editor } = this.edited;
    return Boolean(editor.get("read_only") || editor.get("waiting")) || (this.lifted !== null && !this.tools);
  }

  receive() {
    const { points } = this.edited.sender;
    if (this.before && !this.tools) {
      // Python has found a new point's source; the drag's values stay
      this.before = updateSources(this.before, points);
      this.list = updateSources(this.list, points);
      this.draw();
    } else if (!this.before) this.#take(points);
  }

  /** Find the depths of a picture's points whose depths nobody has chosen. */
  settle(body: Parameters<LiftedPoints["settle"]>[1]) {
    const points = this.edited.sender.points as Point[] as PicturePoint[];
    if (this.before || !this.lifted?.settle(points, body)) return;
    this.#take(points);
  }

  /** The number of a point in the list, from 1: people know it by that. */
  numberOf(id: number) {
    return numberOf(this.list, id);
  }

  withId(id: number) {
    return this.list.find((p) => p.id === id);
  }

  select(ids: number[]) {
    this.selected = new Set(ids);
    setTrait(this.edited.editor, "selected", [...ids]);
    this.draw();
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /** Add a point that holds the tissue at a place. Returns its id; null, with a hint of the editor, where it cannot. */
  add(place: Vector3): number | null {
    const { lifted, tools } = this,
      { sender } = this.edited;
    if (!tools) {
      const id = nextId(this.list, sender.nextId);
      sender.edit(addPoint(this.list, id, place, place), "add"); // Python finds its source
      return id;
    }
    const id = tools.add(lifted ? lifted.lower(place) : place);
    if (lifted && id !== null) {
      lifted.choose(id, lifted.depth(place));
      this.#take(sender.points);
    }
    return id;
  }

  remove(ids: number[]) {
    const { tools } = this;
    if (tools) tools.remove(ids);
    else this.edited.sender.edit(removePoints(this.list, ids), "remove");
  }

  nudge(ids: number[], way: Vector3) {
    const { lifted, tools } = this;
    if (!tools) this.edited.sender.edit(translateInSpace(this.list, ids, way), "nudge", `nudge ${ids}`);
    else {
      this.#deepen(ids, way, this.#depthsOf(ids));
      tools.nudge(ids, lifted ? lifted.lowerVector(way) : way);
    }
  }

  // ---- drags --------------------------------------------------------------------------------------------------------

  /** Begin a drag; false where nothing may be moved. */
  begin(ids: number[]) {
    const { tools } = this;
    if (this.isLocked || (tools && !tools.begin())) return false;
    this.before = this.list;
    this.#moved = { ids, depths: this.#depthsOf(ids) };
    return true;
  }

  #depthsOf(ids: number[]) {
    const { lifted } = this;
    return new Map(lifted ? ids.map((id) => [id, lifted.depthOf(id)]) : []);
  }

  /** Points of a picture have their depths here: the editor knows only their places in its plane. */
  #deepen(ids: number[], way: Vector3, before: Map<number, number>) {
    const { lifted } = this,
      by = lifted ? lifted.depth(way) - lifted.depth([0, 0, 0]) : 0;
    for (const id of ids) lifted?.choose(id, (before.get(id) ?? 0) + by);
  }

  /**
   * Move points from where the drag began by a displacement in space.
   * @param id the point under the pointer
   * @param isLoose whether that one need not snap
   */
  move(ids: number[], way: Vector3, what: Moved, id: number, isLoose = false) {
    const { before, lifted, tools } = this;
    if (!before) return;
    if (!tools) {
      this.#show(translateInSpace(before, ids, way, what));
      return;
    }
    this.#deepen(ids, way, this.#moved?.depths ?? new Map());
    tools.move(ids, lifted ? lifted.lowerVector(way) : way, what, id, isLoose);
  }

  /** End a drag: as an edit, or as if it had not been. */
  end(isCancelled: boolean) {
    const { before, list, tools } = this,
      { sender } = this.edited;
    if (!before) return;
    this.before = null;
    if (isCancelled) for (const [id, depth] of this.#moved?.depths ?? []) this.lifted?.choose(id, depth);
    this.#moved = null;
    if (tools) tools.end(isCancelled);
    else if (!isCancelled && !this.isLocked && !samePoints(list, before)) sender.edit(list, "move");
    else this.#revert();
    this.#take(sender.points);
  }

  /** Show the points of a drag, here and in other views. */
  #show(points: SpacePoint[]) {
    this.list = points;
    this.#publish("move");
    this.edited.sender.move(points);
    this.draw();
  }

  /** Revert a drag, also in Python, which has received it. */
  #revert() {
    const { sender } = this.edited;
    this.list = sender.points;
    this.#publish("end");
    sender.move(this.list);
  }

  #publish(phase: "move" | "end") {
    const { bus, editor } = this.edited;
    publishPoints(bus, { origin: this.#id, points: this.list, settings: settingsOf(editor), fit: null, phase });
  }
}
