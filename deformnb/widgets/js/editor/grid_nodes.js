// The nodes of the deformed net, to be dragged: whoever drags one makes it an ordinary control point, whose source is
// the node's place on the original. Also how a view shows a net beside another one. Needs maths/warp_map.js, ui/dom.js.
//
// A view in an element of class dnb-th-after shows nodes, as one of an editor whose trait `drag_net` is true does.
// A view in an element of class dnb-th-before shows the original, with the regular net and nothing to drag.

import { addedPoint, nextId } from "../maths/points.js";
import { netPlaces, netShape } from "../maths/warp_map.js";
import { OWN_KEYS, setAttributes, setText, SLACK, svgElement } from "../ui/dom.js";
import { pointLabel } from "./handles.js";

const NODE_SAME = 1e-6; // of the picture's size: a point whose source is so near a node is that node's
const LEAST_STRENGTH = 0.02; // below it a drag would have to be fifty times as far
const NODE_HINT = "Drag a node of the net where it shall be; Enter takes hold of it, Delete lets it go";
const STILL_NET = "Drags are magnified 0 times: the net stands as on the original. Set the slider to 1 to drag";

export class NetNodes {
  constructor(page) {
    Object.assign(this, { page, nodes: [], places: null, key: [], current: 0, drag: null });
    this.group = svgElement("g", { class: "dnb-ed-nodes", role: "group", "aria-label": "Nodes of the net" });
    page.svg.insertBefore(this.group, page.handles.arrows); // under the points
    this.closing = new AbortController();
    const on = (target, name, handler, options = {}) => target.addEventListener(name, (event) => page.guard(() => handler(event)),
      { signal: this.closing.signal, ...options });
    on(this.group, "pointerdown", (e) => this.down(e));
    on(this.group, "pointermove", (e) => this.move(e));
    on(this.group, "pointerup", (e) => this.up(e, false));
    on(this.group, "pointercancel", (e) => this.up(e, true));
    on(this.group, "lostpointercapture", (e) => this.up(e, true));
    on(this.group, "dblclick", (e) => { e.stopPropagation(); this.take(this.#at(e.target)); });
    on(this.group, "keydown", (e) => this.keyDown(e));
    on(page.root, "keydown", (e) => { if (this.drag && e.key === "Escape") { e.stopPropagation(); this.end(true); } },
      { capture: true });
  }

  close() { this.closing.abort(); }

  // ---- what kind of view this is ------------------------------------------------------------------------------------

  // "before", "after", or "" in a view that stands for itself.
  get side() { return this.page.root.closest(".dnb-th-before, .dnb-th-after")?.classList.contains("dnb-th-before") ? "before"
    : this.page.root.closest(".dnb-th-after") ? "after" : ""; }

  get isOn() {
    const { model } = this.page, isWanted = this.side === "after" || (this.side === "" && model.get("drag_net"));
    return Boolean(isWanted) && model.get("show_net") && model.get("density") > 0;
  }

  // How far a target must go for matter to go by one.
  get pull() {
    const strength = this.page.strength;
    return !this.isOn ? 1 : Math.abs(strength) < LEAST_STRENGTH ? 0 : 1 / strength;
  }

  // The points where they take matter to: beside the nodes they must lie on the net, however drags are magnified.
  shown(points) {
    const { strength } = this.page;
    if (strength === 1 || !this.isOn) return points;
    return points.map((p) => ({ ...p, target: p.source.map((value, k) => value + strength * (p.target[k] - value)) }));
  }

  get advice() { return this.pull === 0 ? STILL_NET : NODE_HINT; }

  // What is wrong with drags that are magnified beyond what was drawn.
  warning(folds) {
    const { strength } = this.page, isBeyond = strength < 0 || strength > 1;
    return this.isOn && isBeyond && folds.least <= 0 ? `Magnified ${Number(strength.toFixed(2))} times the map folds: magnify less` : "";
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  // Places of the nodes under a fit, found once for each.
  placesOf(layered) {
    const { model, box, view } = this.page, key = [layered, model.get("density") || 12, String(box)];
    if (!this.places || key.some((value, k) => value !== this.key[k])) {
      this.key = key;
      this.places = netPlaces(layered, box, key[1], 0.05 / view.k);
    }
    return this.places;
  }

  update(layered) {
    const { isOn } = this, isShown = isOn && !this.page.isComparing;
    setAttributes(this.group, { visibility: isShown ? "visible" : "hidden" });
    if (!isShown) { if (!this.drag) this.#trim(0); return; }
    const { columns, rows, target, isSeen } = this.placesOf(layered), { k, x, y } = this.page.view, held = this.#held();
    const [a0, a1] = this.page.box, reach = Math.max(5, Math.min(11, 0.42 * k * (a1 - a0) / (columns - 1)));
    this.#trim(columns * rows);
    for (let n = 0; n < columns * rows; n++) {
      const node = this.nodes[n] ?? this.#make(n);
      const isFree = isSeen[n] === 1 && !held.has(n), kind = this.drag?.n === n ? "hand" : isFree ? "" : "gone";
      setAttributes(node.root, { transform: `translate(${(k * target[2 * n] + x).toFixed(2)} ${(k * target[2 * n + 1] + y).toFixed(2)})`,
        class: kind ? `dnb-ed-node dnb-ed-node-${kind}` : "dnb-ed-node", tabindex: n === this.current && isFree ? "0" : "-1" });
      setAttributes(node.hit, { r: reach.toFixed(1) });
      if (node.columns !== columns) this.#name(node, n, columns);
    }
    const current = this.nodes[this.current]?.root;
    if (!current || current.classList.contains("dnb-ed-node-gone")) this.#focusable(0);
  }

  #trim(count) {
    while (this.nodes.length > count) this.nodes.pop().root.remove();
    if (this.current >= count) this.current = 0;
  }

  #make(n) {
    const root = svgElement("g", { "data-node": n, role: "button", "aria-roledescription": "node of the net", ...OWN_KEYS },
      this.group);
    const tip = svgElement("title", {}, root), hit = svgElement("circle", { class: "dnb-ed-hit" }, root);
    svgElement("path", { class: "dnb-ed-node-mark", d: "M0-3.6L3.6 0L0 3.6L-3.6 0Z" }, root);
    return (this.nodes[n] = { root, tip, hit, columns: 0 });
  }

  #name(node, n, columns) {
    node.columns = columns;
    const text = `Node ${n % columns},${Math.floor(n / columns)} of the net`;
    setAttributes(node.root, { "aria-label": text });
    setText(node.tip, `${text}: drag it where it shall be, or press Enter to hold it`);
  }

  // The numbers of the nodes that are control points.
  #held() {
    const { box: [a0, a1, b0, b1], points } = this.page, [across, down] = netShape(this.page.box, this.page.model.get("density"));
    const near = NODE_SAME * Math.hypot(a1 - a0, b1 - b0), held = new Set();
    for (const { source: [a, b] } of points) {
      const i = Math.round((a - a0) / (a1 - a0) * across), j = Math.round((b - b0) / (b1 - b0) * down);
      if (i < 0 || j < 0 || i > across || j > down) continue;
      if (Math.hypot(a0 + (a1 - a0) * i / across - a, b0 + (b1 - b0) * j / down - b) < near) held.add(i + j * (across + 1));
    }
    return held;
  }

  #at(element) {
    const number = element.closest?.("[data-node]")?.dataset.node;
    return number === undefined ? null : Number(number);
  }

  // ---- dragging -----------------------------------------------------------------------------------------------------

  // A point at a node, which goes where the node is: nothing moves by it.
  #point(n) {
    const { page, places: { columns, source, target } } = this, pull = this.pull, id = nextId(page.points, page.sender.nextId);
    const from = [source[2 * n], source[2 * n + 1]], at = [target[2 * n], target[2 * n + 1]];
    const points = addedPoint(page.points, id, from, from.map((value, k) => value + pull * (at[k] - value)));
    points[points.length - 1].name = `net ${n % columns},${Math.floor(n / columns)}`;
    return { id, points };
  }

  #isFree() {
    const { page } = this;
    if (page.isLocked) return false;
    if (this.pull === 0) page.hint(STILL_NET, 5000);
    return this.pull !== 0;
  }

  down(event) {
    const { page } = this, n = this.#at(event.target);
    if (event.button !== 0 || n === null || page.isLocked || page.pen.isOn || page.isAdding || page.gestures.isSpaceDown
      || page.gestures.pointers.size) return; // the others' business
    event.stopPropagation();
    event.preventDefault();
    if (this.drag || !this.#isFree()) return;
    this.#focusable(n);
    this.nodes[n].root.focus({ preventScroll: true });
    this.group.setPointerCapture(event.pointerId);
    this.drag = { n, pointer: event.pointerId, from: page.gestures.place(event), id: null, slack: SLACK[event.pointerType] ?? 2 };
  }

  move(event) {
    const { drag, page } = this;
    if (!drag || event.pointerId !== drag.pointer) return;
    event.stopPropagation();
    const at = page.gestures.place(event), by = [at[0] - drag.from[0], at[1] - drag.from[1]];
    if (drag.id === null) {
      if (Math.hypot(...by) < drag.slack) return;
      const { id, points } = this.#point(drag.n);
      drag.id = id;
      page.beginDrag();
      if (!page.drag0) { this.drag = null; return; }
      page.drag0 = page.points = points;
      page.select([id], false);
    }
    page.drag([drag.id], ...by, "target", drag.id, event.shiftKey);
  }

  up(event, isCancelled) {
    if (!this.drag || event.pointerId !== this.drag.pointer) return;
    event.stopPropagation();
    this.end(isCancelled);
  }

  end(isCancelled) {
    const { drag, page } = this;
    this.drag = null;
    if (this.group.hasPointerCapture(drag.pointer)) this.group.releasePointerCapture(drag.pointer);
    if (drag.id === null) { if (!isCancelled) page.hint(NODE_HINT, 4000); return; }
    const before = page.sender.points; // of which the new point is none yet
    page.endDrag(isCancelled);
    if (isCancelled || page.sender.points === before) { page.select([]); return; }
    page.select([drag.id]);
    page.drawNow();
    page.handles.focus(drag.id);
    page.speak(`${pointLabel(page.points.find((p) => p.id === drag.id))}, holds the net`);
  }

  // Hold a node where it is.
  take(n) {
    if (n === null || !this.#isFree() || this.#held().has(n)) return;
    const { page } = this, { id, points } = this.#point(n);
    if (!page.edit(points, "add")) return;
    page.select([id]);
    page.drawNow();
    page.handles.focus(id);
    page.speak(`${pointLabel(points[points.length - 1])}, holds the net`);
  }

  // ---- keys ---------------------------------------------------------------------------------------------------------

  keyDown(event) {
    const n = this.#at(event.target), by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (n === null || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Enter") this.take(n);
    else if (by) this.#walk(n, by);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  // To the next node that is free, over those that are points.
  #walk(n, [di, dj]) {
    const { columns, rows } = this.places;
    for (let i = n % columns + di, j = Math.floor(n / columns) + dj; i >= 0 && j >= 0 && i < columns && j < rows; i += di, j += dj) {
      const node = this.nodes[i + j * columns].root;
      if (node.classList.contains("dnb-ed-node-gone")) continue;
      this.#focusable(i + j * columns);
      node.focus({ preventScroll: true });
      return;
    }
  }

  // The one node at which Tab stops, or the first free one from there on.
  #focusable(n) {
    const at = this.nodes.findIndex(({ root }, k) => k >= n && !root.classList.contains("dnb-ed-node-gone"));
    this.current = Math.max(0, at);
    this.nodes.forEach(({ root }, k) => setAttributes(root, { tabindex: k === at ? "0" : "-1" }));
  }
}
