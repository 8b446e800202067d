// The control points as SVG over the picture: a ring where a feature was, an arrow, a disc where it should be.
// Their shapes differ as well as their colours: ring = source, disc = target, hollow square = switched off.

import { difference } from "../maths/camera.ts";
import { formatLength } from "../maths/numbers.ts";
import { nameOf } from "../maths/point_names.ts";
import { middleOf } from "../maths/points.ts";
import type { Mirror, Vector, Vector2 } from "../types.ts";
import { OWN_KEYS, setAttributes, setText, svgElement, treeOf } from "../ui/dom.ts";
import type { View } from "./painter.ts";
import { REGION_FORMS } from "./shape_handles.ts";

/** A point as it is drawn, in a picture's coordinates. */
export type DrawnPoint = {
  id: number;
  name: string;
  source: Vector;
  target: Vector;
  active: boolean;
  locked?: boolean;
  radius?: number | null;
};

/** Descriptions of a point, for screen readers and where the mouse rests. */
export type PointWords<P extends DrawnPoint> = {
  label: (p: P, number: number) => string;
  tip: (p: P, number: number, reach: number) => string;
};

/** The state that ToolMarks draw. */
export interface MarksScene {
  mirror: Mirror;
  view: View;
  /** CSS pixels from the edge of the view to the grip of the axis */
  gripAway?: number;
  points: { id: number; target: Vector2; locked?: boolean }[];
  selected: Set<number>;
  brush: { isOn: boolean; at?: Vector2 | null; radius?: number };
  pen: { isOn: boolean };
  isLocked: boolean;
  /** Whether points are being dragged */
  isHolding: boolean;
  isAdding: boolean;
  toView: (place: Vector2) => Vector2;
}

/** The elements of a point, and their state. */
export interface HandleParts {
  arrow: SVGGElement;
  source: SVGGElement;
  target: SVGGElement;
  /** Of the target and of the source: what lies around their places */
  discs: SVGCircleElement[];
  rings: SVGCircleElement[];
  /** What only points in some state show, such as their names: not laid out for the others */
  more: SVGGElement;
  radius: SVGCircleElement;
  tip: SVGTitleElement;
  /** The form of a region and its dark edge */
  forms: SVGPathElement[];
  beyond: SVGPathElement;
  text: SVGTextElement;
  mark: number | null;
  drawn: unknown[];
}

const QUIET_NAME = /^(move|grow|shrink|smudge|expand|hold) \d+$| rim$/; // names that tools give: shown under the mouse, as numbers are
export const POINT_STEPS: Record<string, number> = { ArrowLeft: -1, ArrowUp: -1, ArrowRight: 1, ArrowDown: 1 }; // with Ctrl: to another point
const RIM = 11; // CSS pixels from the edge at which points outside the view are shown

/**
 * Whether the right button was pressed. Other ways to a menu delete nothing: a finger that rests, a Mac's Ctrl + click,
 * a key.
 */
export function isRightClick(event: MouseEvent) {
  return event.button === 2 && !event.ctrlKey && !(event instanceof PointerEvent && event.pointerType === "touch");
}

/** Steps of a wheel: a notch is about 100 pixels, a trackpad sends many small movements. */
export class WheelSteps {
  #rolled = 0;

  /**
   * Whole steps that are due, below 0 upwards.
   * @param delta pixels
   */
  add(delta: number) {
    this.#rolled += delta;
    const parts = Math.trunc(this.#rolled / 40);
    if (parts === 0) return 0;
    this.#rolled = 0;
    return Math.sign(parts) * Math.max(1, Math.floor(Math.abs(parts) / 2));
  }
}

/** A path of absolute commands, moved to a place: a transform of each point would cost every frame its share. */
export function pathAt(path: string, x: number, y: number) {
  return path.replace(/([MLHVAZ])([^MLHVAZ]*)/g, (_, command: string, given: string) => {
    const numbers = (given.match(/-?\d*\.?\d+/g) ?? []).map(Number),
      isArc = command === "A";
    const moved = numbers.map((value, k) => {
      if (isArc && k % 7 < 5) return value; // radii, angle and flags
      const isAcross = command === "H" || (command !== "V" && (isArc ? k % 7 === 5 : k % 2 === 0));
      return (value + (isAcross ? x : y)).toFixed(2);
    });
    return command + moved.join(" ");
  });
}

/** The description of a point for screen readers. */
export function pointLabel(p: DrawnPoint, number: number) {
  const da = p.target[0] - p.source[0],
    db = p.target[1] - p.source[1];
  const moves: string[] = [];
  if (da) moves.push(`${formatLength(Math.abs(da))} ${da > 0 ? "right" : "left"}`);
  if (db) moves.push(`${formatLength(Math.abs(db))} ${db > 0 ? "down" : "up"}`);
  const drag = moves.length ? `dragged ${moves.join(", ")}` : "not dragged";
  const name = p.name ? ` ${p.name}` : "";
  const states = `${p.active ? "" : ", switched off"}${p.locked ? ", locked" : ""}`;
  return `Point ${number}${name}, at ${p.target.map(formatLength).join(", ")}, ${drag}${states}`;
}

/** The text where the mouse rests on a point. */
function pointTip(p: DrawnPoint, number: number, reach: number) {
  const by = difference(p.target, p.source);
  const place = (at: Vector) => at.map(formatLength).join(", ");
  const drag = by.some((value) => value !== 0) ? `dragged by ${place(by)} from ${place(p.source)}` : "not dragged";
  const state = !p.active ? "; switched off" : reach ? `; reaches ${formatLength(reach)}` : "";
  return `${nameOf(p, number)}: ${drag}${state}`;
}

/** The points as elements, which can have the focus and be dragged. */
export class Handles<P extends DrawnPoint = DrawnPoint> {
  radii: SVGGElement;
  arrows: SVGGElement;
  points: SVGGElement;
  band: SVGRectElement;
  byId = new Map<number, HandleParts>();
  /** Ids of points that get a dashed ring. */
  suspects = new Set<number>();
  /** The one tab stop: the point in focus, or the last one. */
  stop: number | null = null;

  constructor(
    readonly svg: SVGSVGElement,
    readonly numberOf: (id: number) => number,
    readonly words: PointWords<P> = { label: pointLabel, tip: pointTip },
  ) {
    this.radii = svgElement("g", { class: "dnb-ed-radii", "aria-hidden": "true" }, svg);
    this.arrows = svgElement("g", { class: "dnb-ed-arrows", "aria-hidden": "true" }, svg);
    this.points = svgElement("g", { class: "dnb-ed-points", role: "group", "aria-label": "Points" }, svg);
    this.band = svgElement("rect", { class: "dnb-ed-band", visibility: "hidden" }, svg);
    // Not on the SVG: Chromium takes a part of an SVG that listens to the focus for one that can have it.
    svg.parentElement?.addEventListener("focusin", ({ target }) => {
      const point = target instanceof Element && this.points.contains(target) ? target.closest("[data-id]") : null;
      if (point) this.#stopAt(Number(point.getAttribute("data-id")));
    });
  }

  /**
   * Draw all points for a view. True if the focus was on a point that is gone: the browser would give it to the body.
   * @param radius around the selected points in units of the picture, or 0 for none
   * @param reach for the tips
   * @param markOf the number of the region of a point (editor/shape_handles.js)
   */
  update(
    points: P[],
    selected: Set<number>,
    view: View,
    radius: number,
    reach: number,
    markOf: (point: P) => number | null = () => null,
  ) {
    const seen = new Set(points.map((p) => p.id)),
      focused = treeOf(this.svg).activeElement;
    let isFocusLost = false;
    for (const [id, parts] of this.byId) {
      if (seen.has(id)) continue;
      isFocusLost ||= parts.target === focused;
      for (const part of [parts.arrow, parts.source, parts.target, parts.radius]) part.remove();
      this.byId.delete(id);
      if (id === this.stop) this.stop = null;
    }
    points.forEach((p, k) => {
      const parts = this.byId.get(p.id) ?? this.make(p.id);
      if (this.points.children[2 * k + 1] !== parts.target) this.#order(points);
      const hasRadius = radius > 0 && p.active && (selected.size === 0 || selected.has(p.id)),
        mark = markOf(p);
      const isSelected = selected.has(p.id),
        isSuspect = this.suspects.has(p.id);
      const number = this.numberOf(p.id);
      const drawn = [
        p,
        number,
        isSelected,
        isSuspect,
        hasRadius && radius,
        reach,
        mark,
        view.k,
        view.x,
        view.y,
        view.width,
        view.height,
      ];
      if (drawn.every((value, n) => value === parts.drawn[n])) return; // of two hundred points, a drag moves one
      parts.drawn = drawn;
      this.#mark(parts, mark);
      this.#place(parts, p, isSelected, view, hasRadius ? (p.radius ?? radius) : 0);
      parts.target.classList.toggle("dnb-ed-suspect", isSuspect);
      setText(parts.tip, this.words.tip(p, number, reach) + (isSuspect ? "; disagrees with its neighbours" : ""));
    });
    if (this.stop === null && points.length) {
      const chosen = points.filter((p) => selected.has(p.id)),
        ids = (chosen.length ? chosen : points).map((p) => p.id);
      this.#stopAt(ids.reduce((least, id) => Math.min(least, id)));
    }
    return isFocusLost;
  }

  /** Make one point the tab stop: two hundred of them would need two hundred presses. */
  #stopAt(id: number) {
    if (id === this.stop) return;
    if (this.stop !== null) this.byId.get(this.stop)?.target.setAttribute("tabindex", "-1");
    this.byId.get(id)?.target.setAttribute("tabindex", "0");
    this.stop = id;
  }

  /**
   * Move the focus to the next point of a list of ids or, by -1, to the one before; from none of them to that at
   * which Tab stops.
   */
  focusNext(ids: number[], by: number, from: number | null = null) {
    const at = from === null ? -1 : ids.indexOf(from);
    return this.focus(at < 0 ? this.stop : ids[(at + by + ids.length) % ids.length]!);
  }

  /** The elements of a new point. */
  make(id: number): HandleParts {
    const arrow = svgElement("g", {}, this.arrows);
    svgElement("path", { class: "dnb-ed-arrow-case" }, arrow);
    svgElement("path", { class: "dnb-ed-arrow" }, arrow);
    svgElement("path", { class: "dnb-ed-arrow-head" }, arrow);
    const circles = (of: SVGGElement, named: [name: string, r: number][]) =>
      named.map(([name, r]) => svgElement("circle", { r, class: `dnb-ed-${name}` }, of));
    const source = svgElement("g", { class: "dnb-ed-source", "data-source": id }, this.points);
    const rings = circles(source, [
      ["hit", 9],
      ["ring-case", 4.5],
      ["ring", 4.5],
    ]);
    const target = svgElement(
      "g",
      {
        class: "dnb-ed-target",
        "data-id": id,
        tabindex: "-1",
        role: "button",
        "aria-roledescription": "control point",
        ...OWN_KEYS,
      },
      this.points,
    );
    const tip = svgElement("title", {}, target);
    const discs = circles(target, [
      ["hit", 14],
      ["disc-case", 6.5],
      ["disc", 6.5],
    ]);
    const forms = ["form-case", "form"].map((name) => svgElement("path", { class: `dnb-ed-${name}` }, target));
    const more = svgElement("g", { class: "dnb-ed-details" }, target);
    circles(more, [
      ["halo-case", 11],
      ["halo", 11],
      ["doubt-case", 15],
      ["doubt", 15],
    ]);
    svgElement("rect", { x: -5.5, y: -5.5, width: 11, height: 11, class: "dnb-ed-square" }, more);
    svgElement("path", { class: "dnb-ed-lock", d: "M-3.4 0V-2.2a3.4 3.4 0 0 1 6.8 0V0M-4.6-.2H4.6V5.6H-4.6Z" }, more);
    const beyond = svgElement("path", { d: "M 5 -5 L 11 0 L 5 5 Z", class: "dnb-ed-beyond" }, more);
    const text = svgElement("text", { class: "dnb-ed-name dnb-ed-number" }, more);
    const radius = svgElement("circle", { class: "dnb-ed-radius" }, this.radii);
    const drawn: unknown[] = [];
    const parts: HandleParts = {
      arrow,
      source,
      target,
      discs,
      rings,
      more,
      radius,
      tip,
      forms,
      beyond,
      text,
      mark: null,
      drawn,
    };
    this.byId.set(id, parts);
    return parts;
  }

  #mark(parts: HandleParts, mark: number | null) {
    if (mark === parts.mark) return;
    parts.mark = mark;
    for (const part of [parts.target, parts.source]) {
      if (mark === null) part.removeAttribute("data-region");
      else part.setAttribute("data-region", String(mark));
    }
    parts.target.classList.toggle("dnb-ed-formed", mark !== null && REGION_FORMS[mark] !== "");
  }

  /** Mark these points as blocked, and no others. */
  lock(ids: number[]) {
    for (const [id, { target }] of this.byId) target.classList.toggle("dnb-ed-locked", ids.includes(id));
  }

  /** Put the elements in the order of the list, which Tab follows. */
  #order(points: P[]) {
    for (const p of points) {
      const parts = this.byId.get(p.id) ?? this.make(p.id);
      if (this.points.lastChild === parts.target) continue;
      const focused = parts.target === treeOf(this.svg).activeElement;
      this.points.append(parts.source, parts.target);
      if (focused) parts.target.focus();
    }
  }

  #place(parts: HandleParts, p: P, isSelected: boolean, { k, x, y, width, height }: View, radius: number) {
    const at: Vector2 = [k * p.target[0] + x, k * p.target[1] + y],
      from: Vector2 = [k * p.source[0] + x, k * p.source[1] + y];
    const inside = [Math.min(width - RIM, Math.max(RIM, at[0])), Math.min(height - RIM, Math.max(RIM, at[1]))];
    const cut = RIM / 2, // of a disc nearer to the border too little is seen
      isOutside = at[0] < cut || at[1] < cut || at[0] > width - cut || at[1] > height - cut;
    const shown = isOutside ? inside : at,
      { target, source, arrow } = parts;
    for (const disc of parts.discs) setAttributes(disc, { cx: shown[0]!.toFixed(2), cy: shown[1]!.toFixed(2) });
    for (const ring of parts.rings) setAttributes(ring, { cx: from[0].toFixed(2), cy: from[1].toFixed(2) });
    const form = parts.mark === null ? "" : pathAt(REGION_FORMS[parts.mark]!, shown[0]!, shown[1]!);
    for (const path of parts.forms) setAttributes(path, { d: form });
    parts.more.setAttribute("transform", `translate(${shown[0]!.toFixed(2)} ${shown[1]!.toFixed(2)})`);
    target.classList.toggle("dnb-ed-selected", isSelected);
    for (const part of [target, source, arrow]) part.classList.toggle("dnb-ed-off", !p.active);
    for (const part of [target, source]) part.classList.toggle("dnb-ed-kept", p.locked === true);
    target.classList.toggle("dnb-ed-quiet", QUIET_NAME.test(p.name) && !isSelected);
    target.classList.toggle("dnb-ed-outside", isOutside);
    target.setAttribute("aria-pressed", String(isSelected));
    if (isOutside) {
      const angle = (Math.atan2(at[1] - shown[1]!, at[0] - shown[0]!) * 180) / Math.PI;
      parts.beyond.setAttribute("transform", `rotate(${angle.toFixed(1)})`);
    }
    this.#label(parts, p, shown, width);
    this.#arrow(arrow, from, at);
    const length = Math.hypot(at[0] - from[0], at[1] - from[1]);
    source.setAttribute("visibility", length < 3 ? "hidden" : "visible");
    parts.radius.setAttribute("visibility", radius > 0 ? "visible" : "hidden");
    if (radius <= 0) return;
    setAttributes(parts.radius, { cx: at[0].toFixed(1), cy: at[1].toFixed(1), r: (radius * k).toFixed(1) });
  }

  #label({ target, text }: HandleParts, p: P, [left]: number[], width: number) {
    const isLeft = left! > width - 90;
    setAttributes(target, { "aria-label": this.words.label(p, this.numberOf(p.id)) });
    setAttributes(text, { x: isLeft ? -12 : 12, y: -8, "text-anchor": isLeft ? "end" : "start" });
    setText(text, p.name.length > 24 ? `${p.name.slice(0, 23)}\u2026` : p.name || String(this.numberOf(p.id)));
  }

  #arrow(arrow: SVGElement, from: Vector2, at: Vector2) {
    const dx = at[0] - from[0],
      dy = at[1] - from[1],
      length = Math.hypot(dx, dy);
    const hasRoom = length > 20;
    arrow.setAttribute("visibility", length < 12 ? "hidden" : "visible");
    if (length < 12) return;
    const u = dx / length,
      v = dy / length,
      end = length - (hasRoom ? 15 : 8);
    const place = (along: number, across: number) =>
      `${(from[0] + u * along - v * across).toFixed(2)} ` + `${(from[1] + v * along + u * across).toFixed(2)}`;
    const line = `M ${place(5, 0)} L ${place(Math.max(5, end), 0)}`;
    arrow.children[0]!.setAttribute("d", line);
    arrow.children[1]!.setAttribute("d", line);
    arrow.children[2]!.setAttribute(
      "d",
      hasRoom ? `M ${place(length - 7.5, 0)} L ${place(length - 16, 4.5)} L ${place(length - 16, -4.5)} Z` : "",
    );
  }

  showBand(box: { x: number; y: number; width: number; height: number } | null) {
    this.band.setAttribute("visibility", box ? "visible" : "hidden");
    if (!box) return;
    for (const [name, value] of Object.entries(box)) this.band.setAttribute(name, value.toFixed(1));
  }

  /** Give a point the focus. False if there is no such point. */
  focus(id: number | null) {
    const parts = id === null ? undefined : this.byId.get(id);
    parts?.target.focus({ preventScroll: true });
    return parts !== undefined;
  }

  blink(ids: number[]) {
    for (const id of ids) {
      const target = this.byId.get(id)?.target;
      if (!target) continue;
      target.classList.add("dnb-ed-blink");
      target.addEventListener("animationend", () => target.classList.remove("dnb-ed-blink"), { once: true });
    }
  }
}

const TURN_AWAY = 38; // CSS pixels from the middle of the selection, or from its upper edge, to the handle
const GRIP_AWAY = 14; // from the edge of the view to the grip of the axis

/**
 * Marks that can be dragged besides points and shapes: the handle that rotates the selection, and the axis of a
 * mirror. And the circle of the brush, which shows its area.
 */
export class ToolMarks {
  root: SVGGElement;
  axis: SVGGElement;
  lines: SVGPathElement[];
  grip: SVGGElement;
  gripIcon: SVGPathElement;
  turn: SVGGElement;
  stalk: SVGPathElement;
  knob: SVGGElement;
  brush: SVGGElement;
  circles: SVGCircleElement[];

  constructor(svg: SVGSVGElement, points: SVGElement) {
    this.root = svgElement("g", { class: "dnb-ed-marks" });
    svg.insertBefore(this.root, points); // under the points, which are grabbed first
    this.axis = svgElement("g", { class: "dnb-ed-axis", visibility: "hidden" }, this.root);
    this.lines = ["case", "line"].map((name) => svgElement("path", { class: `dnb-ed-axis-${name}` }, this.axis));
    this.grip = svgElement(
      "g",
      {
        "data-mark": "axis",
        class: "dnb-ed-axis-grip",
        tabindex: "-1",
        role: "slider",
        "aria-label": "axis of the mirror",
        ...OWN_KEYS,
      },
      this.axis,
    );
    svgElement("circle", { r: 16, class: "dnb-ed-hit" }, this.grip);
    svgElement("rect", { x: -9, y: -9, width: 18, height: 18, rx: 4 }, this.grip);
    this.gripIcon = svgElement("path", { d: "M0-6.5V6.5M-3-3.5L-6.5 0-3 3.5M3-3.5L6.5 0 3 3.5" }, this.grip);
    svgElement("title", {}, this.grip, "Drag the axis of the mirror");
    this.turn = svgElement("g", { "data-mark": "turn", class: "dnb-ed-turn", visibility: "hidden" }, this.root);
    this.stalk = svgElement("path", { class: "dnb-ed-turn-stalk" }, this.turn);
    this.knob = svgElement("g", {}, this.turn);
    svgElement("circle", { r: 14, class: "dnb-ed-hit" }, this.knob);
    svgElement("circle", { r: 8, class: "dnb-ed-turn-disc" }, this.knob);
    svgElement("path", { d: "M4.2-1.6A4.5 4.5 0 1 0 4 2.2M4.6-4.6V-1.4H1.4", class: "dnb-ed-turn-arrow" }, this.knob);
    svgElement("title", {}, this.turn, "Turn what is selected; Alt scales it, Shift goes in steps");
    this.brush = svgElement("g", { class: "dnb-ed-circle", visibility: "hidden", "aria-hidden": "true" }, svg);
    this.circles = ["case", "line"].map((name) => svgElement("circle", { class: `dnb-ed-circle-${name}` }, this.brush));
  }

  update(scene: MarksScene) {
    this.#axis(scene);
    this.#turn(scene);
    const {
        brush: { isOn, at, radius = 0 },
        view,
        isLocked,
      } = scene,
      shown = isOn && !isLocked ? at : null;
    this.brush.setAttribute("visibility", shown ? "visible" : "hidden");
    if (!shown) return;
    for (const circle of this.circles) {
      setAttributes(circle, { cx: shown[0].toFixed(1), cy: shown[1].toFixed(1), r: (radius * view.k).toFixed(1) });
    }
  }

  #axis({ mirror, view, isLocked, gripAway = GRIP_AWAY }: MarksScene) {
    const isShown = mirror.on && !isLocked;
    this.axis.setAttribute("visibility", isShown ? "visible" : "hidden");
    this.grip.setAttribute("tabindex", isShown ? "0" : "-1");
    if (!isShown) return;
    const isUpright = mirror.axis === "a",
      at = isUpright ? view.k * mirror.at + view.x : view.k * mirror.at + view.y;
    const line = isUpright ? `M ${at.toFixed(1)} 0 V ${view.height}` : `M 0 ${at.toFixed(1)} H ${view.width}`;
    for (const path of this.lines) path.setAttribute("d", line);
    const place = (isUpright ? [at, gripAway] : [gripAway, at]).map((v) => v.toFixed(1)).join(" ");
    setAttributes(this.grip, {
      transform: `translate(${place})${isUpright ? "" : " rotate(90)"}`,
      "aria-valuenow": formatLength(mirror.at),
      "aria-orientation": isUpright ? "horizontal" : "vertical",
    });
  }

  /** Place above the selection, whose middle is the centre of the rotation. */
  #turn({ view, selected, points, isLocked, isHolding, brush, pen, isAdding, toView }: MarksScene) {
    const chosen = points.filter((p) => selected.has(p.id) && !p.locked);
    const isShown = chosen.length > 0 && !isLocked && !isHolding && !brush.isOn && !pen.isOn && !isAdding;
    this.turn.setAttribute("visibility", isShown ? "visible" : "hidden");
    if (!isShown) return;
    const [x, y] = toView(middleOf(chosen)),
      ys = chosen.map((p) => toView(p.target)[1]);
    const up = Math.min(...ys) - TURN_AWAY,
      down = Math.max(...ys) + TURN_AWAY;
    const end = up > 12 ? up : Math.min(view.height - 12, down);
    this.stalk.setAttribute("d", `M ${x.toFixed(1)} ${y.toFixed(1)} V ${end.toFixed(1)}`);
    this.knob.setAttribute("transform", `translate(${x.toFixed(1)} ${end.toFixed(1)})`);
  }
}
