// The points over a view of the volume as they are drawn: discs and rings, lines to the plane of their picture, and the
// axes along which the selected point can be dragged.

import { Handles } from "../editor/handles.ts";
import { perAxis } from "../maths/axes.ts";
import { added, scaled } from "../maths/camera.ts";
import { spaceLabel, spaceTip } from "../maths/space.ts";
import type { SpaceCamera } from "../maths/space_camera.ts";
import type { FlatPoint, SpacePoint, Vector2, Vector3 } from "../types.ts";
import { setAttributes, svgElement, targetOf } from "../ui/dom.ts";
import type { Body } from "./body.ts";
import type { FollowedPoints } from "./followed_points.ts";

const LATER = 120; // milliseconds between two computations of the hidden points
const PIXELS = { k: 1, x: 0, y: 0, width: 1, height: 1, ratio: 1 }; // a view of handles whose places are CSS pixels
const ARROW = [14, 54, 8] as const; // CSS pixels of an axis: where it begins and ends at the point, and the least that is seen
const STUB = 22; // CSS pixels of the line to the plane, of points that are not selected
export const MOST_LIFTED = 48; // points of a picture that are all shown: of more the selected ones

/** The names of axes: of space, and of a picture. */
export const AXIS_NAMES = { space: ["x", "y", "z"], picture: ["a", "b"] } as const;

/** The axis of a point: an arrow in both directions. */
interface AxisMark {
  group: SVGGElement;
  lines: SVGPathElement[];
}

export class PointMarks {
  svg: SVGSVGElement;
  handles: Handles<FlatPoint>;
  /** The camera of the last drawing */
  seen = "";
  #axisLine: SVGPathElement;
  #stems: SVGPathElement;
  #axes: AxisMark[];
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
    this.#stems = svgElement("path", { class: "dnb-sp-stems", "aria-hidden": "true" }, this.svg);
    this.handles = new Handles(this.svg, (id) => points.numberOf(id), { label: spaceLabel, tip: spaceTip });
    this.#axes = [0, 1, 2].map((k) => {
      const group = svgElement("g", { class: "dnb-sp-arrows", "data-along": k, visibility: "hidden" }, this.svg);
      const lines = ["hit", "case", "ink"].map((part) => svgElement("path", { class: `dnb-sp-arrow-${part}` }, group));
      return { group, lines };
    });
  }

  close() {
    clearTimeout(this.#timer);
    this.svg.remove();
  }

  hide() {
    setAttributes(this.svg, { visibility: "hidden" });
    for (const { group } of this.#axes) setAttributes(group, { visibility: "hidden" });
    this.handles.update([], this.points.selected, PIXELS, 0, 0);
  }

  /** The number of the axis under a pointer, or null. */
  axisOf(event: Event) {
    const found = targetOf(event).closest("[data-along]")?.getAttribute("data-along");
    return found ? Number(found) : null;
  }

  /** The point whose axes are shown: the selected one, of several the first. */
  get lead(): SpacePoint | undefined {
    const { list, selected } = this.points;
    return list.find((p) => selected.has(p.id) && !p.locked);
  }

  /** The points that are shown. */
  get #visiblePoints() {
    const { lifted, list, selected } = this.points;
    return lifted && list.length > MOST_LIFTED ? list.filter((p) => selected.has(p.id)) : list;
  }

  /**
   * Draw the points from a camera.
   * @param axes directions along which they can be dragged
   * @param axis the one that a drag is confined to
   * @returns whether the focus is lost, since its point is gone
   */
  draw(
    camera: SpaceCamera,
    { width, height }: { width: number; height: number },
    axes: Vector3[],
    axis: number | null,
  ) {
    const { before, selected } = this.points;
    setAttributes(this.svg, { visibility: "visible", viewBox: `0 0 ${width} ${height}` });
    const flat = this.#flatFrom(camera);
    if (!before)
      flat.sort((p, q) => q.depth - p.depth); // nearer ones in front; no reordering in a drag
    else flat.sort((p, q) => this.#order.indexOf(p.id) - this.#order.indexOf(q.id));
    this.#order = flat.map((p) => p.id);
    this.#drawAxis(camera, axes, axis);
    this.#drawArrows(camera, axes, axis);
    this.#drawStems(camera);
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
    return this.#visiblePoints.map((p) => {
      const known = this.#flat.get(p);
      if (known) return known;
      const { at, depth } = camera.see(p.target);
      const made = {
        id: p.id,
        name: p.name,
        active: p.active,
        locked: p.locked,
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

  #nameOf(axis: number) {
    return AXIS_NAMES[this.points.lifted ? "picture" : "space"][axis] ?? "x";
  }

  /** The line that a drag is confined to. */
  #drawAxis(camera: SpaceCamera, axes: Vector3[], axis: number | null) {
    const p = axis === null ? undefined : this.lead,
      unit = axis === null ? undefined : axes[axis];
    setAttributes(this.#axisLine, { visibility: p && unit ? "visible" : "hidden" });
    if (!p || !unit || axis === null) return;
    const far = 1000 * camera.see(p.target).scale;
    const end = (sign: number) => camera.see(added(p.target, scaled(unit, sign * far))).at;
    setAttributes(this.#axisLine, { d: `M ${end(-1)} L ${end(1)}`, "data-axis": this.#nameOf(axis) });
  }

  /** Short arrows at the selected point, which are dragged to move along an axis; one seen from its end is not drawn. */
  #drawArrows(camera: SpaceCamera, axes: Vector3[], axis: number | null) {
    const p = this.points.isLocked ? undefined : this.lead;
    this.#axes.forEach(({ group, lines }, k) => {
      const unit = axes[k];
      if (!p || !unit || (axis !== null && axis !== k)) {
        setAttributes(group, { visibility: "hidden" });
        return;
      }
      const { at, scale } = camera.see(p.target),
        end = camera.see(added(p.target, scaled(unit, ARROW[1] * scale))).at,
        way: Vector2 = [end[0] - at[0], end[1] - at[1]],
        length = Math.hypot(...way);
      setAttributes(group, {
        visibility: length < ARROW[2] ? "hidden" : "visible",
        "data-axis": this.#nameOf(k),
        "data-for": p.id,
      });
      if (length < ARROW[2]) return;
      const d = arrowPath(at, [way[0] / length, way[1] / length], ARROW[0], Math.max(ARROW[0] + 12, length));
      for (const line of lines) setAttributes(line, { d });
    });
  }

  /** Lines from points of a picture to its plane, whole ones of selected points: so far it is behind the picture. */
  #drawStems(camera: SpaceCamera) {
    const { lifted, selected } = this.points;
    if (!lifted) {
      setAttributes(this.#stems, { d: "" });
      return;
    }
    const paths = this.#visiblePoints.map((p) => {
      const from = camera.see(p.target).at,
        to = camera.see(lifted.foot(p.target)).at,
        length = Math.hypot(to[0] - from[0], to[1] - from[1]),
        share = selected.has(p.id) ? 1 : Math.min(1, STUB / Math.max(length, 1));
      const end = perAxis((k) => from[k % 2]! + share * (to[k % 2]! - from[k % 2]!));
      return length < 2 ? "" : `M ${from} L ${end[0].toFixed(1)},${end[1].toFixed(1)}`;
    });
    setAttributes(this.#stems, { d: paths.join(" ") });
  }

  /** Mark the points that are behind the body: a hundred steps for each, so not at every movement. */
  lookLater(camera: SpaceCamera, findBody: () => Body | null) {
    const now = performance.now(),
      { points } = this;
    clearTimeout(this.#timer);
    if (now - this.#lookedAt < LATER || points.before) {
      this.#timer = setTimeout(() => points.draw(), LATER);
      return;
    }
    this.#lookedAt = now;
    const body = findBody();
    if (body && points.lifted) points.settle(body);
    for (const p of this.#visiblePoints) {
      const place = p.target,
        isHidden = points.lifted?.misses(p.id) || (body?.hides(place, camera.toViewer(place)) ?? false),
        parts = this.handles.byId.get(p.id);
      if (!parts) continue;
      for (const part of [parts.target, parts.source, parts.arrow]) part.classList.toggle("dnb-sp-hidden", isHidden);
    }
  }
}

/** A line with a head at each end, on either side of a place. */
function arrowPath([x, y]: Vector2, [u, v]: Vector2, from: number, to: number) {
  const at = (along: number, aside: number) =>
    `${(x + along * u - aside * v).toFixed(1)},${(y + along * v + aside * u).toFixed(1)}`;
  const half = (sign: number) =>
    `M ${at(sign * from, 0)} L ${at(sign * to, 0)} M ${at(sign * (to - 6), -4)} L ${at(sign * to, 0)} L ${at(sign * (to - 6), 4)}`;
  return `${half(1)} ${half(-1)}`;
}
