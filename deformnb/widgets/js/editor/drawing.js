// How the picture follows a hand: pictures a second while points move, and milliseconds from a movement to its picture.
// No DOM. What was measured goes to Python with the edit that ends the drag, for no message is worth a drag's time.

import { layeredFit } from "../maths/cuts.js";
import { foldsOf, probesOf } from "../maths/folds.js";
import { shownLength } from "../maths/numbers.js";
import { RBF_KERNELS, RbfError } from "../maths/rbf.js";
import { isStill } from "../maths/rigid_stages.js";
import { turnedRegion } from "../maths/shapes.js";
import { deformedNet, NO_CUTS } from "../maths/warp_map.js";
import { publishPoints } from "../sync/bus.js";
import { setAttributes, setText } from "../ui/dom.js";

const FEWEST_PICTURES = 4; // of a drag, below which a rate says nothing
const MOST_PICTURES = 1200;
const PAUSE = 400; // milliseconds: a hand that rests is not followed slowly

export class DrawRate {
  constructor() { this.forget(); }

  forget() { Object.assign(this, { asked: null, last: null, spans: [], waits: [] }); }

  /** A hand has moved points, at this time in milliseconds. */
  moved(now) { this.asked ??= now; }

  /** The picture of what was moved last is drawn. */
  drew(now) {
    if (this.asked === null) return;
    this.waits.push(now - this.asked);
    if (this.last !== null && now - this.last < PAUSE) this.spans.push(now - this.last);
    Object.assign(this, { last: now, asked: null });
    for (const list of [this.waits, this.spans]) if (list.length > MOST_PICTURES) list.shift();
  }

  /** {hz, ms} of the drag that ends now, or null after a short one; the next begins anew. */
  taken() {
    const { spans, waits } = this, middle = (list) => [...list].sort((a, b) => a - b)[list.length >> 1];
    this.forget();
    if (waits.length < FEWEST_PICTURES || spans.length === 0) return null;
    const mean = spans.reduce((sum, span) => sum + span, 0) / spans.length;
    return { hz: Math.round(10000 / Math.max(mean, 1)) / 10, ms: Math.round(10 * middle(waits)) / 10 };
  }
}

// What the editor draws and says: its view, the frames, the status line, hints. EditorPage is this and the edits.

const MARGIN = 20; // CSS pixels around the picture, so that points on its edge can be seen and grabbed
const REST = 120; // milliseconds after which the full picture is drawn
export const NEARLY_FOLDED = 0.05; // of det J, found on a lattice: between its nodes it may well be less
const LOOK_ZOOM = 2.5; // times the whole picture, where one looks at a point
const UNKNOWN_WIDTH = 420; // CSS pixels, until the page has laid the editor out

const FOLD_TIP = "min det J: the smallest factor by which areas are stretched on the way back from this picture to the " +
  "original. 1 keeps them; below 0 the picture folds over itself";

// What is said of a kernel that does not answer, by the sender's status.
const SILENCE = {
  busy: "The kernel is busy; the volume in Python follows later",
  silent: "No answer from Python yet; these points stay in the page until it answers",
  deaf: "This view was loaded too slowly and does not hear Python: run the cell again",
  lost: "The kernel was restarted or is gone: Python does not get these edits. Run the cell again",
};

const FINAL = new Set(["deaf", "lost"]); // of these it is said as long as the page stands
const LONGEST_TIMER = 2 ** 31 - 1; // milliseconds

export class EditorDrawing {
  rate = new DrawRate();

  // ---- the view -----------------------------------------------------------------------------------------------------

  layout() {
    this.applyTheme(); // a style sheet that comes late changes sizes as well
    const [a0, a1, b0, b1] = this.sheet, aspect = (b1 - b0) / (a1 - a0), most = Math.max(120, this.model.get("height"));
    const isFilling = Boolean(this.model.get("fill")); // the application gives the editor a place to fill, Jupyter none
    const width = Math.max(120, this.stage.clientWidth || UNKNOWN_WIDTH);
    const height = Math.round(isFilling ? most : Math.max(120, Math.min(most, (width - 2 * MARGIN) * aspect + 2 * MARGIN)));
    this.stage.style.height = `${height}px`;
    this.stage.classList.toggle("dnb-ed-filling", isFilling);
    this.root.setAttribute("aria-label", `Editor of ${this.model.get("label") || "Picture"}`);
    this.stage.setAttribute("aria-label", `${this.model.get("label") || "Picture"} with control points. Tab leads to ` +
      "them, Ctrl and arrows from one to the next, arrows move, Enter adds, question mark lists the keys.");
    const ratio = Math.min(2, Math.max(1, window.devicePixelRatio || 1)), v = this.view;
    const [dx, dy] = [(width - v.width) / 2, (height - v.height) / 2];
    Object.assign(v, { width, height, ratio });
    this.painter.resize(width, height, ratio);
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    if (this.isFitted) this.fitView();
    else Object.assign(v, { x: v.x + dx, y: v.y + dy });
    this.drawNow(); // at once: a canvas that was resized is empty
  }

  get fittedScale() {
    const [a0, a1, b0, b1] = this.sheet, { width, height } = this.view;
    return Math.min((width - 2 * MARGIN) / (a1 - a0), (height - 2 * MARGIN) / (b1 - b0));
  }

  fitView() {
    const [a0, a1, b0, b1] = this.sheet, { width, height } = this.view, k = this.fittedScale;
    Object.assign(this.view, { k, x: width / 2 - k * (a0 + a1) / 2, y: height / 2 - k * (b0 + b1) / 2 });
    this.isFitted = true;
    this.invalidate();
  }

  panBy(dx, dy) {
    Object.assign(this.view, { x: this.view.x + dx, y: this.view.y + dy });
    this.#keepInSight();
    this.moving();
  }

  zoomAt(factor, x, y) {
    const v = this.view, fitted = this.fittedScale, k = Math.max(fitted / 4, Math.min(fitted * 64, v.k * factor));
    const f = k / v.k;
    Object.assign(v, { k, x: x + f * (v.x - x), y: y + f * (v.y - y) });
    this.#keepInSight();
    this.moving();
  }

  // A point in the middle of the view, and so near that one sees what it holds.
  lookAt(id) {
    const p = this.points.find((q) => q.id === id), v = this.view, k = Math.max(v.k, LOOK_ZOOM * this.fittedScale);
    if (!p) return;
    Object.assign(v, { k, x: v.width / 2 - k * p.target[0], y: v.height / 2 - k * p.target[1] });
    this.#keepInSight();
    this.moving();
    this.stage.scrollIntoView({ block: "nearest" }); // who asks from a table below may not see the picture
    this.handles.blink([id]);
  }

  // Some of the picture stays in the view, so that nobody is lost in the grey.
  #keepInSight() {
    const [a0, a1, b0, b1] = this.sheet, v = this.view, rest = 40;
    v.x = Math.max(rest - v.k * a1, Math.min(v.width - rest - v.k * a0, v.x));
    v.y = Math.max(rest - v.k * b1, Math.min(v.height - rest - v.k * b0, v.y));
    this.isFitted = false;
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  changed(isMoving = false) {
    this.isDirty = true;
    if (isMoving) this.moving();
    else this.invalidate();
  }

  moving() {
    this.isMoving = true;
    clearTimeout(this.restTimer);
    this.restTimer = setTimeout(() => { this.isMoving = false; this.net = this.folds = null; this.invalidate(); }, REST);
    this.invalidate();
  }

  invalidate() {
    if (!this.frame) this.frame = requestAnimationFrame(() => { this.frame = 0; this.guard(() => this.draw()); });
  }

  drawNow() {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.guard(() => this.draw());
  }

  draw() {
    const start = performance.now();
    this.isBefore = this.netNodes.side === "before";
    if (this.isDirty) this.refit();
    const fitted = performance.now(), { isMoving } = this, fit = this.isComparing || this.isBefore ? null : this.layered;
    this.stats.paint = this.painter.paint(this.view, fit, { isMoving, paper: this.colours.stage, sheet: this.sheet });
    this.painter.drawFrame(this.view, this.sheet);
    const painted = performance.now();
    if (this.model.get("show_net") && this.model.get("density") > 0) this.drawNet(fit);
    const drawn = performance.now();
    if (this.layered && !this.folds) this.folds = this.measuredFolds();
    this.ghost.draw();
    this.overlay.draw(fit, this.folds, isMoving);
    const laid = performance.now();
    const reach = this.reach(), radius = this.model.get("show_radius") ? reach : 0;
    const isLost = this.drawShapes(), marks = (p) => this.markOf(p);
    this.handles.suspects = new Set(this.model.get("marked") ?? []);
    this.netNodes.update(fit);
    const points = this.netNodes.shown(this.points);
    if (this.handles.update(points, this.selected, this.view, radius, reach, marks) || isLost) this.focusStage();
    this.marks.update(this);
    this.brush.show();
    this.describe();
    const end = performance.now();
    this.rate.drew(end);
    Object.assign(this.stats, { ms: end - start, frames: this.stats.frames + 1, parts: { fit: fitted - start,
      picture: painted - fitted, net: drawn - painted, overlay: laid - drawn, handles: end - laid }, isMoving });
  }

  refit() {
    this.isDirty = false;
    if (this.isBefore) return; // shows no fit
    const settings = this.settings;
    try {
      this.layered = layeredFit(this.points, { ...settings, previous: this.layered });
      this.error = "";
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      this.error = error.message; // the last good picture stays
    }
    this.net = this.folds = null; // of these points, looked at once more when they rest
    const phase = this.drag0 || this.shapes0 ? "move" : "end", layered = this.error ? null : this.layered;
    if (!this.isFollowing) publishPoints(this.bus, { origin: this.id, points: this.points, settings, fit: layered?.fit ?? null, layered, phase });
    this.isFollowing = false;
    if (this.drag0 && this.isLive && this.model.get("live")) {
      this.sender.move(this.points);
      this.wasTold = true;
    }
    this.isLive = false;
  }

  // The fit where there are no cuts, as tests and the curious look for it.
  get fit() { return this.layered?.fit ?? null; }

  drawNet(layered) {
    const cells = this.model.get("density"), { isMoving } = this, count = layered?.count ?? 0;
    const affordable = Math.floor((isMoving ? 8e4 : 32e4) / (cells * cells * Math.max(1, count)));
    const isBent = (layered?.fits ?? []).some(({ fit }) => !isStill(fit)) || (layered?.regions.length ?? 0) > 0;
    const parts = isBent ? Math.min(isMoving ? 3 : 8, Math.max(isMoving ? 1 : 2, affordable)) : 1;
    const key = [layered, cells, parts, String(this.box)];
    if (!this.net || key.some((value, k) => value !== this.net.key[k])) {
      this.net = { key, lines: deformedNet(layered ?? NO_CUTS, this.box, cells, parts, (isMoving ? 0.2 : 0.05) / this.view.k) };
    }
    this.painter.drawNet(this.view, this.net.lines, this.colours.net);
  }

  // Where the map folds; only at rest as finely as the status line tells.
  measuredFolds() {
    const { layered, isMoving } = this, probes = probesOf(layered, isMoving ? 5e4 : 4e5);
    return { ...foldsOf(layered, this.box, layered.count > 200 ? 9 : isMoving ? 17 : 33, probes), probes };
  }

  // How far a point reaches, in units of the picture; 0 where nothing tells.
  reach() {
    const fit = this.layered?.fits.map((one) => one.fit).find((one) => one.count > 0);
    if (!fit) return 0;
    const { order } = RBF_KERNELS[fit.kernel]; // with cuts, every region has a reach of its own: that of the first is told
    return order === 2 || fit.kernel === "linear" ? 0 : fit.support; // those kernels know no radius
  }

  // ---- words --------------------------------------------------------------------------------------------------------

  showStatus() {
    const text = SILENCE[this.sender.status];
    if (text) this.hint(text, FINAL.has(this.sender.status) ? LONGEST_TIMER : 8000);
    else if (Object.values(SILENCE).includes(this.tip.textContent)) this.tip.hidden = true;
  }

  // A sentence over the picture; a passing one goes after a while.
  say(message, isPassing = false) {
    clearTimeout(this.alertTimer);
    if (this.offered) this.invalidate();
    this.offered = null; // a part that waits for an answer
    this.alert.hidden = !message;
    this.alert.textContent = message;
    if (isPassing) this.alertTimer = setTimeout(() => { this.alert.hidden = true; }, 8000);
  }

  hint(text, duration = 2500) {
    clearTimeout(this.tipTimer);
    this.tip.hidden = false;
    this.tip.textContent = text;
    this.tipTimer = setTimeout(() => { this.tip.hidden = true; }, duration);
  }

  // Takes a hint away before its time, if it is one of these.
  hideHint(texts) { if (texts.includes(this.tip.textContent)) this.tip.hidden = true; }

  speak(text) { setText(this.spoken, text); }

  // Colours of the page around, light or dark: Jupyter's and VS Code's own variables, else the browser's preference.
  applyTheme() {
    this.root.dataset.theme = this.model.get("theme") || "auto";
    const [r, g, b, alpha = 1] = (getComputedStyle(this.root).backgroundColor.match(/[\d.]+/g) ?? []).map(Number);
    const isDark = alpha > 0 && r !== undefined ? 0.2126 * r + 0.7152 * g + 0.0722 * b < 110 : this.dark.matches;
    this.root.classList.toggle("dnb-ed-dark", isDark);
    const style = getComputedStyle(this.root), colour = (name) => style.getPropertyValue(name).trim() || "#777";
    this.colours = { stage: colour("--dnb-stage"), net: colour("--dnb-net") };
    this.invalidate();
  }

  describe() {
    const { points, selected, layered: fit } = this, off = points.filter((p) => !p.active).length;
    const count = `${points.length} ${points.length === 1 ? "point" : "points"}${off ? `, ${off} off` : ""}`;
    const one = selected.size === 1 ? points.find((p) => selected.has(p.id)) : null;
    const chosen = one ? `point ${one.id}${one.name ? ` ${one.name}` : ""} at ${one.target.map(shownLength).join(", ")}`
      : selected.size ? `${selected.size} selected` : this.describeShapes();
    this.showLegend();
    setText(this.facts, points.length ? [count, chosen].filter(Boolean).join(" \u00b7 ")
      : "No points yet: three or more bend the picture, one moves it, two turn and scale it");
    const folds = this.folds ?? { least: 1, share: 0 };
    this.#describeFolds(folds);
    // The fit only suspects a fold; the page has looked.
    const remarks = (fit?.notes ?? []).filter((note) => folds.least <= 0 || !fit.doubts.includes(note));
    const notes = this.error || this.stopNote || this.netNodes.warning(folds) || remarks.join("; ");
    setText(this.notes, notes || this.#advice());
    this.notes.classList.toggle("dnb-ed-bad", this.error !== "");
    this.notes.classList.toggle("dnb-ed-near", this.error === "" && notes !== "");
    const tool = this.pen.draft?.tool, isShape = this.chosenShape !== null && selected.size === 0;
    const pressed = Object.entries({ add: this.isAdding, cut: tool === "cut", part: tool === "part",
      ground: tool === "ground", compare: this.isComparing, ...this.pressedTools,
      net: this.model.get("show_net"), radius: this.model.get("show_radius"), help: !this.help.hidden });
    this.toolbar.update({ count: points.length, selected: isShape ? 1 : selected.size,
      pointsSelected: selected.size, turns: isShape &&
      turnedRegion(this.chosenShape.region) !== null, past: this.sender.canStep("undo"),
      future: this.sender.canStep("redo"), steps: this.model.get("history") ?? {},
      pressed: pressed.filter(([, is]) => is).map(([name]) => name), readOnly: this.isLocked });
  }

  #describeFolds({ least, share }) {
    const value = `min det J ${least.toFixed(2)}`, much = share > 0 ? ` on ${(100 * share).toFixed(share < 0.1 ? 1 : 0)} %` : "";
    this.foldFact.classList.toggle("dnb-ed-bad", least <= 0);
    this.foldFact.classList.toggle("dnb-ed-near", least > 0 && least < NEARLY_FOLDED);
    const words = least <= 0 ? `\u25b2 folds${much}` : least < NEARLY_FOLDED ? "\u25b2 nearly folds" : "\u2713 no folds";
    setText(this.foldFact, this.points.length ? `${words} (${value})` : "");
    setAttributes(this.foldFact, { title: this.points.length ? FOLD_TIP : "" });
  }

  // What can be done next, where there is nothing to remark.
  #advice() {
    if (this.model.get("read_only")) return "These points are shown only";
    const isUntouched = this.points.every((p) => p.source.every((value, k) => value === p.target[k]));
    const start = isUntouched ? "Double-click adds a point. " : "";
    if (this.brush.isOn) return "Drag in the picture; [ and ] or the wheel change the circle, Ctrl + wheel zooms, Escape ends";
    if (this.isSelecting) return "Drag a band around points, or tap them; a second tap takes one out again; Escape ends";
    if (this.pen.isOn) return "Backspace takes the last place back, Escape gives up";
    if (this.chosenShape) {
      return "Drag corners, or the middle of an edge for a new one; Delete removes, F2 names, O switches off" +
        `${turnedRegion(this.chosenShape.region) ? ", F turns it over" : ""}`;
    }
    if (this.netNodes.isOn && this.selected.size === 0) return this.netNodes.advice;
    if (this.selected.size === 0) return `${start}Drag a disc to move what lies under it; ? lists all keys`;
    return "Arrows move the selected points, Delete removes them, Home puts them back";
  }
}
