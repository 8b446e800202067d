// Control points in space over a view of the volume: shown, dragged, and put on visible tissue. A view that has the
// voxels as well (values, field, caster) determines which points are behind the body and where a ray meets it. Points
// are sent to Python by the sender of their own editor (sync/edits.js).

import { Handles, isRightClick, POINT_STEPS } from "../editor/handles.ts";
import { AXES, type Axis, perAxis } from "../maths/axes.ts";
import type { Camera } from "../maths/camera.ts";
import { added, dot, scaled, unitVector } from "../maths/camera.ts";
import { type Clip, clipSides, leftOf } from "../maths/clipping.ts";
import { addPoint, nextId, removePoints, samePoints } from "../maths/points.ts";
import { spaceLabel, spaceTip, translateInSpace, updateSources } from "../maths/space.ts";
import { FollowedModel, publishPoints, settingsOf } from "../sync/bus.ts";
import type { Sender } from "../sync/edits.ts";
import { senderOf, setTrait } from "../sync/edits.ts";
import type { Bus, FlatPoint, Model, Sides, SpacePoint, Vector2, Vector3 } from "../types.ts";
import { ARROWS, pageElement, placeIn, setAttributes, svgElement } from "../ui/dom.ts";
import type { PlanarField, SpaceField } from "../webgl/types.ts";
import { opacityOfByte } from "../webgl/volume_blocks.ts";
import type { ScreenBox } from "./pointer.ts";
import type { Field, VolumeInfo, VolumeViewLike } from "./types.ts";

export type PointEnd = "target" | "source";
export type Hit = { id: number; what: PointEnd };

/** The target of a pointer's drag */
export interface Held {
  id: number;
  what: PointEnd | "both";
  pointer: number;
  from: Vector2;
  at?: Vector2;
  /** Whether it has not been moved yet */
  isPress: boolean;
  /** The points that move with it */
  ids: number[];
}

const LATER = 120; // milliseconds between two computations of the hidden points
const PIXELS = { k: 1, x: 0, y: 0, width: 1, height: 1, ratio: 1 }; // a view of handles whose places are CSS pixels
const AXIS_NAMES = ["x", "y", "z"] as const;
const HALF_SEEN = 0.5; // a surface is where half of the light is stopped

// ---- rays between a view and the volume in it; no DOM ---------------------------------------------------------------

/** The projection of space on one picture: from places to pixels and back. */
export class SpaceCamera {
  right: Vector3;
  up: Vector3;
  ahead: Vector3;
  half: Vector2;
  bend: number;
  eye: Vector3;

  /**
   * @param bend of a perspective
   * @param middle of the visible box
   * @param box of the picture
   */
  constructor(
    camera: Camera,
    bend: number,
    middle: Vector3,
    public box: ScreenBox,
  ) {
    const { right, up, direction, pan, height } = camera,
      aspect = box.width / box.height;
    this.right = right;
    this.up = up;
    this.ahead = direction;
    this.half = [(height / 2) * aspect, height / 2];
    this.bend = bend / height;
    this.eye = added(middle, added(scaled(right, pan[0]), scaled(up, pan[1])));
  }

  /** The pixel of a place, its distance, and the length in space of one pixel there. */
  see(place: Vector3): { at: Vector2; depth: number; scale: number } {
    const { box, bend, half } = this,
      from = perAxis((k) => place[k] - this.eye[k]),
      depth = dot(from, this.ahead);
    const near = bend > 0 ? Math.max(1e-6, 1 + depth * bend) : 1; // how much smaller things appear there
    const a = dot(from, this.right) / near / half[0],
      b = dot(from, this.up) / near / half[1];
    return {
      at: [box.left + ((a + 1) / 2) * box.width, box.top + ((1 - b) / 2) * box.height],
      depth,
      scale: (2 * half[1] * near) / box.height,
    };
  }

  /** The displacement in space, parallel to the screen, of one on it at a place. */
  way(place: Vector3, [dx, dy]: Vector2): Vector3 {
    const { scale } = this.see(place);
    return added(scaled(this.right, dx * scale), scaled(this.up, -dy * scale));
  }

  /** The same along one axis of space: as far as brings its picture nearest to the pointer. */
  wayAlong(axis: Axis, place: Vector3, [dx, dy]: Vector2): Vector3 {
    const { at, scale } = this.see(place),
      unit = perAxis((k) => (k === axis ? 1 : 0));
    const there = this.see(added(place, scaled(unit, scale))).at,
      [u, v] = [there[0] - at[0], there[1] - at[1]];
    const steep = u * u + v * v;
    if (steep < 0.01) return [0, 0, 0]; // seen from its end it does not move
    return scaled(unit, (scale * (dx * u + dy * v)) / steep);
  }

  /** The ray of a pixel. */
  ray([x, y]: Vector2): { start: Vector3; ray: Vector3 } {
    const { box, half, bend } = this;
    const a = ((x - box.left) / box.width) * 2 - 1,
      b = 1 - ((y - box.top) / box.height) * 2;
    const aside = added(scaled(this.right, a * half[0]), scaled(this.up, b * half[1]));
    if (!(bend > 0)) return { start: added(this.eye, aside), ray: this.ahead };
    const ray = normalized(added(aside, scaled(this.ahead, 1 / bend)));
    return { start: added(this.eye, scaled(this.ahead, -1 / bend)), ray };
  }

  /** The direction from a place to the viewer. */
  toViewer(place: Vector3) {
    if (!(this.bend > 0)) return scaled(this.ahead, -1);
    const eye = added(this.eye, scaled(this.ahead, -1 / this.bend));
    return normalized(perAxis((k) => eye[k] - place[k]));
  }
}

/** A vector that is not zero, with length 1. */
function normalized(vector: Vector3): Vector3 {
  return unitVector(vector) ?? vector;
}

/**
 * The deformed body as the ray caster sees it, for a few rays; lengths along the index axes, from the first voxel.
 */
export class Body {
  values: Uint8Array<ArrayBufferLike>;
  info: VolumeInfo;
  space: SpaceField | null;
  planar: PlanarField | null;
  table: Float32Array<ArrayBufferLike>;
  unit: number;
  box: Sides;
  step: number;

  constructor({
    values,
    info,
    field,
    table,
    unit,
    clip,
  }: {
    values: Uint8Array;
    info: VolumeInfo;
    field?: Field | null;
    table: Float32Array;
    /** The thickness that the table's opacities hold for */
    unit: number;
    clip?: Clip | null;
  }) {
    const box = field?.box ?? info.box;
    this.values = values;
    this.info = info;
    // Cuts are left out: a place at one would need the choice of the shader.
    this.space = field?.space && !field.space.cut ? field.space : null;
    this.planar = field?.planar && !field.planar.cut ? field.planar : null;
    this.table = table;
    this.unit = unit;
    this.box = clip ? leftOf(box, clipSides(box, clip)) : box; // tissue cut away is no body
    this.step = Math.min(...info.spacing);
  }

  /** A place of space in the volume's own frame. */
  toFrame(place: Vector3) {
    return this.turned(perAxis((k) => place[k] - this.info.origin[k]));
  }

  /** A vector of space in the volume's own frame. */
  turned(vector: Vector3) {
    return perAxis((k) => dot(this.info.to_frame[k], vector));
  }

  /** The origin of the value at x. */
  origin(x: Vector3) {
    const { planar, space } = this,
      moved = planar ? added(x, planarAt(planar, x)) : x;
    return space ? added(moved, sampleAt(space, moved)) : moved;
  }

  opacity(x: Vector3) {
    const { shape, spacing } = this.info,
      from = this.origin(x),
      at = perAxis((k) => Math.round(from[k] / spacing[k]));
    if (AXES.some((k) => at[k] < 0 || at[k] >= shape[k])) return 0;
    return opacityOfByte(this.table, this.values[(at[2] * shape[1] + at[1]) * shape[0] + at[0]]!);
  }

  /** The place in the box where half of the light along a ray is stopped, as a length along it, or null. */
  meet(start: Vector3, ray: Vector3, from = 0) {
    const { low, high } = this.box;
    let first = from,
      last = Infinity;
    for (const k of AXES) {
      const slope = Math.abs(ray[k]) < 1e-9 ? 1e-9 : ray[k];
      const a = (low[k] - start[k]) / slope,
        b = (high[k] - start[k]) / slope;
      first = Math.max(first, Math.min(a, b));
      last = Math.min(last, Math.max(a, b));
    }
    let left = 1;
    for (let t = first + this.step / 2; t < last; t += this.step) {
      left *= (1 - Math.min(0.9999, this.opacity(added(start, scaled(ray, t))))) ** (this.step / this.unit);
      if (left < 1 - HALF_SEEN) return t;
    }
    return null;
  }

  /**
   * True if tissue is between a place in space and the viewer; tissue nearer than two voxels does not count.
   */
  hides(place: Vector3, toViewer: Vector3) {
    return this.meet(this.toFrame(place), normalized(this.turned(toViewer)), 2 * this.step) !== null;
  }

  /** The place in space where a ray in space meets the body, or null. */
  surface({ start, ray }: { start: Vector3; ray: Vector3 }) {
    const t = this.meet(this.toFrame(start), normalized(this.turned(ray)), -Infinity);
    return t === null ? null : added(start, scaled(ray, t));
  }
}

/** A displacement sampled in space, between its samples; x in the frame of the volume. */
function sampleAt({ shape: n, origin, spacing, values }: SpaceField, x: Vector3) {
  const q = perAxis((k) => Math.max(0, Math.min(n[k] - 1, (x[k] - origin[k]) / spacing[k])));
  const i = perAxis((k) => Math.max(0, Math.min(n[k] - 2, Math.floor(q[k])))),
    f = perAxis((k) => q[k] - i[k]);
  const sum: Vector3 = [0, 0, 0];
  for (let corner = 0; corner < 8; corner++) {
    const at = perAxis((k) => Math.min(n[k] - 1, i[k] + ((corner >> k) & 1)));
    const weight = AXES.reduce<number>((w, k) => w * ((corner >> k) & 1 ? f[k] : 1 - f[k]), 1);
    const j = 3 * ((at[2] * n[1] + at[1]) * n[0] + at[0]);
    if (weight) for (const m of AXES) sum[m] += weight * values[j + m]!;
  }
  return sum;
}

/** The displacement of maps over a plane, weighted along its normal. */
function planarAt(
  { shape: [count, rows, columns], origin, spacing, depth, plane, maps, weights }: PlanarField,
  x: Vector3,
) {
  const { origin: o, u, v, n } = plane,
    from = perAxis((k) => x[k] - o[k]),
    knots = weights.length / count;
  const clamp = (value: number, most: number) => Math.max(0, Math.min(most, value));
  const p = clamp((dot(from, u) - origin[0]) / spacing[0], columns - 1);
  const q = clamp((dot(from, v) - origin[1]) / spacing[1], rows - 1);
  const z = depth[1] > depth[0] ? clamp((dot(from, n) - depth[0]) / (depth[1] - depth[0]), 1) * (knots - 1) : 0;
  const before = (at: number, nodes: number) => Math.max(0, Math.min(nodes - 2, Math.floor(at)));
  const [i, j, k] = [before(p, columns), before(q, rows), before(z, knots)];
  const s = p - i,
    t = q - j,
    w = z - k,
    sum: Vector2 = [0, 0];
  for (let m = 0; m < count; m++) {
    const weight = weights[m * knots + k]! * (1 - w) + (knots > 1 ? weights[m * knots + k + 1]! * w : 0);
    if (!weight) continue;
    const row = (m * rows + j) * columns + i,
      down = rows > 1 ? columns : 0,
      east = columns > 1 ? 1 : 0;
    for (const c of [0, 1] as const) {
      const value = (at: number) => maps[2 * at + c]!;
      sum[c] +=
        weight *
        ((1 - t) * ((1 - s) * value(row) + s * value(row + east)) +
          t * ((1 - s) * value(row + down) + s * value(row + down + east)));
    }
  }
  return added(scaled(u, sum[0]), scaled(v, sum[1]));
}

// ---- points over the view -------------------------------------------------------------------------------------------

/** The points of the editor that a view follows, as this window has them, and those of them that are selected. */
class FollowedPoints {
  list: SpacePoint[] = [];
  selected = new Set<number>();
  /** The points as a drag began; null without one */
  before: SpacePoint[] | null = null;
  #id = Math.random().toString(36).slice(2, 12);
  #followed: FollowedModel;
  #edited: { editor: Model; bus: Bus; sender: Sender<Vector3> } | null = null;

  /** @param draw called when the points have changed */
  constructor(
    owner: Model,
    readonly draw: () => void,
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
      if (detail.origin === this.#id || this.before) return;
      this.list = detail.phase === "move" ? (detail.points as SpacePoint[]) : sender.points;
      this.draw();
    });
    const chosen = () => {
      this.selected = new Set(editor.get("selected") ?? []);
      this.draw();
    };
    editor.on("change:selected", chosen);
    const unlisten = sender.listen((what: string) => {
      if (what === "points") this.receive();
    });
    followed.ends.push(unlisten, () => editor.off("change:selected", chosen));
    sender.receive();
    this.list = sender.points;
    chosen();
  }

  leave() {
    this.#followed.end();
    this.#edited = this.before = null;
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

  get isLocked() {
    const { editor } = this.edited;
    return Boolean(editor.get("read_only") || editor.get("waiting"));
  }

  receive() {
    const { points } = this.edited.sender;
    if (this.before) {
      // Python has found a new point's source; the drag's values stay
      this.before = updateSources(this.before, points);
      this.list = updateSources(this.list, points);
    } else this.list = points;
    this.draw();
  }

  select(ids: number[]) {
    this.selected = new Set(ids);
    setTrait(this.edited.editor, "selected", [...ids]);
    this.draw();
  }

  /** Show the points of a drag, here and in other views. */
  show(points: SpacePoint[]) {
    this.list = points;
    this.#publish("move");
    this.edited.sender.move(points);
    this.draw();
  }

  /** Revert a drag, also in Python, which has received it. */
  revert() {
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

/** The points as they are drawn. */
class PointMarks {
  svg: SVGSVGElement;
  handles: Handles<FlatPoint>;
  /** The camera of the last drawing */
  seen = "";
  #axisLine: SVGPathElement;
  #order: number[] = []; // ids, the farthest first
  #flat: WeakMap<SpacePoint, FlatPoint & { depth: number }> = new WeakMap(); // points on the picture from the camera `seen`
  #lookedAt = -Infinity;
  #timer = 0;

  constructor(
    root: HTMLElement,
    readonly points: FollowedPoints,
  ) {
    this.svg = svgElement("svg", { class: "dnb-sp-over", visibility: "hidden" }, root);
    this.#axisLine = svgElement("path", { class: "dnb-sp-axis", visibility: "hidden" }, this.svg);
    this.handles = new Handles(this.svg, { label: spaceLabel, tip: spaceTip });
  }

  close() {
    clearTimeout(this.#timer);
    this.svg.remove();
  }

  hide() {
    setAttributes(this.svg, { visibility: "hidden" });
    this.handles.update([], this.points.selected, PIXELS, 0, 0);
  }

  /** Returns whether the focus is lost, since its point is gone. */
  draw(camera: SpaceCamera, { width, height }: { width: number; height: number }, axis: Axis | null) {
    const { before, selected } = this.points;
    setAttributes(this.svg, { visibility: "visible", viewBox: `0 0 ${width} ${height}` });
    const flat = this.#flatFrom(camera);
    if (!before)
      flat.sort((p, q) => q.depth - p.depth); // nearer ones in front; no reordering in a drag
    else flat.sort((p, q) => this.#order.indexOf(p.id) - this.#order.indexOf(q.id));
    this.#order = flat.map((p) => p.id);
    this.#drawAxis(camera, axis);
    return this.handles.update(flat, selected, { ...PIXELS, width, height }, 0, 0);
  }

  /**
   * The points on the picture; those that have not moved since the last frame are the same objects, not drawn again.
   */
  #flatFrom(camera: SpaceCamera) {
    const seen = JSON.stringify(camera);
    if (seen !== this.seen) {
      this.seen = seen;
      this.#flat = new WeakMap();
    }
    return this.points.list.map((p) => {
      const known = this.#flat.get(p);
      if (known) return known;
      const { at, depth } = camera.see(p.target);
      const made = {
        id: p.id,
        name: p.name,
        active: p.active,
        target: at,
        source: camera.see(p.source).at,
        depth,
        away: 0,
        isFar: false,
        whole: p,
      };
      this.#flat.set(p, made);
      return made;
    });
  }

  #drawAxis(camera: SpaceCamera, axis: Axis | null) {
    const { list, selected } = this.points,
      p = axis === null ? null : list.find((q) => selected.has(q.id));
    setAttributes(this.#axisLine, { visibility: p ? "visible" : "hidden" });
    if (!p || axis === null) return;
    const far = 1000 * camera.see(p.target).scale,
      unit = perAxis((k) => (k === axis ? far : 0));
    const end = (sign: number) => camera.see(added(p.target, scaled(unit, sign))).at;
    setAttributes(this.#axisLine, { d: `M ${end(-1)} L ${end(1)}`, "data-axis": AXIS_NAMES[axis] });
  }

  /** Mark the points that are behind the body: a hundred steps for each, so not at every movement. */
  lookLater(camera: SpaceCamera, findBody: () => Body | null) {
    const now = performance.now(),
      { points } = this;
    clearTimeout(this.#timer);
    if (now - this.#lookedAt < LATER) {
      this.#timer = setTimeout(() => points.draw(), LATER);
      return;
    }
    this.#lookedAt = now;
    const body = findBody();
    for (const p of points.list) {
      const place = p.target,
        isHidden = body?.hides(place, camera.toViewer(place)) ?? false,
        parts = this.handles.byId.get(p.id);
      if (!parts) continue;
      for (const part of [parts.target, parts.source, parts.arrow]) part.classList.toggle("dnb-sp-hidden", isHidden);
    }
  }
}

/** The camera of the view, and the places of a pointer in it. */
type Projection = Pick<SpacePoints, "camera" | "placeOf">;

/** A drag of points by a pointer, parallel to the screen or along one axis of space. */
class PointDrag {
  held: Held | null = null;
  axis: Axis | null = null; // that it is confined to

  constructor(
    readonly points: FollowedPoints,
    readonly marks: PointMarks,
    readonly projection: Projection,
  ) {}

  down(event: PointerEvent, hit: Hit | null) {
    const { marks, points } = this;
    if (!hit || event.button !== 0 || this.held) return;
    marks.svg.setPointerCapture(event.pointerId);
    event.preventDefault();
    event.stopPropagation();
    const adds = event.shiftKey || event.ctrlKey || event.metaKey;
    if (!points.selected.has(hit.id)) points.select(adds ? [...points.selected, hit.id] : [hit.id]);
    marks.handles.focus(hit.id);
    this.held = {
      ...hit,
      what: event.altKey ? "both" : hit.what,
      pointer: event.pointerId,
      from: this.projection.placeOf(event),
      isPress: true,
      ids: [...points.selected],
    };
  }

  move(event: PointerEvent) {
    const { held, points } = this,
      at = this.projection.placeOf(event);
    if (!held || held.pointer !== event.pointerId || points.isLocked) return;
    held.at = at;
    if (held.isPress && Math.hypot(at[0] - held.from[0], at[1] - held.from[1]) < 2) return;
    if (held.isPress) {
      held.isPress = false;
      points.before = points.list;
    }
    this.#dragTo(held, at);
  }

  #dragTo(held: Held, at: Vector2) {
    const { before } = this.points,
      point = before?.find((p) => p.id === held.id);
    if (!before || !point) return;
    const place = held.what === "source" ? point.source : point.target;
    const way = this.way(place, [at[0] - held.from[0], at[1] - held.from[1]]);
    this.points.show(translateInSpace(before, held.ids, way, held.what));
  }

  /** The displacement in space of one on the screen at a place. */
  way(place: Vector3, by: Vector2) {
    const { axis } = this,
      { camera } = this.projection;
    return axis === null ? camera.way(place, by) : camera.wayAlong(axis, place, by);
  }

  up(event: PointerEvent, isCancelled = false) {
    const { held, points } = this,
      { before, list } = points;
    if (held?.pointer !== event.pointerId) return;
    this.held = points.before = null;
    if (!before) return;
    this.axis = null;
    if (!isCancelled && !points.isLocked && !samePoints(list, before)) points.edited.sender.edit(list, "move");
    else points.revert();
    points.draw();
  }

  /** Drag along x, y or z only, until that is called again. */
  lock(axis: Axis) {
    const { held, points } = this;
    this.axis = this.axis === axis ? null : axis;
    if (points.before && held?.at) this.#dragTo(held, held.at);
    else points.draw();
  }

  /** Cancel a drag; false where there is none. */
  cancel() {
    const { points } = this,
      isDragging = points.before !== null;
    this.axis = null;
    if (isDragging) {
      this.held = points.before = null;
      points.revert();
    }
    return isDragging;
  }
}

export class SpacePoints {
  readonly points: FollowedPoints;
  readonly marks: PointMarks;
  readonly drag: PointDrag;
  #frame = 0; // the request of the next one, or 0
  #liveRegion: HTMLDivElement;
  #closing = new AbortController();

  constructor(readonly view: VolumeViewLike) {
    const { root } = view.elements;
    this.points = new FollowedPoints(view.model, () => this.draw());
    this.marks = new PointMarks(root, this.points);
    this.drag = new PointDrag(this.points, this.marks, this);
    this.#liveRegion = pageElement("div", "dnb-ed-spoken", root, { "aria-live": "polite" });
    const { drag, points } = this;
    const on = <K extends keyof SVGElementEventMap>(name: K, handler: (event: SVGElementEventMap[K]) => void) =>
      this.marks.svg.addEventListener(
        name,
        (event) => {
          if (points.isFollowing) handler(event);
        },
        { signal: this.#closing.signal },
      );
    on("pointerdown", (e) => drag.down(e, this.hit(e)));
    on("pointermove", (e) => drag.move(e));
    on("pointerup", (e) => drag.up(e));
    on("pointercancel", (e) => drag.up(e, true));
    on("lostpointercapture", (e) => drag.up(e, true));
    on("keydown", (e) => {
      if (this.key(e)) {
        e.preventDefault();
        e.stopPropagation();
      }
    });
    on("contextmenu", (e) => {
      e.preventDefault();
      if (isRightClick(e)) this.remove(this.hit(e));
    });
    on("dblclick", (e) => {
      e.preventDefault();
      e.stopPropagation();
    });
    const follow = () => points.follow(view.model.get("points_editor"));
    view.messages.on("change:points_editor", follow);
    follow().catch((error) => view.fail(error));
  }

  close() {
    this.points.leave();
    cancelAnimationFrame(this.#frame);
    this.#closing.abort();
    this.marks.close();
    this.#liveRegion.remove();
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  /** The projection of the picture in which points are seen: of two side by side the deformed one. */
  get camera() {
    const {
        camera,
        elements: { box },
      } = this.view,
      { info, middle } = camera;
    const place = perAxis((row) => info.origin[row] + dot(info.axes[row], middle));
    const width = Math.max(1, box.width / camera.parts);
    return new SpaceCamera(camera, camera.bend, place, {
      left: box.width - width,
      top: 0,
      width,
      height: Math.max(1, box.height),
    });
  }

  /** Draw in the next frame, however often points, camera and field change before it. */
  draw() {
    if (!this.#frame) this.#frame = requestAnimationFrame(() => this.drawNow());
  }

  drawNow() {
    cancelAnimationFrame(this.#frame);
    this.#frame = 0;
    const { marks, points, view } = this,
      { box, canvas } = view.elements;
    if (!points.isFollowing || !view.info?.origin || view.shown === "original") {
      marks.hide();
      return;
    }
    const { camera } = this;
    const isFocusLost = marks.draw(camera, box, this.drag.axis);
    if (isFocusLost) canvas.focus({ preventScroll: true });
    if (view.values) marks.lookLater(camera, () => this.body);
  }

  get body() {
    const { values, info, field, caster } = this.view,
      { rgba: table, unit } = caster?.voxels.table ?? {};
    if (!values || !info || !table || !unit) return null;
    return new Body({ values, info, field, table, unit, clip: caster?.clip });
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /** The point under the pointer. */
  hit(event: Event): Hit | null {
    const { target } = event,
      node = target instanceof Element ? target.closest("[data-id], [data-source]") : null;
    if (!(node instanceof SVGElement)) return null;
    return node.dataset.id !== undefined
      ? { id: Number(node.dataset.id), what: "target" }
      : { id: Number(node.dataset.source), what: "source" };
  }

  placeOf(event: MouseEvent) {
    return placeIn(this.view.elements.canvas, event);
  }

  #say(text: string) {
    this.#liveRegion.textContent = text;
  }

  remove(hit: Hit | null) {
    const { points } = this;
    if (!hit || points.isLocked) return;
    points.edited.sender.edit(removePoints(points.list, [hit.id]), "remove");
    this.#say(`point ${hit.id} deleted`);
  }

  /** Add a point on the first surface under a double click. False where there is none, or nothing is edited. */
  doubleClick(event: MouseEvent) {
    const { points } = this;
    if (!points.isFollowing || points.isLocked || this.view.shown === "original") return false;
    const at = this.placeOf(event),
      { body, camera } = this,
      { sender } = points.edited;
    if (!body || at[0] < camera.box.left) return false;
    const place = body.surface(camera.ray(at));
    if (!place) return false;
    const id = nextId(points.list, sender.nextId);
    sender.edit(addPoint(points.list, id, place, place), "add"); // Python finds its source
    points.select([id]);
    this.drawNow(); // else nothing could take the focus
    this.marks.handles.focus(id);
    this.#say(`point ${id} added`);
    return true;
  }

  // ---- keys of a point ----------------------------------------------------------------------------------------------

  /** True if the key was taken. */
  key(event: KeyboardEvent) {
    const hit = this.hit(event),
      { drag, points } = this,
      key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (event.ctrlKey || event.metaKey) return this.#commandKey(key, event.shiftKey, hit);
    if (!hit) return false;
    const axis = AXES.find((k) => AXIS_NAMES[k] === key),
      arrow = ARROWS[key];
    if (axis !== undefined) {
      drag.lock(axis);
      this.#say(drag.axis === null ? "free" : `along ${AXIS_NAMES[axis]} only`);
    } else if (arrow) this.#nudge(hit.id, arrow, event.shiftKey ? 10 : 1);
    else if (key === "Delete" || key === "Backspace") this.remove(hit);
    else if (key === "Enter" || key === " ") points.select([hit.id]);
    else if (key === "Escape") {
      if (!drag.cancel()) points.select([]);
      this.draw();
    } else return false;
    return true;
  }

  /** True if a key with Ctrl was taken. */
  #commandKey(key: string, isShifted: boolean, hit: Hit | null) {
    const { marks, points } = this,
      { editor, sender } = points.edited;
    if (hit && POINT_STEPS[key]) {
      const ids = editor.get("points").map((p: SpacePoint) => p.id);
      return marks.handles.focusNext(ids, POINT_STEPS[key], hit.id);
    }
    if (key !== "z" && key !== "y") return false;
    if (!points.isLocked && !points.before) sender.step(key === "y" || isShifted ? "redo" : "undo");
    return true;
  }

  #nudge(id: number, by: Vector2, voxels: number) {
    const { points } = this,
      p = points.list.find((q) => q.id === id),
      length = voxels * Math.min(...this.view.camera.info.spacing);
    if (!p || points.isLocked) return;
    if (!points.selected.has(id)) points.select([id]);
    const way = unitVector(this.drag.way(p.target, by)),
      ids = [...points.selected];
    if (way)
      points.edited.sender.edit(translateInSpace(points.list, ids, scaled(way, length)), "nudge", `nudge ${ids}`);
  }
}
