// The nodes of the deformed grid, to be dragged: a node that is dragged becomes an ordinary control point, whose source
// is the node's place on the original. Also which grid a view shows next to other views.
//
// A view in an element of class dnb-th-after shows nodes, as one of an editor whose trait `drag_grid` is true does.
// A view in an element of class dnb-th-before shows the original, with the regular grid and nothing to drag.

import { newPoint, placeBetween } from "../maths/points.ts";
import { gridPlaces, gridShape } from "../maths/warp_map.ts";
import type { LayeredFit, PicturePoint, Vector2 } from "../types.ts";
import { ARROWS, OWN_KEYS, setAttributes, setText, slackOf, svgElement } from "../ui/dom.ts";
import type { EditorParts } from "./parts.ts";
export type GridPlaces = ReturnType<typeof gridPlaces>;
export type NodeParts = { root: SVGGElement; tip: SVGElement; hit: SVGElement; columns: number };
/** id: of the new point. */
export type NodeDrag = { n: number; pointer: number; from: Vector2; id: number | null; slack: number };

const NODE_SAME = 1e-6; // of the picture's size: a point whose source is so near a node is that node's
const LEAST_STRENGTH = 0.02; // below it a drag would have to be fifty times as long
const NODE_HINT = "Drag a node of the grid; Enter makes it a control point, Delete removes that point";
const STILL_GRID = "Drags are magnified 0 times: the grid is that of the original. Set the slider to 1 to drag";

/** Dependencies of the nodes on the editor. */
export type NodesEditor = EditorParts<
  "model" | "frames" | "messages" | "stage" | "viewport" | "points" | "map" | "picture",
  "gestures" | "drag" | "points",
  "handles"
>;

/** The nodes of the grid as elements, which can have the focus and be dragged. */
export class GridNodes {
  nodes: NodeParts[] = [];
  /** Places of the nodes, and the inputs they were computed from. */
  made: { key: unknown[]; places: GridPlaces } | null = null;
  current = 0; // the node at which Tab stops
  drag: NodeDrag | null = null;
  group: SVGGElement;

  constructor(readonly editor: NodesEditor) {
    this.group = svgElement("g", { class: "dnb-ed-nodes", role: "group", "aria-label": "Nodes of the grid" });
    editor.stage.svg.insertBefore(this.group, editor.layers.handles.arrows); // under the points
    const { group } = this,
      { signal } = editor.stage.closing;
    group.addEventListener("pointerdown", (e) => editor.frames.guard(() => this.#down(e)), { signal });
    group.addEventListener("pointermove", (e) => editor.frames.guard(() => this.#move(e)), { signal });
    group.addEventListener("pointerup", (e) => editor.frames.guard(() => this.#up(e, false)), { signal });
    for (const name of ["pointercancel", "lostpointercapture"] as const) {
      group.addEventListener(name, (e) => editor.frames.guard(() => this.#up(e, true)), { signal });
    }
    group.addEventListener(
      "dblclick",
      (e) => {
        e.stopPropagation();
        editor.frames.guard(() => this.#take(this.#at(e)));
      },
      { signal },
    );
    group.addEventListener("keydown", (e) => editor.frames.guard(() => this.#keyDown(e)), { signal });
    editor.stage.root.addEventListener(
      "keydown",
      (e) => {
        const { drag } = this;
        if (drag && e.key === "Escape") {
          e.stopPropagation();
          editor.frames.guard(() => this.#end(drag, true));
        }
      },
      { signal, capture: true },
    );
  }

  // ---- the kind of this view ----------------------------------------------------------------------------------------

  /** "before", "after", or "" in a view without a partner. */
  get side() {
    const around = this.editor.stage.root.closest(".dnb-th-before, .dnb-th-after");
    return !around ? "" : around.classList.contains("dnb-th-before") ? "before" : "after";
  }

  get isOn() {
    const { model } = this.editor,
      isWanted = this.side === "after" || (this.side === "" && model.get("drag_grid"));
    return Boolean(isWanted && model.get("show_grid") && model.get("density") > 0);
  }

  /** Movement of a target that moves its tissue by one; 0 where nothing moves it. */
  get pull() {
    const strength = this.editor.map.strength;
    return !this.isOn ? 1 : Math.abs(strength) < LEAST_STRENGTH ? 0 : 1 / strength;
  }

  /**
   * The points with their displacements times the strength, so that they are on the grid next to its nodes.
   */
  magnify(points: PicturePoint[]) {
    const strength = this.editor.map.strength;
    if (strength === 1 || !this.isOn) return points;
    return points.map((p) => ({ ...p, target: placeBetween(p.source, p.target, strength) }));
  }

  get advice() {
    return this.pull === 0 ? STILL_GRID : NODE_HINT;
  }

  /** A warning about drags that are magnified until the map folds, or "". */
  warning(folds: { least: number }) {
    const strength = this.editor.map.strength,
      isBeyond = strength < 0 || strength > 1;
    if (!this.isOn || !isBeyond || folds.least > 0) return "";
    return `Magnified ${Number(strength.toFixed(2))} times the map folds: magnify less`;
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  /** Places of the nodes under a fit, found once for each. */
  placesOf(layered: LayeredFit) {
    const {
        editor: {
          model,
          picture: { box },
          viewport: { view },
        },
        made,
      } = this,
      cells = model.get("density") || 12;
    const key = [layered, cells, String(box)];
    if (made && key.every((value, k) => value === made.key[k])) return made.places;
    this.made = { key, places: gridPlaces(layered, box, cells, 0.05 / view.k) };
    return this.made.places;
  }

  /** @param layered null while the picture is shown as it was */
  update(layered: LayeredFit | null) {
    const isShown = this.isOn && layered !== null;
    setAttributes(this.group, { visibility: isShown ? "visible" : "hidden" });
    if (!isShown) {
      if (!this.drag) this.#trim(0);
      return;
    }
    const { columns, rows, target, isSeen } = this.placesOf(layered),
      held = this.#occupiedNodes();
    const { k, x, y } = this.editor.viewport.view;
    const [a0, a1] = this.editor.picture.box,
      reach = Math.max(5, Math.min(11, (0.42 * k * (a1 - a0)) / (columns - 1)));
    this.#trim(columns * rows);
    for (let n = 0; n < columns * rows; n++) {
      const node = this.nodes[n] ?? this.#make(n);
      const isFree = isSeen[n] === 1 && !held.has(n),
        kind = this.drag?.n === n ? "hand" : isFree ? "" : "gone";
      const at = [k * target[2 * n]! + x, k * target[2 * n + 1]! + y];
      setAttributes(node.root, {
        transform: `translate(${at[0]!.toFixed(2)} ${at[1]!.toFixed(2)})`,
        class: kind ? `dnb-ed-node dnb-ed-node-${kind}` : "dnb-ed-node",
        tabindex: n === this.current && isFree ? "0" : "-1",
      });
      setAttributes(node.hit, { r: reach.toFixed(1) });
      if (node.columns !== columns) this.#name(node, n, columns);
    }
    const current = this.nodes[this.current]?.root;
    if (!current || current.classList.contains("dnb-ed-node-gone")) this.#focusable(0);
  }

  #trim(count: number) {
    for (const { root } of this.nodes.splice(count)) root.remove();
    if (this.current >= count) this.current = 0;
  }

  #make(n: number) {
    const root = svgElement(
      "g",
      { "data-node": n, role: "button", "aria-roledescription": "node of the grid", ...OWN_KEYS },
      this.group,
    );
    const tip = svgElement("title", {}, root),
      hit = svgElement("circle", { class: "dnb-ed-hit" }, root);
    svgElement("path", { class: "dnb-ed-node-mark", d: "M0-3.6L3.6 0L0 3.6L-3.6 0Z" }, root);
    this.nodes[n] = { root, tip, hit, columns: 0 };
    return this.nodes[n];
  }

  #name(node: NodeParts, n: number, columns: number) {
    node.columns = columns;
    const text = `Node ${n % columns},${Math.floor(n / columns)} of the grid`;
    setAttributes(node.root, { "aria-label": text });
    setText(node.tip, `${text}: drag it to its place, or press Enter to hold it`);
  }

  /** The numbers of the nodes that are control points. */
  #occupiedNodes() {
    const {
        picture: { box },
        points: { list: points },
        model,
      } = this.editor,
      [a0, a1, b0, b1] = box;
    const [across, down] = gridShape(box, model.get("density"));
    const near = NODE_SAME * Math.hypot(a1 - a0, b1 - b0),
      held = new Set();
    for (const {
      source: [a, b],
    } of points) {
      const i = Math.round(((a - a0) / (a1 - a0)) * across),
        j = Math.round(((b - b0) / (b1 - b0)) * down);
      if (i < 0 || j < 0 || i > across || j > down) continue;
      const away = Math.hypot(a0 + ((a1 - a0) * i) / across - a, b0 + ((b1 - b0) * j) / down - b);
      if (away < near) held.add(i + j * (across + 1));
    }
    return held;
  }

  /** The number of the node that an event is about. */
  #at({ target }: Event) {
    const number = target instanceof Element ? target.closest("[data-node]")?.getAttribute("data-node") : null;
    return number ? Number(number) : null;
  }

  // ---- dragging -----------------------------------------------------------------------------------------------------

  /** The points and a new one at a node, whose target is the node's place: nothing moves by it. */
  #point({ columns, source, target }: GridPlaces, n: number) {
    const { editor, pull } = this,
      id = editor.points.nextId();
    const [x, y] = [source[2 * n]!, source[2 * n + 1]!],
      from: Vector2 = [x, y];
    const to: Vector2 = [x + pull * (target[2 * n]! - x), y + pull * (target[2 * n + 1]! - y)];
    const name = `grid ${n % columns},${Math.floor(n / columns)}`;
    return { id, points: [...editor.points.list, newPoint(id, from, to, name)] };
  }

  /** Whether nodes can be dragged now; a hint if their drags would have no effect. */
  #isFree() {
    const { editor } = this;
    if (editor.points.isLocked) return false;
    if (this.pull === 0) editor.messages.hint(STILL_GRID, 5000);
    return this.pull !== 0;
  }

  #down(event: PointerEvent) {
    const { editor } = this,
      n = this.#at(event);
    if (event.button !== 0 || n === null || editor.points.isLocked || editor.tools.gestures.isBusy) return; // for other listeners
    event.stopPropagation();
    event.preventDefault();
    if (this.drag || !this.#isFree()) return;
    this.#focusable(n);
    this.nodes[n]!.root.focus({ preventScroll: true });
    this.group.setPointerCapture(event.pointerId);
    this.drag = {
      n,
      pointer: event.pointerId,
      from: editor.stage.placeOf(event),
      id: null,
      slack: slackOf(event.pointerType),
    };
  }

  #move(event: PointerEvent) {
    const { drag, editor } = this,
      { drag: pointDrag } = editor.tools;
    if (!drag || event.pointerId !== drag.pointer) return;
    event.stopPropagation();
    const at = editor.stage.placeOf(event),
      by: Vector2 = [at[0] - drag.from[0], at[1] - drag.from[1]];
    if (drag.id === null) {
      if (Math.hypot(by[0], by[1]) < drag.slack || !this.made) return;
      const { id, points } = this.#point(this.made.places, drag.n);
      drag.id = id;
      if (!pointDrag.beginDrag(points)) {
        this.drag = null;
        return;
      }
      editor.points.select([id], false);
    }
    pointDrag.drag([drag.id], by, "target", drag.id, event.shiftKey);
  }

  #up(event: PointerEvent, isCancelled: boolean) {
    if (!this.drag || event.pointerId !== this.drag.pointer) return;
    event.stopPropagation();
    this.#end(this.drag, isCancelled);
  }

  #end(drag: NodeDrag, isCancelled: boolean) {
    const { editor } = this;
    this.drag = null;
    if (this.group.hasPointerCapture(drag.pointer)) this.group.releasePointerCapture(drag.pointer);
    if (drag.id === null) {
      if (!isCancelled) editor.messages.hint(NODE_HINT, 4000);
      return;
    }
    if (editor.tools.drag.endDrag(isCancelled)) editor.tools.points.present(drag.id, "holds the grid");
    else editor.points.select([]);
  }

  /** Hold a node where it is. */
  #take(n: number | null) {
    if (n === null || !this.made || !this.#isFree() || this.#occupiedNodes().has(n)) return;
    const { points: pointTools } = this.editor.tools,
      { id, points } = this.#point(this.made.places, n);
    if (pointTools.edit(points, "add")) pointTools.present(id, "holds the grid");
  }

  // ---- keys ---------------------------------------------------------------------------------------------------------

  #keyDown(event: KeyboardEvent) {
    const n = this.#at(event),
      by = ARROWS[event.key];
    if (n === null || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Enter") this.#take(n);
    else if (by && this.made) this.#walk(this.made.places, n, by);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  /** To the next node that is free, over those that are points. */
  #walk({ columns, rows }: GridPlaces, n: number, [di, dj]: Vector2) {
    let i = (n % columns) + di,
      j = Math.floor(n / columns) + dj;
    for (; i >= 0 && j >= 0 && i < columns && j < rows; i += di, j += dj) {
      const node = this.nodes[i + j * columns]!.root;
      if (node.classList.contains("dnb-ed-node-gone")) continue;
      this.#focusable(i + j * columns);
      node.focus({ preventScroll: true });
      return;
    }
  }

  /** Let Tab stop at one node, or at the first free one from there on. */
  #focusable(n: number) {
    const at = this.nodes.findIndex(({ root }, k) => k >= n && !root.classList.contains("dnb-ed-node-gone"));
    this.current = Math.max(0, at);
    for (const [k, { root }] of this.nodes.entries()) setAttributes(root, { tabindex: k === at ? "0" : "-1" });
  }
}
