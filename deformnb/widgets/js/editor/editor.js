// The editor: a picture that follows its control points. Joined behind the files that deformnb/widgets/editor/editor.py names.
// To Python: edit and history, by sync/edits.js. From Python: done (sender, seq), error (message).

import { resetPoints, samePoints, switchedPoints } from "../maths/points.js";
import { busOf, holdBus, releaseBus } from "../sync/bus.js";
import { RestingTrait, senderOf } from "../sync/edits.js";
import { OWN_KEYS, pageElement, setText, svgElement } from "../ui/dom.js";
import { helpPanel } from "../ui/key_help.js";
import { Toolbar } from "../ui/toolbar.js";
import { Brush } from "./brush_tool.js";
import { NetNodes } from "./grid_nodes.js";
import { Handles, HandMarks } from "./handles.js";
import { Ghost, GHOST_TRAITS, Overlay, OVERLAY_TRAITS } from "./overlays.js";
import { decodePicture, Painter } from "./painter.js";
import { EditorHand } from "./point_tools.js";
import { Gestures } from "./pointer.js";
import { ShapeHandles } from "./shape_handles.js";
import { Pen, PEN_WORDS } from "./shape_tools.js";

const SHAPE_COMMANDS = { remove: (page) => page.removeShape(), rename: (page) => page.renameShape(),
  switch: (page) => page.switchShape(), turn: (page) => page.turnShape() };

class EditorPage extends EditorHand {
  constructor(model, el) {
    super();
    this.model = model;
    this.bus = busOf(model);
    this.bus.views = (this.bus.views ?? 0) + 1;
    this.id = Math.random().toString(36).slice(2);
    this.sender = senderOf(this.bus, model);
    this.sender.receive();
    this.selection = new RestingTrait(model, "selected");
    Object.assign(this, { points: this.sender.points, shapes: this.sender.shapes, chosen: null, shapes0: null,
      selected: new Set(model.get("selected")), layered: null,
      error: "", stopNote: "", net: null, folds: null, drag0: null, isAdding: false, isSelecting: false, isComparing: false, isFitted: true, frame: 0,
      isMoving: false, isDirty: true, view: { k: 1, x: 0, y: 0, width: 1, height: 1, ratio: 1 }, stats: { frames: 0, ms: 0 } });
    this.#build(el);
    this.painter = new Painter(this.canvas);
    this.ghost = new Ghost(this);
    this.overlay = new Overlay(this);
    this.shapeHandles = new ShapeHandles(this.svg); // under the points
    this.handles = new Handles(this.svg);
    this.pen = new Pen(this);
    this.brush = new Brush(this);
    this.marks = new HandMarks(this.svg, this.handles.points);
    this.gestures = new Gestures(this);
    this.netNodes = new NetNodes(this);
    this.#listen();
    this.guard(() => this.receiveChosen());
    this.guard(() => this.showWaiting());
    this.guard(() => this.layout());
    this.loadPicture();
  }

  #build(el) {
    this.host = el;
    el.classList.add("dnb-ed-host");
    // Whatever is clicked in here, the keys are the editor's from then on.
    this.root = pageElement("div", "dnb-editor", el, { tabindex: "-1", role: "group", ...OWN_KEYS });
    this.toolbar = new Toolbar(this, this.root);
    this.stage = pageElement("div", "dnb-ed-stage", this.root, { tabindex: "0", role: "application", ...OWN_KEYS });
    this.canvas = pageElement("canvas", "dnb-ed-canvas", this.stage, { "aria-hidden": "true" });
    this.svg = svgElement("svg", { class: "dnb-ed-svg" }, this.stage);
    const veil = pageElement("div", "dnb-ed-veil", this.stage);
    this.wait = pageElement("div", "dnb-ed-wait", veil, { role: "status" }); // there from the start: so it is read out
    this.input = pageElement("input", "dnb-ed-input", this.stage, { type: "text", maxlength: "80", hidden: "",
      "aria-label": "name", ...OWN_KEYS });
    this.tip = pageElement("div", "dnb-ed-hint", this.stage, { hidden: "", "aria-hidden": "true" });
    this.alert = pageElement("div", "dnb-ed-alert", this.stage, { role: "alert", hidden: "" });
    this.help = helpPanel(this.stage);
    this.status = pageElement("div", "dnb-ed-status", this.root);
    this.facts = pageElement("span", "dnb-ed-facts", this.status);
    this.legend = pageElement("span", "dnb-ed-legend", this.status, { role: "img" });
    this.foldFact = pageElement("span", "dnb-ed-folds", this.status);
    this.notes = pageElement("div", "dnb-ed-notes", this.status);
    this.spoken = pageElement("div", "dnb-ed-spoken", this.root, { "aria-live": "polite" });
    this.root.deformnb = this; // for tests and for whoever looks into the page
  }

  #listen() {
    const handlers = this.handlers = [];
    const on = (name, handler) => {
      const guarded = (...given) => this.guard(() => handler(...given));
      this.model.on(name, guarded);
      handlers.push([name, guarded]);
    };
    on("change:selected", () => { if (!this.selection.isAhead) this.select(this.model.get("selected"), false); });
    on("change:chosen_shape", () => this.receiveChosen());
    on("change:image", () => this.loadPicture());
    on("change:raster", () => this.loadPicture());
    on("change:beyond", () => this.layout());
    on("change:height", () => this.layout());
    on("change:theme", () => this.applyTheme());
    on("change:waiting", () => this.showWaiting());
    on("change:label", () => this.layout());
    for (const name of ["settings", "lone_support", "cut_rule"]) on(`change:${name}`, () => this.changed());
    const shown = ["density", "show_net", "show_radius", "read_only", "history", "mirror", "snap", "stop_at_folds", "brush_radius", "drag_net", ...OVERLAY_TRAITS, ...GHOST_TRAITS];
    for (const name of shown) on(`change:${name}`, () => this.invalidate());
    on("msg:custom", (message) => this.message(message));
    this.moved = (event) => this.guard(() => {
      const { origin, points, phase, settings } = event.detail;
      if (origin === this.id || this.drag0 || this.shapes0) return;
      if (phase !== "move") { this.receive(); return; }
      Object.assign(this, { isFollowing: true, points }); // the view under the hand alone tells the others
      this.shapes = { cuts: settings.cuts ?? [], parts: settings.parts ?? [] };
      this.changed(true);
    });
    const heard = { points: () => this.receive(), status: () => this.showStatus(), history: () => { this.receiveChosen(); this.invalidate(); } };
    this.unlisten = this.sender.listen((what) => this.guard(heard[what]));
    this.bus.addEventListener("deformnb:points", this.moved);
    this.sender.greet();
    this.observer = new ResizeObserver(() => this.guard(() => this.layout()));
    this.observer.observe(this.root);
    this.dark = window.matchMedia("(prefers-color-scheme: dark)");
    this.repaint = () => this.guard(() => this.applyTheme());
    this.dark.addEventListener("change", this.repaint);
    this.themes = new MutationObserver(this.repaint); // Jupyter and VS Code change attributes of the body
    this.themes.observe(document.body, { attributes: true, attributeFilter: ["class", "data-jp-theme-light",
      "data-jp-theme-name", "data-vscode-theme-kind"] });
    this.closed = new AbortController();
    const { signal } = this.closed;
    this.input.addEventListener("keydown", (e) => {
      e.stopPropagation();
      if (e.key === "Enter") this.endRename(true);
      if (e.key === "Escape") this.endRename(false);
    }, { signal });
    this.input.addEventListener("blur", () => this.endRename(true), { signal });
  }

  close() {
    this.gestures.close();
    this.netNodes.close();
    this.ghost.close();
    this.sender.flush();
    this.unlisten();
    this.closed.abort();
    this.selection.close();
    for (const [name, handler] of this.handlers) this.model.off(name, handler);
    this.bus.removeEventListener("deformnb:points", this.moved);
    this.dark.removeEventListener("change", this.repaint);
    this.observer.disconnect();
    this.themes.disconnect();
    cancelAnimationFrame(this.frame);
    for (const timer of [this.restTimer, this.tipTimer, this.alertTimer]) clearTimeout(timer);
    this.bus.views -= 1;
    if (this.bus.views === 0) this.bus.latest = null; // nobody fits any more: followers take the traits
    this.root.remove();
    this.host.classList.remove("dnb-ed-host");
  }

  // Whatever goes wrong in here is said in the widget, and the page goes on.
  guard(action) {
    try { return action(); } catch (error) {
      console.error(error);
      this.say(`The editor met an error: ${error.message}`);
      return undefined;
    }
  }

  // ---- the model ----------------------------------------------------------------------------------------------------

  // The points of this window, wherever they came from; the hand goes first.
  receive() {
    if (this.drag0 || this.shapes0) return;
    if (samePoints(this.sender.points, this.points) && this.sender.shapes === this.shapes) return;
    this.points = this.sender.points;
    this.followShapes(this.sender.shapes);
    this.select([...this.selected]);
    this.receiveChosen();
    this.changed();
  }

  message(message) {
    if (message?.type === "error") this.say(String(message.message), true);
    if (message?.type === "draw" && message.tool in PEN_WORDS && this.pen.draft?.tool !== message.tool) this.setTool(message.tool);
    if (message?.type === "look") this.lookAt(message.id);
  }

  set(name, value) {
    this.model.set(name, value);
    this.model.save_changes();
    this.invalidate();
  }

  async loadPicture() {
    const ticket = this.ticket = {}, bytes = this.model.get("image"), raster = this.model.get("raster");
    try {
      if (!bytes || !bytes.byteLength) this.painter.source = null;
      else {
        const decoded = await decodePicture(bytes, raster);
        if (this.ticket !== ticket) return;
        this.painter.source = decoded;
      }
    } catch (error) {
      if (this.ticket === ticket) this.say(`The picture could not be shown: ${error.message}`);
    }
    this.guard(() => this.layout());
  }

  // Whether wheel and fingers are the editor's, and not the page's around it. An application has nothing to scroll.
  get isWorkedIn() { return Boolean(this.model.get("fill")) || this.root.matches(":focus-within"); }

  get isWaiting() { return Boolean(this.model.get("waiting")); }

  get isLocked() { return this.isWaiting || this.model.get("read_only") || this.isBefore; }

  // While Python makes another picture, nothing here can be edited; a hand that is at it is as if it had not begun.
  showWaiting() {
    const { isWaiting } = this;
    if (isWaiting) {
      this.gestures.cancel();
      this.endRename(false);
      this.setAdding(false);
      this.pen.stop();
      this.brush.stop();
    }
    this.stage.classList.toggle("dnb-ed-waiting", isWaiting);
    this.stage.setAttribute("aria-busy", String(isWaiting));
    setText(this.wait, this.model.get("waiting") || "");
    this.invalidate();
  }

  get box() {
    const { shape: [nv, nu], spacing: [du, dv], origin: [a, b] } = this.model.get("raster");
    return [a - du / 2, a + (nu - 0.5) * du, b - dv / 2, b + (nv - 0.5) * dv];
  }

  // All that is drawn: the picture's box, and what the result's box holds beyond it.
  get sheet() {
    const { box } = this, beyond = this.model.get("beyond") ?? [];
    return box.map((x, n) => (beyond.length === 4 ? (n % 2 ? Math.max : Math.min)(x, beyond[n]) : x));
  }

  // ---- selection and commands ---------------------------------------------------------------------------------------

  select(ids, isShared = true) {
    const known = new Set(this.points.map((p) => p.id)), next = new Set((ids ?? []).filter((id) => known.has(id)));
    const isSame = next.size === this.selected.size && [...next].every((id) => this.selected.has(id));
    this.selected = next;
    if (next.size) this.chooseShape(null);
    this.invalidate();
    if (isSame || !isShared) return;
    this.selection.tellSoon([...this.selected]);
  }

  toggleSelected(id) {
    this.select(this.selected.has(id) ? [...this.selected].filter((other) => other !== id) : [...this.selected, id]);
  }

  pointsInside({ x, y, width, height }) {
    const v = this.view;
    return this.points.filter(({ target: [a, b] }) => {
      const px = v.k * a + v.x - x, py = v.k * b + v.y - y;
      return px >= 0 && py >= 0 && px <= width && py <= height;
    }).map((p) => p.id);
  }

  run(command, focused) {
    const ids = focused !== null && !this.selected.has(focused) ? [focused] : [...this.selected];
    const { width, height } = this.view, all = this.points.map((p) => p.id);
    if (focused === null && this.toolbar.isOff(command)) return;
    const isShape = this.chosen !== null && focused === null && ids.length === 0;
    if (isShape && SHAPE_COMMANDS[command]) { if (!this.isLocked) SHAPE_COMMANDS[command](this); return; }
    if (this.runTool(command, ids)) return;
    const commands = {
      cut: () => this.setTool("cut"), part: () => this.setTool("part"), ground: () => this.setTool("ground"),
      add: () => this.setAdding(!this.isAdding), remove: () => this.remove(ids), undo: () => this.stepHistory("undo"),
      redo: () => this.stepHistory("redo"), rename: () => ids.length === 1 && this.rename(ids[0]),
      switch: () => this.change(switchedPoints(this.points, ids), "switch"),
      reset: () => this.change(resetPoints(this.points, this.freed(ids.length ? ids : all)), "reset"),
      net: () => this.set("show_net", !this.model.get("show_net")),
      radius: () => this.set("show_radius", !this.model.get("show_radius")),
      overlay: () => this.overlay.next(),
      compare: () => { this.isComparing = !this.isComparing; this.invalidate(); },
      "zoom-in": () => this.zoomAt(1.25, width / 2, height / 2), "zoom-out": () => this.zoomAt(0.8, width / 2, height / 2),
      fit: () => this.fitView(), help: () => this.toggleHelp(),
    };
    commands[command]?.();
  }

  setAdding(isAdding) {
    if (isAdding) { this.pen.stop(); this.brush.stop(); this.setSelecting(false); }
    this.isAdding = isAdding && !this.isLocked;
    this.stage.classList.toggle("dnb-ed-adding", this.isAdding);
    if (this.isAdding) this.hint("Click where a feature is, and drag it. Esc when done");
    this.invalidate();
  }

  // While it is on, whatever is dragged around or clicked is added to what is selected: fingers have no Shift key.
  setSelecting(isSelecting) {
    if (isSelecting) { this.pen.stop(); this.brush.stop(); this.setAdding(false); }
    this.isSelecting = isSelecting;
    this.stage.classList.toggle("dnb-ed-selecting", isSelecting);
    if (isSelecting) this.hint("Drag a band around points, or tap one after the other. Esc when done", 4000);
    this.invalidate();
  }

  // Whether there was one.
  stopModes() {
    const was = this.isAdding || this.isSelecting;
    this.setAdding(false);
    this.setSelecting(false);
    return was;
  }

  // The focus goes to the list, and back to where it was.
  toggleHelp() {
    const { activeElement } = this.root.getRootNode();
    this.help.hidden = !this.help.hidden;
    if (!this.help.hidden) {
      this.beforeHelp = this.root.contains(activeElement) ? activeElement : null;
      this.help.focus();
    } else if (this.beforeHelp?.isConnected) this.beforeHelp.focus({ preventScroll: true });
    else this.focusStage();
    this.invalidate();
  }

  closeHelp() {
    if (this.help.hidden) return false;
    this.toggleHelp();
    return true;
  }

  focusStage() { this.stage.focus({ preventScroll: true }); }
}

function render({ model, el }) {
  const page = new EditorPage(model, el);
  return () => page.close();
}

function initialize({ model }) {
  const bus = busOf(model), uid = model.get("uid");
  holdBus(bus);
  const sender = senderOf(bus, model), leave = () => sender.flush(); // a page that goes says its last word
  sender.attach(model); // two consoles of one kernel have two models of one editor
  window.addEventListener("pagehide", leave);
  model.on("destroy", () => {
    window.removeEventListener("pagehide", leave);
    sender.detach(model);
    if (sender.models.length === 0) bus.sender = null;
    releaseBus(bus, uid);
  });
}

export default { initialize, render };
