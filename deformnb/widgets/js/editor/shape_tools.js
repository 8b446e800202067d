// Drawing of cuts, rigid parts and the ground: places are clicked one by one, or drawn in one stroke, or set by keys.

import { sidesKey } from "../maths/cuts.js";
import { shownLength } from "../maths/numbers.js";
import { changed, cleanShapes, renamedPoint, resetPoints, sameShapes } from "../maths/points.js";
import { rbfLabel } from "../maths/rbf.js";
import { regionFault } from "../maths/regions.js";
import { heldPoints } from "../maths/rigid_stages.js";
import {
  cornersOf, followedShape, groundThrough, insertedCorner, MOST_SHAPES, movedCorner, movedRegion, removedCorner,
  SHAPE_NAMES, shapeLabel, shapeName, simplified, toldShape, turnedRegion, withShape,
} from "../maths/shapes.js";
import { settingsOf } from "../sync/bus.js";
import { LONGEST_EDIT } from "../sync/edits.js";
import { OWN_KEYS, pageElement, setAttributes, svgElement } from "../ui/dom.js";
import { EditorDrawing } from "./drawing.js";
import { REGION_FORMS, REGION_MARKS, shapePaths } from "./shape_handles.js";

const PEN_HINTS = {
  cut: "Click along the cut, or draw it in one stroke. Enter or double-click ends it; a click on its start closes it. An " +
    "open cut goes on straight through the whole picture: it cannot end inside",
  part: "Click around what shall stay rigid, or draw around it. Enter, double-click or a click on the start closes it",
  ground: "Click two places, or drag a line: what lies on its far side stays where it is. F turns the side over",
};
export const PEN_WORDS = { cut: "cut", part: "rigid part", ground: "ground" };
const CLOSE_BY = 10; // CSS pixels around the first place that close the line
const STROKE_ERROR = 1.6; // CSS pixels between a drawn stroke and its corners
const PEN_STEPS = [1, 10]; // CSS pixels of an arrow key with and without Shift: a hand with the keys draws coarsely

export class Pen {
  constructor(page) {
    this.page = page;
    this.endedAt = -Infinity;
    this.draft = null; // {tool, places, next, isByKeys, isSet, canClose, isClosing}
  }

  get isOn() { return this.draft !== null; }

  get hasJustEnded() { return performance.now() - this.endedAt < 500; }

  start(tool) {
    const { page } = this;
    this.stroke = null;
    this.draft = { tool, places: [], next: null, isByKeys: false, isSet: false, canClose: false };
    page.stage.classList.add("dnb-ed-drawing");
    page.hint(PEN_HINTS[tool], 12000);
    page.speak(`Drawing a ${PEN_WORDS[tool]}: arrows move the pen, Enter sets a place, Enter again ends, Escape gives up`);
    page.invalidate();
  }

  stop() {
    if (!this.draft) return false;
    this.draft = null;
    this.endedAt = performance.now();
    this.stroke = null;
    this.page.stage.classList.remove("dnb-ed-drawing");
    this.page.hideHint(Object.values(PEN_HINTS));
    this.page.invalidate();
    return true;
  }

  cancel() {
    const was = this.stop();
    if (was) this.page.speak("drawing given up");
    return was;
  }

  // ---- the mouse ----------------------------------------------------------------------------------------------------

  #place([x, y]) { return [(x - this.page.view.x) / this.page.view.k, (y - this.page.view.y) / this.page.view.k]; }

  #gap([a, b], [x, y]) {
    const { view } = this.page;
    return Math.hypot(view.k * a + view.x - x, view.k * b + view.y - y);
  }

  hover(at) {
    const { draft } = this, { places } = draft;
    draft.next = this.#place(at);
    draft.isByKeys = false;
    draft.isClosing = draft.canClose && this.#gap(places[0], at) < CLOSE_BY;
    this.page.invalidate();
  }

  // A stroke from where the mouse went down.
  drag(at) {
    this.stroke ??= [];
    this.stroke.push(this.#place(at));
    this.draft.next = null;
    const { draft } = this;
    draft.shown ??= draft.places.length;
    draft.places.push(this.stroke[this.stroke.length - 1]);
    this.page.invalidate();
  }

  up(from, at) {
    const { draft, stroke } = this;
    if (!stroke) { this.click(at); return; }
    this.stroke = null;
    const before = draft.places.slice(0, draft.shown), all = [this.#place(from), ...stroke], isWhole = before.length === 0;
    draft.shown = undefined;
    const path = draft.tool === "ground" ? [all[0], all[all.length - 1]] : simplified(all, STROKE_ERROR / this.page.view.k);
    const isClosed = draft.tool === "part" || (path.length > 3 && this.#gap(all[0], at) < 2 * CLOSE_BY);
    draft.places = [...before, ...(isWhole && isClosed && this.#gap(all[0], at) < 2 * CLOSE_BY ? path.slice(0, -1) : path)];
    this.#count();
    if (isWhole && !this.finish(isClosed)) { draft.places = before; this.#count(); }
    this.page.invalidate();
  }

  click(at) {
    const { draft } = this, { places } = draft, last = places[places.length - 1];
    if (draft.canClose && this.#gap(places[0], at) < CLOSE_BY) { this.finish(true); return; }
    if (last && this.#gap(last, at) < 3) return; // the second press of a double-click
    this.#set(this.#place(at));
  }

  #set(place) {
    this.draft.places.push(place);
    this.draft.isSet = true;
    this.#count();
    if (this.draft.tool === "ground" && this.draft.places.length === 2) this.finish(false);
    this.page.invalidate();
  }

  #count() { this.draft.canClose = this.draft.tool !== "ground" && this.draft.places.length > 2; }

  // ---- keys ---------------------------------------------------------------------------------------------------------

  key(key, event, arrow) {
    const { draft, page } = this;
    if (key === "Escape") { this.cancel(); return true; }
    if (key === "Backspace" || key === "Delete") {
      draft.places.pop();
      this.#count();
      page.invalidate();
      return true;
    }
    if (arrow) {
      const step = PEN_STEPS[event.shiftKey ? 0 : 1] / page.view.k;
      draft.next ??= draft.places[draft.places.length - 1] ?? this.#place([page.view.width / 2, page.view.height / 2]);
      draft.next = draft.next.map((v, c) => v + step * arrow[c]);
      Object.assign(draft, { isByKeys: true, isSet: false });
      page.speak(`pen at ${draft.next.map(shownLength).join(", ")}`);
      page.invalidate();
      return true;
    }
    if (key !== "Enter") return false;
    if (draft.isByKeys && !draft.isSet) {
      this.#set([...draft.next]);
      if (this.isOn) page.speak(`place ${draft.places.length} set`);
    } else this.finish(draft.tool === "part");
    return true;
  }

  // ---- the end ------------------------------------------------------------------------------------------------------

  // Makes the shape, or says why it cannot be one and goes on drawing.
  finish(isClosed) {
    const { draft, page } = this, { tool, places } = draft, least = isClosed || tool === "part" ? 3 : 2;
    if (places.length < least) { page.hint(`A ${PEN_WORDS[tool]} needs ${least} places at least`, 4000); return false; }
    const [a0, a1, b0, b1] = page.box;
    const region = tool === "ground" ? groundThrough(places[0], places[1], [(a0 + a1) / 2, (b0 + b1) / 2])
      : { kind: isClosed || tool === "part" ? "polygon" : "line", vertices: places };
    const fault = regionFault(region);
    if (fault) { page.say(fault.includes("crosses") ? `${fault} Draw it without a loop.` : fault, true); return false; }
    this.stop();
    page.addShape(tool === "cut" ? "cuts" : "parts", region, tool === "ground" ? "ground" : "");
    return true;
  }
}

// What the editor does with cuts and rigid parts. EditorPage is this and the edits of points.

const ADD_WORDS = { cuts: "add cut", parts: "add rigid part" };

export class EditorShapes extends EditorDrawing {
  // The settings of a fit, with the shapes as they are under the hand.
  get settings() { return { ...settingsOf(this.model), ...this.shapes }; }

  get strength() { return settingsOf(this.model).strength ?? 1; }

  // How far the two places lie apart that turn a half plane, in units of the picture.
  get shapeReach() {
    const [a0, a1, b0, b1] = this.box;
    return Math.hypot(a1 - a0, b1 - b0) / 8;
  }

  get chosenShape() { return this.chosen ? this.shapes[this.chosen.what]?.[this.chosen.index] ?? null : null; }

  drawShapes() {
    const regions = this.layered?.regions ?? [];
    if (this.chosen && !this.chosenShape) this.chosen = null;
    const isLost = this.shapeHandles.update(this.shapes, this.chosen, this.view, { reach: this.shapeReach,
      isLocked: this.isLocked, sideKey: (a, b) => sidesKey(regions, a, b) });
    this.shapeHandles.showDraft(this.pen.draft ?? this.offeredDraft, this.view);
    return isLost;
  }

  // Which mark a point has: that of the region in which its source lies; null where no cut parts the picture.
  markOf(point) {
    const regions = this.layered?.regions ?? [];
    return regions.length ? sidesKey(regions, ...point.source) % REGION_MARKS : null;
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  // All cuts or parts after an edit, unless it is no shape or no fit is possible with it: then it is said why.
  editShapes(what, shapes, kind, wasFine = !this.error, points = this.points) {
    if (this.isLocked || sameShapes(shapes, this.sender.shapes[what])) return false;
    if (shapes.length > MOST_SHAPES[what]) {
      this.say(`A picture takes ${MOST_SHAPES[what]} ${SHAPE_NAMES[what]}s at most; remove one first.`, true);
      return false;
    }
    const fault = shapes.map(({ region }) => regionFault(region)).find(Boolean);
    if (fault) { this.say(fault, true); return false; }
    if (wasFine && !this.accepts(points, { ...this.shapes, [what]: shapes })) return false;
    if (JSON.stringify(shapes).length > LONGEST_EDIT) { this.say("These shapes are too large to send.", true); return false; }
    this.sender.editShapes(what, shapes, kind, points); // which tells all views, this one too
    return true;
  }

  addShape(what, region, name = "") {
    const shape = cleanShapes([{ region, name }], what)[0];
    if (this.editShapes(what, [...this.shapes[what], shape], ADD_WORDS[what])) this.#added(what);
    else {
      this.focusStage();
      if (what === "parts") this.#offer(shape);
    }
  }

  #added(what) {
    const index = this.shapes[what].length - 1, shape = this.shapes[what][index];
    this.chooseShape({ what, index });
    this.drawNow();
    this.shapeHandles.focus(this.chosen);
    this.speak(`${shapeLabel(shape, what, index)}, added`);
    if (what === "cuts") this.hint("Each side bends by its own points now: put some on both, and pull them apart", 6000);
  }

  // ---- a part around points that ask for something else -------------------------------------------------------------

  // Keeps the outline, says what is the matter, and asks what shall become of the points.
  #offer(shape) {
    const held = this.#heldBy(shape);
    if (!held.length) return;
    const who = held.length === 1 ? rbfLabel(held[0]) : `${held.length} control points`, it = held.length === 1 ? "it" : "them";
    const whose = held.length === 1 ? "its" : "their";
    this.say(`${who[0].toUpperCase()}${who.slice(1)} in this rigid part asks for another movement than the part's. Carry ${it} ` +
      `with the part (${whose} drag goes), or switch ${it} off?`);
    this.offered = shape;
    for (const [how, text] of [["carry", `Carry ${it}`], ["off", `Switch ${it} off`]]) {
      const button = pageElement("button", "dnb-ed-offer", this.alert, { type: "button", "data-offer": how, ...OWN_KEYS });
      button.textContent = text;
      button.addEventListener("click", () => this.guard(() => this.#takeOffer(how)));
    }
    this.invalidate();
  }

  #heldBy(shape) {
    return heldPoints(this.points, [...this.shapes.parts, shape], this.strength).filter(({ part }) => part === shape)
      .map(({ point }) => point);
  }

  // A part that is drawn is fixed: what it carries goes back to where it was taken.
  #takeOffer(how) {
    const shape = this.offered, ids = this.#heldBy(shape).map(({ id }) => id);
    const points = how === "carry" ? resetPoints(this.points, ids) : changed(this.points, ids, () => ({ active: false }));
    const kind = `${ADD_WORDS.parts}, ${how === "carry" ? "carry" : "switch off"} its points`;
    this.dropOffer();
    if (this.editShapes("parts", [...this.shapes.parts, shape], kind, true, ids.length ? points : this.points)) this.#added("parts");
  }

  // Whether there was one.
  dropOffer() {
    if (!this.offered) return false;
    this.say("");
    return true;
  }

  // The outline as it is drawn, until it is known what becomes of the points in it.
  get offeredDraft() {
    if (!this.offered) return null;
    const corners = cornersOf(this.offered.region, this.shapeReach);
    return { tool: "part", places: [...corners, corners[0]], next: null };
  }

  #change(change, kind) {
    const { what, index } = this.chosen, shape = this.chosenShape;
    return this.editShapes(what, withShape(this.shapes[what], index, change), `${kind} ${shape.name || SHAPE_NAMES[what]}`);
  }

  removeShape() {
    const { what, index } = this.chosen, name = shapeName(this.chosenShape, what, index);
    if (!this.editShapes(what, this.shapes[what].filter((_, k) => k !== index), `remove ${SHAPE_NAMES[what]}`)) return;
    this.chosen = null;
    this.drawNow();
    this.focusStage();
    this.speak(`${name} deleted`);
  }

  switchShape() {
    const isOn = this.chosenShape.enabled;
    if (this.#change({ enabled: !isOn }, "switch")) this.speak(`switched ${isOn ? "off" : "on"}`);
  }

  turnShape() {
    const region = turnedRegion(this.chosenShape.region);
    if (!region) { this.hint("What is closed has only one inside"); return; }
    if (this.#change({ region }, "turn over")) this.speak("turned over");
  }

  removeCorner(k) {
    const region = removedCorner(this.chosenShape.region, k);
    if (!region) { this.removeShape(); return; }
    if (!this.#change({ region }, "change")) return;
    this.drawNow();
    this.shapeHandles.focusCorner(Math.min(k, region.vertices.length - 1));
    this.speak(`corner ${k + 1} deleted`);
  }

  // A corner in the middle of edge k, of which the number is returned.
  insertCorner(k) {
    const { vertices } = this.chosenShape.region, p = vertices[k], q = vertices[(k + 1) % vertices.length];
    const region = insertedCorner(this.chosenShape.region, k, [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2]);
    if (!this.#change({ region }, "change")) return null;
    this.drawNow();
    this.shapeHandles.focusCorner(k + 1);
    return k + 1;
  }

  nudgeShape(grip, [dx, dy], pixels) {
    const { region } = this.chosenShape, [du, dv] = this.model.get("raster").spacing, by = [dx * pixels * du, dy * pixels * dv];
    let corner = grip?.corner ?? null;
    if (grip?.middle !== undefined && grip.middle !== null) corner = this.insertCorner(grip.middle);
    if (corner === null) this.#change({ region: movedRegion(region, ...by) }, "move");
    else {
      const at = cornersOf(this.chosenShape.region, this.shapeReach)[corner];
      const place = [at[0] + by[0], at[1] + by[1]];
      this.#change({ region: movedCorner(this.chosenShape.region, corner, place, this.shapeReach) }, "change");
    }
    this.drawNow();
  }

  // ---- drags --------------------------------------------------------------------------------------------------------

  beginShapeDrag(grip) {
    if (this.isLocked || !this.chosenShape) return;
    let { region } = this.chosenShape;
    if (grip.middle !== null) {
      const { vertices } = region, p = vertices[grip.middle], q = vertices[(grip.middle + 1) % vertices.length];
      region = insertedCorner(region, grip.middle, [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2]);
    }
    const corner = grip.middle !== null ? grip.middle + 1 : grip.corner;
    this.shapes0 = { shapes: this.shapes, region, corner, wasFine: !this.error,
      at: corner === null ? null : cornersOf(region, this.shapeReach)[corner] };
  }

  // The last place that makes a shape stays where the next one does not.
  dragShape(dx, dy) {
    const start = this.shapes0, { k } = this.view;
    if (!start) return;
    const region = start.corner === null ? movedRegion(start.region, dx / k, dy / k)
      : movedCorner(start.region, start.corner, [start.at[0] + dx / k, start.at[1] + dy / k], this.shapeReach);
    const fault = regionFault(region);
    this.stage.classList.toggle("dnb-ed-refusing", Boolean(fault));
    if (fault) { this.hint(fault, 3000); return; }
    const { what, index } = this.chosen;
    this.shapes = { ...this.shapes, [what]: withShape(this.shapes[what], index, { region }) };
    this.changed(true);
  }

  endShapeDrag(isCancelled) {
    const start = this.shapes0, shapes = this.shapes;
    this.shapes0 = null;
    this.stage.classList.remove("dnb-ed-refusing");
    if (!start || !this.chosen) return;
    const { what } = this.chosen, name = this.chosenShape?.name || SHAPE_NAMES[what];
    const kind = `${start.corner === null ? "move" : "change"} ${name}`;
    this.shapes = start.shapes;
    if (!isCancelled && this.editShapes(what, shapes[what], kind, start.wasFine)) {
      this.drawNow();
      if (start.corner !== null) this.shapeHandles.focusCorner(start.corner); // of a new one: it had no grip yet
      return;
    }
    this.shapes = this.sender.shapes;
    this.changed();
  }

  // ---- points that a part holds -------------------------------------------------------------------------------------

  // How far a drag may go before a point would enter a rigid part and ask for something else than the part does.
  allowedShare(before, points) {
    const parts = this.shapes.parts, was = new Set(heldPoints(before, parts, this.strength).map(({ point }) => point.id));
    const heldIn = (given) => heldPoints(given, parts, this.strength).filter(({ point }) => !was.has(point.id));
    const held = heldIn(points);
    if (!held.length) return { share: 1, held };
    const then = new Map(points.map((p) => [p.id, p])), way = (p, q, t) => p.map((v, c) => v + t * (q[c] - v));
    const between = (t) => before.map((p) => ({ ...p, source: way(p.source, then.get(p.id).source, t),
      target: way(p.target, then.get(p.id).target, t) }));
    let low = 0, high = 1;
    for (let turn = 0; turn < 10; turn++) {
      const middle = (low + high) / 2;
      if (heldIn(between(middle)).length) high = middle;
      else low = middle;
    }
    return { share: low, held, points: between(low) };
  }

  // ---- names --------------------------------------------------------------------------------------------------------

  rename(id) {
    const p = this.points.find((q) => q.id === id);
    if (!p || this.isLocked) return;
    const { k, x, y } = this.view;
    this.ask(p.name, `point ${id}`, [k * p.target[0] + x, k * p.target[1] + y], (text) => {
      this.edit(renamedPoint(this.points, id, text), "rename");
    }, () => this.handles.focus(id));
  }

  renameShape() {
    if (this.isLocked || !this.chosenShape) return;
    const { chosen, view } = this, shape = this.chosenShape, { label } = shapePaths(shape.region, view, this.shapeReach);
    this.ask(shape.name, shapeName({ name: "" }, chosen.what, chosen.index), [label[0] - 12, label[1] + 18], (text) => {
      const name = text.trim().slice(0, 80);
      this.editShapes(chosen.what, withShape(this.shapes[chosen.what], chosen.index, { name }), "rename");
    }, () => { this.shapeHandles.focus(chosen); return true; });
  }

  // Asks for a name beside a place of the view; `after` gives the focus back and says whether there was anything to.
  ask(text, placeholder, [x, y], take, after) {
    const { width, height } = this.view;
    this.asked = { take, after };
    this.input.hidden = false;
    this.input.value = text;
    this.input.placeholder = placeholder;
    this.input.style.left = `${Math.max(4, Math.min(width - 164, x + 12))}px`;
    this.input.style.top = `${Math.max(4, Math.min(height - 32, y - 30))}px`;
    this.input.focus();
    this.input.select();
  }

  endRename(isKept) {
    if (this.input.hidden) return;
    const { take, after } = this.asked, hadFocus = this.root.getRootNode().activeElement === this.input;
    this.input.hidden = true;
    if (isKept) this.guard(() => take(this.input.value));
    if (!after() && hadFocus) this.focusStage(); // the point may be gone meanwhile
  }

  // ---- choice and tools ---------------------------------------------------------------------------------------------

  chooseShape(chosen) {
    const was = JSON.stringify(this.chosen);
    this.chosen = chosen && this.shapes[chosen.what]?.[chosen.index] ? { what: chosen.what, index: chosen.index } : null;
    if (this.chosen) this.select([]);
    if (JSON.stringify(this.chosen) !== was) {
      this.sender.choose(this.chosen && { ...this.chosen, shape: toldShape(this.chosenShape) });
    }
    this.invalidate();
  }

  // What is chosen stays so when the lists change, wherever it is then.
  followShapes(shapes) {
    const { chosen } = this, index = chosen && followedShape(this.shapes[chosen.what], shapes[chosen.what], chosen.index);
    this.chosen = chosen && index !== null ? { what: chosen.what, index } : null;
    this.shapes = shapes;
  }

  // Python's choice, once it knows ours: a list beside the picture has chosen, or another window.
  receiveChosen() {
    if (this.sender.isBehind() || this.drag0 || this.shapes0) return;
    const { what, index } = this.model.get("chosen_shape") ?? {}, chosen = this.shapes[what]?.[index] ? { what, index } : null;
    if (JSON.stringify(chosen) === JSON.stringify(this.chosen)) return;
    this.chosen = chosen;
    if (chosen) this.select([]);
    this.invalidate();
  }

  setTool(tool) {
    const was = this.pen.draft?.tool;
    this.pen.stop();
    this.brush.stop();
    if (!tool || was === tool || this.isLocked) { this.invalidate(); return; }
    this.setAdding(false);
    this.setSelecting(false);
    this.chooseShape(null);
    this.dropOffer();
    this.pen.start(tool);
    this.focusStage();
  }

  describeShapes() {
    const shape = this.chosenShape;
    if (!shape) return "";
    const { what, index } = this.chosen;
    return shapeLabel(shape, what, index);
  }

  // "2 regions: (disc) 4, (diamond) 3" where cuts part the picture.
  showLegend() {
    const counts = new Map();
    for (const p of this.points) {
      const mark = this.markOf(p);
      if (mark !== null && p.active) counts.set(mark, (counts.get(mark) ?? 0) + 1);
    }
    const key = JSON.stringify([...counts]);
    if (key === this.legendKey) return;
    this.legendKey = key;
    this.legend.replaceChildren();
    for (const [mark, count] of [...counts].sort(([p], [q]) => p - q)) {
      const title = "points of this region: it bends by these only";
      const entry = pageElement("span", "dnb-ed-region", this.legend, { title });
      const icon = svgElement("svg", { viewBox: "-10 -10 20 20", "aria-hidden": "true", "data-region": mark }, entry);
      if (REGION_FORMS[mark]) svgElement("path", { d: REGION_FORMS[mark] }, icon);
      else svgElement("circle", { r: 7 }, icon);
      pageElement("span", "", entry).textContent = String(count);
    }
    setAttributes(this.legend, { "aria-label": `${counts.size} regions with points` });
  }
}
