// Drags of points in a view of the volume: in the plane of the view, along the surface, along an axis, along the ray.

import type { Moved } from "../editor/gesture.ts";
import { WheelSteps } from "../editor/handles.ts";
import { difference, scaled } from "../maths/camera.ts";
import type { SpaceCamera } from "../maths/space_camera.ts";
import type { SpacePoint, Vector2, Vector3 } from "../types.ts";
import type { Body } from "./body.ts";
import type { FollowedPoints } from "./followed_points.ts";
import type { PointMarks } from "./point_marks.ts";

const WHEEL_REST = 350; // milliseconds after the last notch, when the movement along the ray becomes an edit

/** A part of a point under a pointer: its end, or one of its axes. */
export type Hit = { id: number; what: "target" | "source"; axis?: number };

/** The target of a pointer's drag */
export interface Held {
  id: number;
  what: Moved;
  pointer: number;
  from: Vector2;
  at?: Vector2;
  isLoose: boolean;
  /** Whether it has not been moved yet */
  isPress: boolean;
  /** The points that move with it */
  ids: number[];
  /** The body before it is moved, to go along its surface */
  body: Body | null;
}

/** The camera of the view, its body, and the places of a pointer in it. */
export interface Projection {
  readonly camera: SpaceCamera;
  readonly body: Body | null;
  placeOf(event: MouseEvent): Vector2;
}

/** A drag of points by a pointer, or by the wheel. */
export class PointDrag {
  held: Held | null = null;
  /** The direction that it is confined to: a number of `axes` */
  axis: number | null = null;
  /** Whether points go along the surface instead of in the plane of the view */
  isAlongSurface = false;
  #rolled = { ids: [] as number[], id: 0, length: 0, timer: 0 };
  #steps = new WheelSteps();

  constructor(
    readonly points: FollowedPoints,
    readonly marks: PointMarks,
    readonly projection: Projection,
  ) {}

  /** Directions of length 1 along which points are dragged: of space, or of their picture. */
  get axes(): Vector3[] {
    const { lifted } = this.points;
    if (lifted) return [lifted.plane.u, lifted.plane.v];
    return [
      [1, 0, 0],
      [0, 1, 0],
      [0, 0, 1],
    ];
  }

  down(event: PointerEvent, hit: Hit | null) {
    const { marks, points } = this;
    if (!hit || event.button !== 0 || this.held) return;
    this.settle();
    marks.svg.setPointerCapture(event.pointerId);
    event.preventDefault();
    event.stopPropagation();
    const adds = event.shiftKey || event.ctrlKey || event.metaKey;
    if (!points.selected.has(hit.id)) points.select(adds ? [...points.selected, hit.id] : [hit.id]);
    marks.handles.focus(hit.id);
    if (hit.axis !== undefined) this.axis = hit.axis;
    this.held = {
      id: hit.id,
      what: event.altKey && hit.axis === undefined ? "both" : hit.what,
      pointer: event.pointerId,
      from: this.projection.placeOf(event),
      isPress: true,
      isLoose: false,
      ids: [...points.selected],
      body: this.isAlongSurface && hit.axis === undefined ? this.projection.body : null,
    };
  }

  move(event: PointerEvent) {
    const { held, points } = this;
    if (!held || held.pointer !== event.pointerId || points.isLocked) return;
    const at = this.projection.placeOf(event);
    held.at = at;
    held.isLoose = event.altKey;
    if (held.isPress && Math.hypot(at[0] - held.from[0], at[1] - held.from[1]) < 2) return;
    if (held.isPress && !points.begin(held.ids)) return;
    held.isPress = false;
    this.#dragTo(held, at);
  }

  #dragTo(held: Held, at: Vector2) {
    const { before } = this.points,
      point = before?.find((p) => p.id === held.id);
    if (!before || !point) return;
    this.points.move(held.ids, this.#wayOf(held, point, at), held.what, held.id, held.isLoose);
  }

  #wayOf(held: Held, point: SpacePoint, at: Vector2): Vector3 {
    const place = held.what === "source" ? point.source : point.target,
      by: Vector2 = [at[0] - held.from[0], at[1] - held.from[1]],
      { camera } = this.projection;
    if (this.axis === null && held.body) {
      const grip = camera.see(place).at,
        found = held.body.surface(camera.ray([grip[0] + by[0], grip[1] + by[1]]));
      if (found) return difference(found, place);
    }
    return this.way(place, by);
  }

  /** The displacement in space of one on the screen at a place. */
  way(place: Vector3, by: Vector2) {
    const { axis } = this,
      { camera } = this.projection,
      unit = axis === null ? undefined : this.axes[axis];
    return unit ? camera.wayAlong(unit, place, by) : camera.way(place, by);
  }

  up(event: PointerEvent, isCancelled = false) {
    const { held, points } = this;
    if (held?.pointer !== event.pointerId) return;
    this.held = null;
    if (!held.isPress || this.marks.axisOf(event) !== null) this.axis = null;
    points.end(isCancelled);
    points.draw();
  }

  /** Drag along one axis only, until that is called again. */
  lock(axis: number) {
    const { held, points } = this;
    this.axis = this.axis === axis ? null : axis;
    if (points.before && held?.at) this.#dragTo(held, held.at);
    else points.draw();
  }

  /** Cancel a drag; false where there is none. */
  cancel() {
    const { points } = this,
      isDragging = points.before !== null;
    this.axis = this.held = null;
    clearTimeout(this.#rolled.timer);
    this.#rolled.ids = [];
    if (isDragging) points.end(true);
    return isDragging;
  }

  // ---- along the ray ------------------------------------------------------------------------------------------------

  /** Move the selected points along their ray: notches of the wheel away from the viewer, or below 0 to him. */
  roll(event: WheelEvent, voxel: number) {
    const { points } = this,
      rolled = this.#rolled;
    if (this.held || points.isLocked || !points.selected.size) return;
    const notches = -this.#steps.add(event.deltaY * (event.deltaMode === 1 ? 16 : 1));
    if (!notches) return;
    if (!rolled.ids.length) {
      const ids = [...points.selected];
      if (!points.begin(ids)) return;
      Object.assign(rolled, { ids, id: ids[0], length: 0 });
    }
    rolled.length += notches * voxel * (event.shiftKey ? 5 : 1);
    const point = points.before?.find((p) => p.id === rolled.id);
    if (point) points.move(rolled.ids, this.along(point.target, rolled.length), "target", rolled.id, true);
    clearTimeout(rolled.timer);
    rolled.timer = window.setTimeout(() => this.settle(), WHEEL_REST);
  }

  /** A displacement along the ray through a place, away from the viewer. */
  along(place: Vector3, length: number) {
    return scaled(this.projection.camera.toViewer(place), -length);
  }

  /** Make an edit of a movement by the wheel. */
  settle() {
    const rolled = this.#rolled;
    clearTimeout(rolled.timer);
    if (!rolled.ids.length) return;
    rolled.ids = [];
    this.points.end(false);
  }
}
