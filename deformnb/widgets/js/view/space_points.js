// Rays between a view and the volume in it: from places in space to pixels and back, and where a ray meets the body.
// Behind maths/camera.js; no DOM.

import { Handles, isRightClick, POINT_STEPS } from "../editor/handles.js";
import { added, dot, scaled, unitVector } from "../maths/camera.js";
import { clipSides, leftOf } from "../maths/clipping.js";
import { addedPoint, nextId, removedPoints, samePoints } from "../maths/points.js";
import { movedInSpace, spaceLabel, spaceTip, withSources } from "../maths/space.js";
import { busOf, holdBus, publishPoints, releaseBus, settingsOf } from "../sync/bus.js";
import { senderOf } from "../sync/edits.js";
import { pageElement, setAttributes, svgElement } from "../ui/dom.js";
import { opacityOfByte } from "../webgl/volume_blocks.js";

const HALF_SEEN = 0.5; // a surface is where half of the light is stopped

// A view's window on space: from places to pixels of one picture and back.
export class SpaceCamera {
  // camera: see maths/camera.js; bend: of a perspective; middle of what is seen; box: {left, top, width, height} in pixels.
  constructor(camera, bend, middle, box) {
    const { right, up, direction, pan, height } = camera, aspect = box.width / box.height;
    Object.assign(this, { right, up, ahead: direction, box, half: [(height / 2) * aspect, height / 2], bend: bend / height });
    this.eye = added(middle, added(scaled(right, pan[0]), scaled(up, pan[1])));
  }

  // Pixels, and how far away: {at: [x, y], depth, scale}, scale being a length in space for one pixel there.
  see(place) {
    const { box, bend, half } = this, from = place.map((x, k) => x - this.eye[k]), depth = dot(from, this.ahead);
    const near = bend > 0 ? Math.max(1e-6, 1 + depth * bend) : 1; // how much smaller things look there
    const a = dot(from, this.right) / near / half[0], b = dot(from, this.up) / near / half[1];
    return { at: [box.left + ((a + 1) / 2) * box.width, box.top + ((1 - b) / 2) * box.height], depth,
      scale: (2 * half[1] * near) / box.height };
  }

  // The way in space, parallel to the screen, of a way on it at a place.
  way(place, [dx, dy]) {
    const { scale } = this.see(place);
    return added(scaled(this.right, dx * scale), scaled(this.up, -dy * scale));
  }

  // The same along one axis of space: as far as brings its picture nearest to the hand.
  wayAlong(axis, place, [dx, dy]) {
    const { at, scale } = this.see(place), unit = [0, 1, 2].map((k) => (k === axis ? 1 : 0));
    const there = this.see(added(place, scaled(unit, scale))).at, [u, v] = [there[0] - at[0], there[1] - at[1]];
    const steep = u * u + v * v;
    return steep < 0.01 ? [0, 0, 0] : scaled(unit, (scale * (dx * u + dy * v)) / steep); // seen from its end it stands still
  }

  // Where the ray of a pixel begins and leads.
  ray([x, y]) {
    const { box, half, bend } = this, a = ((x - box.left) / box.width) * 2 - 1, b = 1 - ((y - box.top) / box.height) * 2;
    const aside = added(scaled(this.right, a * half[0]), scaled(this.up, b * half[1]));
    if (!(bend > 0)) return { start: added(this.eye, aside), ray: this.ahead };
    const ray = unitVector(added(aside, scaled(this.ahead, 1 / bend)));
    return { start: added(this.eye, scaled(this.ahead, -1 / bend)), ray };
  }

  // The way to the viewer from a place.
  toViewer(place) {
    if (!(this.bend > 0)) return scaled(this.ahead, -1);
    const eye = added(this.eye, scaled(this.ahead, -1 / this.bend));
    return unitVector(eye.map((x, k) => x - place[k]));
  }
}

// The deformed body as the ray caster sees it, for a few rays: lengths are along the index axes, from the first voxel.
export class Body {
  constructor({ values, info, field, table, unit, clip }) {
    const box = field?.box ?? info.box;
    Object.assign(this, { values, info, space: field?.space ?? null, planar: field?.planar ?? null, table, unit,
      box: clip ? leftOf(box, clipSides(box, clip)) : box }); // what is cut away is no body
    this.step = Math.min(...info.spacing);
  }

  toFrame(place) {
    const from = place.map((x, k) => x - this.info.origin[k]);
    return this.info.to_frame.map((row) => dot(row, from));
  }

  origin(x) {
    const { planar, space } = this;
    const moved = planar && !planar.cut ? added(x, planarAt(planar, x)) : x;
    return space ? added(moved, sampleAt(space, moved)) : moved;
  }

  opacity(x) {
    const { shape, spacing } = this.info, from = this.origin(x), at = from.map((l, k) => Math.round(l / spacing[k]));
    if (at.some((i, k) => i < 0 || i >= shape[k])) return 0;
    return opacityOfByte(this.table, this.values[(at[2] * shape[1] + at[1]) * shape[0] + at[0]]);
  }

  // The place in the box where half of the light along a ray is stopped, as a length along it, or null.
  meet(start, ray, from = 0) {
    const { low, high } = this.box;
    let first = from, last = Infinity;
    for (let k = 0; k < 3; k++) {
      const slope = Math.abs(ray[k]) < 1e-9 ? 1e-9 : ray[k], a = (low[k] - start[k]) / slope, b = (high[k] - start[k]) / slope;
      first = Math.max(first, Math.min(a, b));
      last = Math.min(last, Math.max(a, b));
    }
    let left = 1;
    for (let t = first + this.step / 2; t < last; t += this.step) {
      left *= Math.pow(1 - Math.min(0.9999, this.opacity(added(start, scaled(ray, t)))), this.step / this.unit);
      if (left < 1 - HALF_SEEN) return t;
    }
    return null;
  }

  // Whether something lies between a place in space and the viewer; what is nearer than two voxels does not count.
  hides(place, toViewer) {
    const ray = unitVector(this.info.to_frame.map((row) => dot(row, toViewer)));
    return this.meet(this.toFrame(place), ray, 2 * this.step) !== null;
  }

  // The place in space where a ray in space meets the body, or null.
  surface({ start, ray }) {
    const along = unitVector(this.info.to_frame.map((row) => dot(row, ray))), t = this.meet(this.toFrame(start), along, -Infinity);
    return t === null ? null : added(start, scaled(ray, t));
  }
}

// A displacement sampled in space, between its samples; x in the frame of the volume.
function sampleAt({ shape: [nx, ny, nz], origin, spacing, values }, x) {
  const n = [nx, ny, nz], q = x.map((l, k) => Math.max(0, Math.min(n[k] - 1, (l - origin[k]) / spacing[k])));
  const i = q.map((v, k) => Math.max(0, Math.min(n[k] - 2, Math.floor(v)))), f = q.map((v, k) => v - i[k]), sum = [0, 0, 0];
  for (let corner = 0; corner < 8; corner++) {
    const at = i.map((v, k) => Math.min(n[k] - 1, v + ((corner >> k) & 1)));
    const weight = f.reduce((w, v, k) => w * ((corner >> k) & 1 ? v : 1 - v), 1), j = 3 * ((at[2] * ny + at[1]) * nx + at[0]);
    if (weight) for (let m = 0; m < 3; m++) sum[m] += weight * values[j + m];
  }
  return sum;
}

// The displacement of maps over a plane, weighted along its normal.
function planarAt({ shape: [count, rows, columns], origin, spacing, depth, plane: { origin: o, u, v, n }, maps, weights }, x) {
  const from = x.map((l, k) => l - o[k]), knots = weights.length / count;
  const clamp = (value, most) => Math.max(0, Math.min(most, value));
  const p = clamp((dot(from, u) - origin[0]) / spacing[0], columns - 1), q = clamp((dot(from, v) - origin[1]) / spacing[1], rows - 1);
  const z = depth[1] > depth[0] ? clamp((dot(from, n) - depth[0]) / (depth[1] - depth[0]), 1) * (knots - 1) : 0;
  const [i, j, k] = [[p, columns], [q, rows], [z, knots]].map(([w, m]) => Math.max(0, Math.min(m - 2, Math.floor(w))));
  const s = p - i, t = q - j, w = z - k, sum = [0, 0];
  for (let m = 0; m < count; m++) {
    const weight = weights[m * knots + k] * (1 - w) + (knots > 1 ? weights[m * knots + k + 1] * w : 0);
    if (!weight) continue;
    const row = (m * rows + j) * columns + i, down = rows > 1 ? columns : 0, east = columns > 1 ? 1 : 0;
    for (let c = 0; c < 2; c++) {
      const value = (at) => maps[2 * at + c];
      sum[c] += weight * ((1 - t) * ((1 - s) * value(row) + s * value(row + east)) +
        t * ((1 - s) * value(row + down) + s * value(row + down + east)));
    }
  }
  return added(scaled(u, sum[0]), scaled(v, sum[1]));
}

// Control points in space over a view of the volume: seen, dragged, and put on what is seen. The page of a view has
// model, root, canvas, camera, info, hands and shown; one that has the voxels as well (values, field) knows which points
// lie behind the body and where a ray meets it. Points go to Python by the sender of their own editor (sync/edits.js).

const LATER = 120; // milliseconds between two looks at what is hidden

export class SpacePoints {
  constructor(page) {
    Object.assign(this, { page, editor: null, reference: null, undo: [], points: [], selected: new Set(), drag0: null, axis: null,
      hidden: new Set(), lookedAt: -Infinity, id: Math.random().toString(36).slice(2, 12) });
    this.svg = svgElement("svg", { class: "dnb-sp-over", visibility: "hidden" }, page.root);
    this.axisLine = svgElement("path", { class: "dnb-sp-axis", visibility: "hidden" }, this.svg);
    this.handles = new Handles(this.svg, { label: spaceLabel, tip: spaceTip });
    this.spoken = pageElement("div", "dnb-ed-spoken", page.root, { "aria-live": "polite" });
    this.closed = new AbortController();
    const on = (name, handler) => this.svg.addEventListener(name, (event) => { if (this.editor) handler(event); },
      { signal: this.closed.signal });
    on("pointerdown", (e) => this.down(e));
    on("pointermove", (e) => this.move(e));
    on("pointerup", (e) => this.up(e));
    for (const name of ["pointercancel", "lostpointercapture"]) on(name, (e) => this.up(e, true));
    on("keydown", (e) => { if (this.key(e)) { e.preventDefault(); e.stopPropagation(); } });
    on("contextmenu", (e) => { e.preventDefault(); if (isRightClick(e)) this.remove(this.hit(e)); });
    on("dblclick", (e) => { e.preventDefault(); e.stopPropagation(); });
    page.on("change:points_editor", () => this.follow(page.model.get("points_editor")));
    this.follow(page.model.get("points_editor")).catch((error) => page.fail(error));
  }

  async follow(reference) {
    if (reference === this.reference) return;
    this.leave();
    this.reference = reference;
    if (!reference) return;
    const ticket = (this.ticket = {});
    const editor = typeof reference === "string"
      ? await this.page.model.widget_manager.get_model(reference.replace("IPY_MODEL_", "")) : reference;
    if (this.ticket !== ticket) return;
    const bus = busOf(editor), uid = editor.get("uid"), sender = senderOf(bus, editor);
    Object.assign(this, { editor, bus, sender });
    holdBus(bus);
    const moved = ({ detail }) => {
      if (detail.origin === this.id || this.drag0) return;
      this.points = detail.phase === "move" ? detail.points : sender.points;
      this.draw();
    };
    const chosen = () => { this.selected = new Set(editor.get("selected") ?? []); this.draw(); };
    bus.addEventListener("deformnb:points", moved);
    editor.on("change:selected", chosen);
    this.undo.push(sender.listen((what) => { if (what === "points") this.receive(); }),
      () => bus.removeEventListener("deformnb:points", moved), () => editor.off("change:selected", chosen), () => releaseBus(bus, uid));
    sender.receive();
    this.points = sender.points;
    chosen();
  }

  leave() {
    for (const step of this.undo.splice(0)) step();
    Object.assign(this, { editor: null, ticket: null, reference: null, points: [], drag0: null });
    this.draw();
  }

  close() {
    this.leave();
    clearTimeout(this.timer);
    this.closed.abort();
    this.svg.remove();
    this.spoken.remove();
  }

  receive() {
    if (this.drag0) { // Python has found where a new point takes hold; the hand keeps the rest
      this.drag0 = withSources(this.drag0, this.sender.points);
      this.points = withSources(this.points, this.sender.points);
    } else this.points = this.sender.points;
    this.draw();
  }

  get isLocked() { return Boolean(this.editor.get("read_only") || this.editor.get("waiting")); }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  // The picture in which points are seen: of two side by side the deformed one.
  get camera() {
    const { page } = this, { info } = page, { clientWidth, clientHeight } = page.canvas, parts = page.shown === "side_by_side" ? 2 : 1;
    const { low, high } = (page.field && page.field.box) || info.box, middle = low.map((l, k) => (l + high[k]) / 2);
    const place = info.origin.map((o, row) => o + dot(info.axes[row], middle)), width = Math.max(1, clientWidth / parts);
    const bend = (page.model.get("camera") || {}).perspective ? 0.7 : 0;
    return new SpaceCamera(page.camera, bend, place, { left: clientWidth - width, top: 0, width, height: Math.max(1, clientHeight) });
  }

  draw() {
    const { page, svg } = this, isShown = Boolean(this.editor && page.info?.origin && page.shown !== "original");
    svg.setAttribute("visibility", isShown ? "visible" : "hidden");
    if (!isShown) { this.handles.update([], this.selected, { k: 1, x: 0, y: 0, width: 1, height: 1 }, 0, 0); return; }
    const { camera } = this, { clientWidth: width, clientHeight: height } = page.canvas;
    setAttributes(svg, { viewBox: `0 0 ${width} ${height}` });
    const flat = this.points.map((p) => {
      const target = camera.see(p.target);
      return { id: p.id, name: p.name, active: p.active, target: target.at, source: camera.see(p.source).at, depth: target.depth,
        away: 0, isFar: false, whole: p };
    });
    if (!this.drag0) flat.sort((p, q) => q.depth - p.depth); // nearer ones in front, but nothing jumps under a hand
    else flat.sort((p, q) => this.order.indexOf(p.id) - this.order.indexOf(q.id));
    this.order = flat.map((p) => p.id);
    const isFocusLost = this.handles.update(flat, this.selected, { k: 1, x: 0, y: 0, width, height }, 0, 0);
    if (isFocusLost) page.canvas.focus({ preventScroll: true });
    this.#drawAxis(camera);
    this.#lookLater();
  }

  #drawAxis(camera) {
    const p = this.axis === null ? null : this.points.find((q) => this.selected.has(q.id));
    this.axisLine.setAttribute("visibility", p ? "visible" : "hidden");
    if (!p) return;
    const far = 1000 * camera.see(p.target).scale, unit = [0, 1, 2].map((k) => (k === this.axis ? far : 0));
    const [from, to] = [-1, 1].map((sign) => camera.see(added(p.target, scaled(unit, sign))).at);
    setAttributes(this.axisLine, { d: `M ${from} L ${to}`, "data-axis": "xyz"[this.axis] });
  }

  // Which points lie behind the body: a hundred steps for each, so not at every movement.
  #lookLater() {
    const now = performance.now(), { page } = this;
    if (!page.values) return;
    clearTimeout(this.timer);
    if (now - this.lookedAt < LATER) { this.timer = setTimeout(() => this.draw(), LATER); return; }
    this.lookedAt = now;
    const body = this.body, { camera } = this;
    for (const p of this.points) {
      const isHidden = Boolean(body) && body.hides(p.target, camera.toViewer(p.target)), parts = this.handles.byId.get(p.id);
      for (const part of [parts?.target, parts?.source, parts?.arrow]) part?.classList.toggle("dnb-sp-hidden", isHidden);
    }
  }

  get body() {
    const { values, info, field, caster } = this.page;
    return values && caster?.table ? new Body({ values, info, field, table: caster.table.rgba, unit: caster.table.unit,
      clip: caster.clip }) : null;
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  select(ids) {
    this.selected = new Set(ids);
    this.editor.set("selected", [...ids]);
    this.editor.save_changes();
    this.draw();
  }

  hit(event) {
    const node = event.target.closest?.("[data-id], [data-source]");
    if (!node) return null;
    return node.dataset.id !== undefined ? { id: Number(node.dataset.id), what: "target" }
      : { id: Number(node.dataset.source), what: "source" };
  }

  place(event) {
    const box = this.page.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  down(event) {
    const hit = this.hit(event);
    if (!hit || event.button !== 0 || this.held) return;
    this.svg.setPointerCapture(event.pointerId);
    event.preventDefault();
    event.stopPropagation();
    const adds = event.shiftKey || event.ctrlKey || event.metaKey;
    if (!this.selected.has(hit.id)) this.select(adds ? [...this.selected, hit.id] : [hit.id]);
    this.handles.focus(hit.id);
    this.held = { ...hit, what: event.altKey ? "both" : hit.what, pointer: event.pointerId, from: this.place(event), isPress: true,
      ids: [...this.selected] };
  }

  move(event) {
    const { held } = this, at = this.place(event);
    if (held?.pointer !== event.pointerId || this.isLocked) return;
    held.at = at;
    if (held.isPress && Math.hypot(at[0] - held.from[0], at[1] - held.from[1]) < 2) return;
    if (held.isPress) { held.isPress = false; this.drag0 = this.points; }
    this.#dragTo(at);
  }

  #dragTo(at) {
    const { held } = this, by = [at[0] - held.from[0], at[1] - held.from[1]];
    const place = this.drag0.find((p) => p.id === held.id)?.[held.what === "source" ? "source" : "target"];
    if (!place) return;
    this.points = movedInSpace(this.drag0, held.ids, this.#way(place, by), held.what);
    this.#publish("move");
    this.sender.move(this.points);
    this.draw();
  }

  #way(place, by) { return this.axis === null ? this.camera.way(place, by) : this.camera.wayAlong(this.axis, place, by); }

  up(event, isCancelled = false) {
    const { held, drag0, points } = this;
    if (held?.pointer !== event.pointerId) return;
    this.held = this.drag0 = null;
    if (!drag0) return;
    this.axis = null;
    if (!isCancelled && !this.isLocked && !samePoints(points, drag0)) this.sender.edit(points, "move");
    else this.giveUp();
    this.draw();
  }

  // As if the drag had not begun; Python has seen it, and now that it is no more.
  giveUp() {
    this.points = this.sender.points;
    this.#publish("end");
    this.sender.move(this.points);
  }

  #publish(phase) {
    publishPoints(this.bus, { origin: this.id, points: this.points, settings: settingsOf(this.editor), fit: null, phase });
  }

  remove(hit) {
    if (!hit || this.isLocked) return;
    this.sender.edit(removedPoints(this.points, [hit.id]), "remove");
    this.spoken.textContent = `point ${hit.id} deleted`;
  }

  // A point on the first surface under a double click. False where there is none, or nothing is edited.
  doubleClick(event) {
    if (!this.editor || this.isLocked || !this.body || this.page.shown === "original") return false;
    const at = this.place(event), { camera } = this;
    if (at[0] < camera.box.left) return false;
    const place = this.body.surface(camera.ray(at));
    if (!place) return false;
    const id = nextId(this.points, this.sender.nextId);
    this.sender.edit(addedPoint(this.points, id, place, place), "add"); // Python finds where it takes hold
    this.select([id]);
    this.handles.focus(id);
    this.spoken.textContent = `point ${id} added`;
    return true;
  }

  // ---- keys of a point ----------------------------------------------------------------------------------------------

  key(event) {
    const hit = this.hit(event), key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    if (event.ctrlKey || event.metaKey) {
      if (hit && POINT_STEPS[key]) return this.handles.focusNext(this.editor.get("points").map((p) => p.id), POINT_STEPS[key], hit.id);
      if (key !== "z" && key !== "y") return false;
      if (!this.isLocked && !this.drag0) this.sender.step(key === "y" || event.shiftKey ? "redo" : "undo");
      return true;
    }
    if (!hit) return false;
    if ("xyz".includes(key) && key.length === 1) { this.#lock("xyz".indexOf(key)); return true; }
    if (key in arrows) { this.#nudge(hit.id, arrows[key], event.shiftKey ? 10 : 1); return true; }
    if (key === "Delete" || key === "Backspace") { this.remove(hit); return true; }
    if (key === "Enter" || key === " ") { this.select([hit.id]); return true; }
    if (key !== "Escape") return false;
    if (this.drag0) { this.held = this.drag0 = null; this.giveUp(); } else this.select([]);
    this.axis = null;
    this.draw();
    return true;
  }

  // Along x, y or z only, until that key is pressed again.
  #lock(axis) {
    this.axis = this.axis === axis ? null : axis;
    this.spoken.textContent = this.axis === null ? "free" : `along ${"xyz"[axis]} only`;
    if (this.drag0 && this.held?.at) this.#dragTo(this.held.at);
    else this.draw();
  }

  #nudge(id, [dx, dy], voxels) {
    const p = this.points.find((q) => q.id === id), length = voxels * Math.min(...this.page.info.spacing);
    if (!p || this.isLocked) return;
    if (!this.selected.has(id)) this.select([id]);
    const way = unitVector(this.#way(p.target, [dx, dy])), ids = [...this.selected];
    if (way) this.sender.edit(movedInSpace(this.points, ids, scaled(way, length)), "nudge", `nudge ${ids}`);
  }
}
