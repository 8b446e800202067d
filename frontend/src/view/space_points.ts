// Control points over a view of the volume: shown, dragged, and put on the first visible surface. They are those of an
// editor in space, or of a picture, onto whose plane they are projected. A view that has the voxels as well (values,
// field, caster) determines which points are behind the body and where a ray meets it; Python finds it for others.

import { isRightClick, POINT_STEPS } from "../editor/handles.ts";
import { perAxis } from "../maths/axes.ts";
import { dot, scaled, unitVector } from "../maths/camera.ts";
import { formatLength } from "../maths/numbers.ts";
import { SpaceCamera } from "../maths/space_camera.ts";
import type { Vector2, Vector3, ViewStroke } from "../types.ts";
import { ARROWS, pageElement, placeIn, setAttributes, svgElement } from "../ui/dom.ts";
import { grabNearest } from "../ui/fingers.ts";
import { Body } from "./body.ts";
import { FollowedPoints } from "./followed_points.ts";
import { PartLoops } from "./part_loops.ts";
import { type Hit, PointDrag } from "./point_drag.ts";
import { AXIS_NAMES, PointMarks } from "./point_marks.ts";
import { PointOptions } from "./point_options.ts";
import { SurfaceRequests } from "./surface_requests.ts";
import type { VolumeViewLike } from "./types.ts";

const REMARK = 4000; // milliseconds for which a remark stays
const SAME_SURFACE = 1.5; // voxels: a point nearer than this to the surface is on it

export class SpacePoints {
  readonly points: FollowedPoints;
  readonly marks: PointMarks;
  readonly loops: PartLoops;
  readonly drag: PointDrag;
  readonly options: PointOptions;
  readonly requests: SurfaceRequests;
  #stroke: { stroke: ViewStroke; pointer: number; from: Vector2; place: Vector3 } | null = null;
  #ring: SVGCircleElement; // of a brush
  #frame = 0; // the request of the next one, or 0
  #liveRegion: HTMLDivElement;
  #closing = new AbortController();

  constructor(readonly view: VolumeViewLike) {
    const { root } = view.elements;
    this.points = new FollowedPoints(
      view.model,
      () => this.draw(),
      () => this.#middle,
    );
    this.marks = new PointMarks(root, this.points);
    this.loops = new PartLoops(this.marks.svg);
    this.drag = new PointDrag(this.points, this.marks, this);
    this.options = new PointOptions(root, this.drag);
    this.requests = new SurfaceRequests(view.messages);
    this.#ring = svgElement("circle", { class: "dnb-sp-brush", visibility: "hidden" }, this.marks.svg);
    this.#liveRegion = pageElement("div", "dnb-ed-spoken", root, { "aria-live": "polite" });
    this.#listen();
    const follow = () => points.follow(view.model.get("points_editor") ?? view.model.get("picture_editor") ?? null),
      { points } = this;
    for (const name of ["points_editor", "picture_editor"]) view.messages.on(`change:${name}`, follow);
    follow().catch((error) => view.fail(error));
  }

  #listen() {
    const { drag, marks, points, view } = this,
      { signal } = this.#closing;
    const on = <K extends keyof SVGElementEventMap>(name: K, handler: (event: SVGElementEventMap[K]) => void) =>
      marks.svg.addEventListener(
        name,
        (event) => {
          if (points.isFollowing) handler(event);
        },
        { signal, passive: false },
      );
    grabNearest(marks.svg, signal);
    on("pointerdown", (e) => {
      if (!this.press(e)) drag.down(e, this.hit(e));
    });
    on("pointermove", (e) => {
      if (!this.#moveStroke(e)) drag.move(e);
    });
    for (const [name, isCancelled] of [
      ["pointerup", false],
      ["pointercancel", true],
      ["lostpointercapture", true],
    ] as const) {
      on(name, (e) => {
        if (!this.#endStroke(e, isCancelled)) drag.up(e, isCancelled);
      });
    }
    on("wheel", (e) => this.wheel(e, true));
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
    view.elements.canvas.addEventListener("pointermove", (e) => this.#hover(e), { signal });
    view.elements.canvas.addEventListener("pointerleave", () => this.#hover(null), { signal });
  }

  close() {
    this.drag.settle();
    this.points.leave();
    cancelAnimationFrame(this.#frame);
    this.#closing.abort();
    this.marks.close();
    this.options.close();
    this.#liveRegion.remove();
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  /** The middle of the visible box, in space. */
  get #middle(): Vector3 {
    const { info, middle } = this.view.camera;
    return perAxis((row) => info.origin[row] + dot(info.axes[row], middle));
  }

  /** The projection of the picture in which points are seen: of two side by side the deformed one. */
  get camera() {
    const {
      camera,
      elements: { box },
    } = this.view;
    const width = Math.max(1, box.width / camera.parts);
    return new SpaceCamera(camera, camera.bend, this.#middle, {
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

  get #isShown() {
    const { points, view } = this;
    return points.isFollowing && Boolean(view.info?.origin) && view.shown !== "original";
  }

  drawNow() {
    cancelAnimationFrame(this.#frame);
    this.#frame = 0;
    const { drag, marks, options, view } = this,
      { box, canvas } = view.elements;
    if (!this.#isShown) {
      marks.hide();
      options.show(null);
      return;
    }
    const { camera } = this;
    const isFocusLost = marks.draw(camera, box, drag.axes, drag.axis);
    this.loops.draw(camera, this.points.parts);
    if (isFocusLost) canvas.focus({ preventScroll: true });
    options.show(marks.lead ? this.#depthWords() : null);
    if (view.values) marks.lookLater(camera, () => this.body);
  }

  /** How far the selected point is behind the surface; "" while it moves and where that is not known. */
  #depthWords() {
    const { marks, points } = this,
      { lead } = marks;
    if (!lead || points.before || points.selected.size !== 1) return "";
    const { body, camera } = this,
      { at, depth } = camera.see(lead.target),
      found = body?.surface(camera.ray(at));
    if (!found || !body) return "";
    const away = depth - camera.see(found).depth,
      { unit } = this.view.camera.info,
      words = `${formatLength(Math.abs(away))} ${unit || "voxels"}`;
    if (Math.abs(away) < SAME_SURFACE * body.step) return "on the surface";
    return away > 0 ? `${words} behind the surface` : `${words} before the surface`;
  }

  get body() {
    const { values, info, field, caster } = this.view,
      { rgba: table, unit } = caster?.voxels.table ?? {};
    if (!values || !info || !table || !unit) return null;
    return new Body({ values, info, field, table, unit, clip: caster?.clip, projection: caster?.projection });
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /** The point under the pointer, or that of an axis. */
  hit(event: Event): Hit | null {
    const { target } = event,
      node = target instanceof Element ? target.closest("[data-id], [data-source], [data-along]") : null;
    if (!(node instanceof SVGElement)) return null;
    const { along, for: of, id, source } = node.dataset;
    if (along !== undefined) return { id: Number(of), what: "target", axis: Number(along) };
    return id !== undefined ? { id: Number(id), what: "target" } : { id: Number(source), what: "source" };
  }

  placeOf(event: MouseEvent) {
    return placeIn(this.view.elements.canvas, event);
  }

  #say(text: string) {
    this.#liveRegion.textContent = text;
  }

  /** A sentence under the view, for some seconds. */
  #hint(text: string) {
    const { elements } = this.view;
    this.#say(text);
    elements.messages.set("points", text, { duration: REMARK });
  }

  remove(hit: Hit | null) {
    const { points } = this;
    if (!hit || points.isLocked) return;
    const number = points.numberOf(hit.id);
    points.remove([hit.id]);
    this.#say(`point ${number} deleted`);
  }

  /** The first visible surface at a place of the view: null where nothing is seen. */
  async #surfaceAt(at: Vector2): Promise<Vector3 | null> {
    const { body, camera } = this;
    if (at[0] < camera.box.left) return null;
    return body ? body.surface(camera.ray(at)) : this.requests.find(camera.ray(at));
  }

  /** Whether points may be put on the volume. */
  get #isEditable() {
    const { points, view } = this;
    return points.isFollowing && !points.isLocked && view.shown !== "original";
  }

  /** Add a point on the first visible surface under a double click, or double tap. */
  async doubleClick(event: MouseEvent) {
    if (!this.#isEditable) return;
    const place = await this.#surfaceAt(this.placeOf(event));
    if (!place) this.#hint("Nothing is seen there: points are put on what is visible");
    else if (this.#isEditable) this.#add(place);
  }

  #add(place: Vector3) {
    const { marks, points } = this,
      id = points.add(place);
    if (id === null) return null;
    points.select([id]);
    this.drawNow(); // else nothing could take the focus
    marks.handles.focus(id);
    this.#say(`point ${points.numberOf(id)} added`);
    return id;
  }

  // ---- the tools of the editor, on the surface ----------------------------------------------------------------------

  /** A press: true if it is for a tool of the editor that is on, such as a brush. */
  press(event: PointerEvent) {
    const { drag, points } = this,
      { tools } = points;
    if (!this.#isEditable || !tools || event.button !== 0 || this.#stroke || drag.held) return false;
    if (!tools.isAdding && !tools.hasTool) return false;
    const at = this.placeOf(event),
      { body, camera } = this,
      place = body && at[0] >= camera.box.left ? body.surface(camera.ray(at)) : null;
    if (!place) return false; // beside the body a drag turns it
    if (tools.isAdding) {
      if (this.hit(event)) return false;
      const id = this.#add(place);
      if (id !== null) drag.down(event, { id, what: "target" });
      return id !== null;
    }
    const stroke = tools.press(points.lifted ? points.lifted.lower(place) : place, event.pointerType === "touch");
    if (!stroke) return false;
    this.#stroke = { stroke, pointer: event.pointerId, from: at, place };
    this.marks.svg.setPointerCapture(event.pointerId);
    event.preventDefault();
    event.stopPropagation();
    return true;
  }

  #moveStroke(event: PointerEvent) {
    const held = this.#stroke;
    if (held?.pointer !== event.pointerId) return false;
    const at = this.placeOf(event),
      way = this.camera.way(held.place, [at[0] - held.from[0], at[1] - held.from[1]]),
      place = perAxis((k) => held.place[k] + way[k]);
    held.stroke.move(this.points.lifted ? this.points.lifted.lower(place) : place, event);
    this.#hover(event);
    return true;
  }

  #endStroke(event: PointerEvent, isCancelled: boolean) {
    const held = this.#stroke;
    if (held?.pointer !== event.pointerId) return false;
    this.#stroke = null;
    held.stroke.end(isCancelled);
    this.draw();
    return true;
  }

  /** Draw the circle of a brush under the pointer. */
  #hover(event: PointerEvent | null) {
    const radius = this.#isEditable ? (this.points.tools?.radius ?? 0) : 0;
    if (!event || !radius || event.pointerType === "touch") {
      setAttributes(this.#ring, { visibility: "hidden" });
      return;
    }
    const at = this.placeOf(event),
      { scale } = this.camera.see(this.#stroke?.place ?? this.#middle);
    setAttributes(this.#ring, { visibility: "visible", cx: at[0], cy: at[1], r: radius / scale });
  }

  /** The wheel on a selected point, or with Alt, moves the selected points along their ray: true if it did. */
  wheel(event: WheelEvent, isOnPoint = false) {
    const { drag, points } = this,
      hit = isOnPoint ? this.hit(event) : null;
    if (!this.#isEditable || !points.selected.size) return false;
    if (!event.altKey && !(hit && points.selected.has(hit.id))) return false;
    event.preventDefault();
    event.stopPropagation();
    drag.roll(event, Math.min(...this.view.camera.info.spacing));
    return true;
  }

  // ---- keys of a point ----------------------------------------------------------------------------------------------

  /** True if the key was taken. */
  key(event: KeyboardEvent) {
    const hit = this.hit(event),
      { drag, points } = this,
      key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (event.ctrlKey || event.metaKey) return this.#commandKey(event, key, hit);
    if (!hit) return false;
    const axis = points.lifted ? -1 : (AXIS_NAMES.space as readonly string[]).indexOf(key),
      arrow = ARROWS[key],
      voxels = event.shiftKey ? 10 : 1;
    if (axis >= 0) {
      drag.lock(axis);
      this.#say(drag.axis === null ? "free" : `along ${key} only`);
    } else if (arrow) this.#nudge(hit.id, voxels, (place) => drag.way(place, arrow));
    else if (key === "PageUp") this.#nudge(hit.id, voxels, (place) => drag.along(place, 1));
    else if (key === "PageDown") this.#nudge(hit.id, voxels, (place) => drag.along(place, -1));
    else if (key === "Delete" || key === "Backspace") this.remove(hit);
    else if (key === "Enter" || key === " ") points.select([hit.id]);
    else if (key === "Escape") {
      if (!drag.cancel()) points.select([]);
      this.draw();
    } else return points.tools?.key(event) ?? false;
    return true;
  }

  /** True if a key with Ctrl was taken. */
  #commandKey(event: KeyboardEvent, key: string, hit: Hit | null) {
    const { drag, marks, points } = this,
      { editor, sender } = points.edited;
    if (hit && POINT_STEPS[key]) {
      const ids = editor.get("points").map((p: { id: number }) => p.id);
      return marks.handles.focusNext(ids, POINT_STEPS[key], hit.id);
    }
    if (key !== "z" && key !== "y") return false;
    drag.settle();
    if (!points.isLocked && !points.before) sender.step(key === "y" || event.shiftKey ? "redo" : "undo");
    return true;
  }

  #nudge(id: number, voxels: number, wayOf: (place: Vector3) => Vector3) {
    const { points } = this,
      p = points.withId(id),
      length = voxels * Math.min(...this.view.camera.info.spacing);
    if (!p || points.isLocked) return;
    if (!points.selected.has(id)) points.select([id]);
    const way = unitVector(wayOf(p.target));
    if (way) points.nudge([...points.selected], scaled(way, length));
  }
}
