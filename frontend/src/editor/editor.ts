// The editor of a picture, which follows its control points.
// Messages to Python: edit and history, by sync/edits.js. Messages from Python: done (sender, seq), error (message),
// draw (tool), parts (parts, kind), look (id).

import type { EditorToFrontEnd } from "../generated.ts";
import { mapVector } from "../maths/camera.ts";
import { layeredFit, placeOf } from "../maths/cuts.ts";
import { foldsOf, probesOf } from "../maths/folds.ts";
import { samePoints } from "../maths/points.ts";
import { RBF_KERNELS, RbfError } from "../maths/rbf.ts";
import { isStill } from "../maths/rigid_stages.ts";
import { deformedGrid, NO_CUTS } from "../maths/warp_map.ts";
import { publishPoints, settingsOf } from "../sync/bus.ts";
import type { Change } from "../sync/edits.ts";
import { RestingTrait } from "../sync/edits.ts";
import type { FitSettings, LayeredFit, Model, Point, PointsDetail, Shapes, Vector2, Vector4 } from "../types.ts";
import { CompareControls } from "../ui/compare_controls.ts";
import { beforeActionOutside, isWorkedIn, OWN_KEYS, pageElement, setText, svgElement, treeOf } from "../ui/dom.ts";
import { HelpPanel } from "../ui/keys.ts";
import { Toolbar } from "../ui/toolbar.ts";
import { DrawRate, EditorDrawing, initialize } from "./base.ts";
import { Brush } from "./brush_tool.ts";
import { ColourBar } from "./colour_bar.ts";
import { CutBar } from "./cut_bar.ts";
import { FoldStop } from "./fold_stop.ts";
import { GridNodes } from "./grid_nodes.ts";
import { Handles, ToolMarks } from "./handles.ts";
import { GHOST_TRAITS, Ghost, OVERLAY_TRAITS, Overlay } from "./overlays.ts";
import type { Original, PictureSource, View } from "./painter.ts";
import { bytesOf, colourTable, decodePicture, drawGrid, Painter } from "./painter.ts";
import { PartTools } from "./part_tools.ts";
import { PointTools } from "./point_tools.ts";
import { Gestures } from "./pointer.ts";
import { Pen, ShapeTools } from "./shape_tools.ts";
import { StatusLine } from "./status_line.ts";
import { Wand } from "./wand_tool.ts";
import { WindowTool } from "./window_tool.ts";
export type GridLines = ReturnType<typeof deformedGrid>;
/** isRough: found while something moved. */
export type Folds = ReturnType<typeof foldsOf> & { probes: ReturnType<typeof probesOf>; isRough: boolean };

export interface Naming {
  take: (text: string) => void;
  /** gives the focus back; false if the named thing is gone */
  focus: () => boolean;
}

/** Other traits that the drawing depends on. */
const SHOWN = [
  "density",
  "show_grid",
  "show_radius",
  "read_only",
  "history",
  "mirror",
  "snap",
  "stop_at_folds",
  "front_only",
  "brush_radius",
  "drag_grid",
  "wand",
  "slices",
  "slice",
  ...OVERLAY_TRAITS,
  ...GHOST_TRAITS,
];

const MARGIN = 20; // CSS pixels around the picture, so that points on its edge can be seen and grabbed
const REST = 120; // milliseconds after which the full picture is drawn
const LEAST_SEEN = 0.1; // share of the picture, or of the view, that stays in view
const LOOK_ZOOM = 2.5; // times the whole picture, where one looks at a point
const UNKNOWN_WIDTH = 420; // CSS pixels, until the page around has laid the editor out

/** Commands of the toolbar and of keys; `ids` are the points that they are about. */
const COMMANDS: Record<string, (editor: EditorView, ids: number[]) => void> = {
  add: (editor) => editor.setAdding(!editor.isAdding),
  select: (editor) => editor.setSelecting(!editor.isSelecting),
  remove: (editor, ids) => editor.pointTools.remove(ids),
  rename: (editor, ids) => {
    if (ids.length === 1) editor.pointTools.rename(ids[0]!);
  },
  switch: (editor, ids) => editor.pointTools.switch(ids),
  reset: (editor, ids) => editor.pointTools.reset(ids),
  lock: (editor, ids) => editor.pointTools.toggleLock(ids),
  undo: (editor) => editor.stepHistory("undo"),
  redo: (editor) => editor.stepHistory("redo"),
  move: (editor) => editor.setBrush("move"),
  grow: (editor) => editor.setBrush("grow"),
  cut: (editor) => editor.setPen("cut"),
  part: (editor) => editor.setPen("part"),
  fixed: (editor) => editor.setPen("fixed"),
  mirror: (editor) => editor.pointTools.toggleMirror(),
  "mirror-axis": (editor) => editor.pointTools.turnMirror(),
  snap: (editor) => editor.pointTools.toggleSnap(),
  stop: (editor) => editor.toggle("stop_at_folds"),
  "turn-left": (editor) => editor.pointTools.turnKey(-1, { isLarge: true, isScale: false }),
  "turn-right": (editor) => editor.pointTools.turnKey(1, { isLarge: true, isScale: false }),
  grid: (editor) => editor.toggle("show_grid"),
  radius: (editor) => editor.toggle("show_radius"),
  overlay: (editor) => editor.overlay.next(),
  compare: (editor) => {
    editor.isComparing = !editor.isComparing;
    editor.invalidate();
  },
  "zoom-in": (editor) => editor.zoomAt(1.25),
  "zoom-out": (editor) => editor.zoomAt(0.8),
  fit: (editor) => editor.fitView(),
  window: (editor) => editor.windowTool.toggle(),
  wand: (editor) => editor.wand.toggle(),
  help: (editor) => editor.toggleHelp(),
};

/** The same where a shape is chosen. */
const SHAPE_COMMANDS: Record<string, (tools: ShapeTools) => void> = {
  remove: (tools) => tools.remove(),
  rename: (tools) => tools.rename(),
  switch: (tools) => tools.switch(),
  turn: (tools) => tools.turn(),
};

/** The front end of one view of an editor. */
export class EditorView extends EditorDrawing {
  selection: RestingTrait;
  points: Point[];
  shapes: Shapes;
  selected: Set<number>;
  host: HTMLElement;
  toolbar: Toolbar;
  stage: HTMLDivElement;
  canvas: HTMLCanvasElement;
  svg: SVGSVGElement;
  wait: HTMLDivElement;
  input: HTMLInputElement;
  help: HelpPanel;
  statusLine: StatusLine;
  painter: Painter;
  compare: CompareControls;
  ghost: Ghost;
  overlay: Overlay;
  shapeTools: ShapeTools;
  partTools: PartTools;
  foldStop: FoldStop;
  handles: Handles<Point>;
  pointTools: PointTools;
  pen: Pen;
  brush: Brush;
  windowTool: WindowTool;
  wand: Wand;
  cutBar: CutBar;
  colourBar: ColourBar;
  marks: ToolMarks;
  gestures: Gestures;
  gridNodes: GridNodes;

  id = Math.random().toString(36).slice(2);

  rate = new DrawRate();

  view: View = { k: 1, x: 0, y: 0, width: 1, height: 1, ratio: 1 };

  isFitted = true; // whether the view shows the whole picture

  isMoving = false; // whether something has moved within the last moments

  isResting = false; // whether the next frame is the first after a movement: its full picture takes all of it

  isDirty = true; // whether the points are to be fitted again

  isFollowing = false; // whether another view has published the points

  isComparing = false; // whether the picture is shown as it was

  isBefore = false; // whether this view shows the original beside another one

  isAdding = false;

  isSelecting = false;

  error = ""; // the reason why the points cannot be fitted

  /** The last fit that was made, and of what. */
  made: { points: Point[]; settings: FitSettings; layered: LayeredFit } | null = null;

  /** The last good fit that is shown. */
  layered: LayeredFit | null = null;

  /** The grid that was drawn, and what it was made of. */
  grid: { key: unknown[]; lines: GridLines } | null = null;

  folds: Folds | null = null;

  /** The name that is being requested. */
  naming: Naming | null = null;

  restTimer = 0;

  closing = new AbortController();

  #ends: (() => void)[] = [];

  #pictures = 0; // that were requested

  constructor(model: Model, el: HTMLElement) {
    super(model);
    this.bus.views = (this.bus.views ?? 0) + 1;
    this.sender.receive();
    this.selection = new RestingTrait(model, "selected");
    this.points = this.sender.points;
    this.shapes = this.sender.shapes;
    this.selected = new Set(model.get("selected"));
    this.host = el;
    el.classList.add("dnb-ed-host");
    el.append(this.root);
    this.toolbar = new Toolbar(this, this.root);
    this.stage = pageElement("div", "dnb-ed-stage", this.root, { tabindex: "0", role: "application", ...OWN_KEYS });
    this.canvas = pageElement("canvas", "dnb-ed-canvas", this.stage, { "aria-hidden": "true" });
    this.svg = svgElement("svg", { class: "dnb-ed-svg" }, this.stage);
    const veil = pageElement("div", "dnb-ed-veil", this.stage);
    this.wait = pageElement("div", "dnb-ed-wait", veil, { role: "status" }); // there from the start: so it is read out
    this.input = pageElement("input", "dnb-ed-input", this.stage, {
      type: "text",
      maxlength: "80",
      hidden: "",
      "aria-label": "name",
      ...OWN_KEYS,
    });
    this.stage.append(this.tip, this.alert);
    this.help = new HelpPanel(this.stage, this.root, () => this.focusStage());
    this.statusLine = new StatusLine(this);
    this.root.append(this.liveRegion);
    this.painter = new Painter(this.canvas);
    this.compare = new CompareControls(this.stage, () => this.moving());
    this.ghost = new Ghost(this);
    this.overlay = new Overlay(this);
    this.shapeTools = new ShapeTools(this); // whose shapes lie under the points
    this.partTools = new PartTools(this);
    this.foldStop = new FoldStop(this);
    this.handles = new Handles(this.svg);
    this.pointTools = new PointTools(this);
    this.pen = new Pen(this);
    this.brush = new Brush(this);
    this.windowTool = new WindowTool(this);
    this.wand = new Wand(this);
    this.cutBar = new CutBar(this);
    this.colourBar = new ColourBar(this);
    this.marks = new ToolMarks(this.svg, this.handles.points);
    this.gestures = new Gestures(this);
    this.gridNodes = new GridNodes(this);
    beforeActionOutside(
      this.root,
      () => {
        this.selection.flush();
        this.windowTool.trait.flush();
      },
      this.closing.signal,
    );
    Object.assign(this.root, { deformnb: this }); // for tests and for debugging
    this.#followModel();
    this.#followPage();
    this.guard(() => this.shapeTools.receiveChosen());
    this.guard(() => {
      this.applyColours();
      this.#setShows();
    });
    this.guard(() => this.showWaiting());
    this.guard(() => this.layout());
    this.loadPicture();
  }

  #followModel() {
    const { model, bus, sender } = this;
    const on = (name: string, handler: (message: any) => void) => {
      const guarded = (message: any) => this.guard(() => handler(message));
      model.on(name, guarded);
      this.#ends.push(() => model.off(name, guarded));
    };
    on("change:selected", () => {
      if (!this.selection.isAhead) this.select(model.get("selected"), false);
    });
    on("change:chosen_shape", () => this.shapeTools.receiveChosen());
    for (const name of ["image", "raster"]) on(`change:${name}`, () => this.loadPicture());
    for (const name of ["beyond", "height", "label"]) on(`change:${name}`, () => this.layout());
    on("change:theme", () => this.applyTheme());
    on("change:waiting", () => this.showWaiting());
    for (const name of ["settings", "lone_support", "cut_rule"]) on(`change:${name}`, () => this.changed());
    on("change:air", () => this.#forgetFolds());
    on("change:window", () => this.windowTool.apply());
    on("change:colours", () => this.applyColours());
    on("change:shows", () => this.#setShows());
    for (const name of SHOWN) on(`change:${name}`, () => this.invalidate());
    on("msg:custom", (message) => this.message(message));
    const news = {
      points: () => this.receive(),
      status: () => this.showStatus(),
      history: () => {
        this.shapeTools.receiveChosen();
        this.invalidate();
      },
    };
    this.#ends.push(sender.listen((what: Change) => this.guard(news[what])));
    const moved = (event: CustomEvent<PointsDetail>) => this.guard(() => this.#receiveMove(event.detail));
    bus.addEventListener("deformnb:points", moved);
    this.#ends.push(() => bus.removeEventListener("deformnb:points", moved));
    sender.greet();
  }

  #followPage() {
    const { signal } = this.closing;
    const sizes = new ResizeObserver(() => this.guard(() => this.layout()));
    sizes.observe(this.root);
    this.#ends.push(() => {
      sizes.disconnect();
      this.theme.close();
    });
    this.input.addEventListener(
      "keydown",
      (e) => {
        e.stopPropagation();
        if (e.key === "Enter") this.endNaming(true);
        if (e.key === "Escape") this.endNaming(false);
      },
      { signal },
    );
    this.input.addEventListener("blur", () => this.endNaming(true), { signal });
  }

  close() {
    this.gestures.close();
    this.gridNodes.close();
    this.ghost.close();
    this.sender.flush();
    this.selection.close();
    this.windowTool.close();
    this.wand.close();
    this.closing.abort();
    for (const end of this.#ends) end();
    cancelAnimationFrame(this.frame);
    for (const timer of [this.restTimer, this.tipTimer, this.alertTimer]) clearTimeout(timer);
    this.bus.views = (this.bus.views ?? 1) - 1;
    if (this.bus.views === 0) this.bus.latest = null; // nothing fits any more: followers take the traits
    this.root.remove();
    this.host.classList.remove("dnb-ed-host");
  }

  // ---- the model ----------------------------------------------------------------------------------------------------

  /** Take the points of this window, wherever they came from, unless the user is moving some. */
  receive() {
    if (this.isDragging) return;
    if (samePoints(this.sender.points, this.points) && this.sender.shapes === this.shapes) return;
    this.points = this.sender.points;
    this.shapeTools.follow(this.sender.shapes);
    this.select([...this.selected]);
    this.shapeTools.receiveChosen();
    this.changed();
  }

  #receiveMove({ origin, points, phase, settings }: PointsDetail) {
    if (origin === this.id || this.isDragging) return;
    if (phase !== "move") {
      this.receive();
      return;
    }
    this.isFollowing = true; // only the view in which the user drags publishes points
    this.points = points;
    this.shapes = { cuts: settings.cuts ?? [], parts: settings.parts ?? [] };
    this.changed(true);
  }

  message(message: EditorToFrontEnd) {
    if (message.type === "error") this.showMessage(message.message, true);
    if (message.type === "draw" && this.pen.draft?.tool !== message.tool) this.setPen(message.tool);
    if (message.type === "parts" && !this.isDragging) this.partTools.propose(message.parts, message.kind);
    if (message.type === "look") this.lookAt(message.id);
  }

  set(name: string, value: unknown) {
    this.model.set(name, value);
    this.model.save_changes();
    this.invalidate();
  }

  /** Switch a trait that is true or false. */
  toggle(name: string) {
    this.set(name, !this.model.get(name));
  }

  /** @returns of a fit, with the shapes as they are during a drag */
  get settings(): FitSettings {
    return { ...settingsOf(this.model), ...this.shapes };
  }

  get strength(): number {
    return this.settings.strength ?? 1;
  }

  async loadPicture() {
    this.#pictures += 1;
    const number = this.#pictures,
      bytes = this.model.get("image"),
      raster = this.model.get("raster");
    try {
      const source = bytes?.byteLength ? await decodePicture(bytes, raster) : null;
      if (this.#pictures !== number) return;
      if (source && this.model.get("window")?.length) source.setWindow(this.model.get("window"));
      this.painter.source = source;
    } catch (error) {
      const reason = error instanceof Error ? error.message : error;
      if (this.#pictures === number) this.showMessage(`The picture could not be shown: ${reason}`);
    }
    this.#forgetFolds();
    this.guard(() => this.layout());
  }

  /** What was found of folds is no longer so: another picture has its tissue elsewhere. */
  #forgetFolds() {
    this.folds = null;
    this.overlay.drawn = null;
    this.invalidate();
  }

  get isWorkedIn() {
    return isWorkedIn(this.root);
  }

  /** What is known of the slices, one of which is seen; null for another projection. */
  get slices() {
    const { count = 0, first = 0, spacing = 1 } = this.model.get("slices") ?? {};
    return count > 0 ? { count, first, spacing, index: Number(this.model.get("slice")) || 0 } : null;
  }

  /**
   * Show another slice, which Python makes; false where there are none.
   * @param by so many slices to the back
   */
  moveSlice(by: number) {
    const { slices } = this;
    if (!slices) return false;
    const next = Math.max(0, Math.min(slices.count - 1, slices.index + by));
    if (next !== slices.index && !this.isDragging) {
      this.set("slice", next);
      this.announce(this.statusLine.sliceWords);
    }
    return true;
  }

  /** Show grey values in the colours of the trait. */
  applyColours() {
    const bytes = this.model.get("colours");
    this.painter.colours = colourTable(bytes?.byteLength ? bytesOf(bytes) : null);
    this.invalidate();
  }

  /** Whether grey values are shown in colours. */
  get hasColours() {
    return Boolean(this.model.get("colours")?.byteLength);
  }

  #setShows() {
    this.compare.set(this.model.get("shows") ?? "");
    this.invalidate();
  }

  /** Whether all of the picture is shown as it was. */
  get isOriginal() {
    return this.isComparing || this.isBefore || this.compare.shows === "original";
  }

  /** What is seen of the original in the picture. */
  get original(): Original {
    const { shows, share } = this.compare,
      isAll = this.isOriginal;
    return { share: !isAll && shows === "wipe" ? share : 0, opacity: !isAll && shows === "fade" ? share : 0 };
  }

  /**
   * The map under which a place of the view is seen; null where that is the original.
   * @param at CSS pixels
   */
  fitAt([x]: number[]) {
    return this.isOriginal || x! < this.original.share * this.view.width ? null : this.layered;
  }

  get isWaiting() {
    return Boolean(this.model.get("waiting"));
  }

  get isLocked() {
    return this.isWaiting || Boolean(this.model.get("read_only")) || this.isBefore;
  }

  /** Whether points, a shape or a part are being dragged. */
  get isDragging() {
    return [this.pointTools, this.shapeTools, this.partTools].some(({ drag0 }) => drag0 !== null);
  }

  /** While Python makes another picture, nothing can be edited; a drag under way is as if it had not begun. */
  showWaiting() {
    const { isWaiting } = this;
    if (isWaiting) {
      this.gestures.cancel();
      this.endNaming(false);
      this.setAdding(false);
      this.pen.stop();
      this.brush.stop();
    }
    this.stage.classList.toggle("dnb-ed-waiting", isWaiting);
    this.stage.setAttribute("aria-busy", String(isWaiting));
    setText(this.wait, this.model.get("waiting") || "");
    this.invalidate();
  }

  /** The picture's box, [a0, a1, b0, b1]. */
  get box(): Vector4 {
    const {
      shape: [nv, nu],
      spacing: [du, dv],
      origin: [a, b],
    } = this.model.get("raster");
    return [a - du / 2, a + (nu - 0.5) * du, b - dv / 2, b + (nv - 0.5) * dv];
  }

  /** The box of all that is drawn: the picture's, and what the result's holds beyond it. */
  get sheet(): Vector4 {
    const { box } = this,
      beyond = this.model.get("beyond") ?? [];
    return mapVector(box, (x, n) => (beyond.length === 4 ? (n % 2 ? Math.max : Math.min)(x, beyond[n]) : x));
  }

  // ---- the view -----------------------------------------------------------------------------------------------------

  layout() {
    this.applyTheme(); // a style sheet that comes late changes sizes as well
    const [a0, a1, b0, b1] = this.sheet,
      aspect = (b1 - b0) / (a1 - a0),
      most = Math.max(120, this.model.get("height"));
    const isFilling = Boolean(this.model.get("fill"));
    this.root.classList.toggle("dnb-ed-fill", isFilling); // its height is that of the box around it
    const width = Math.max(120, this.stage.clientWidth || UNKNOWN_WIDTH),
      label = this.model.get("label") || "Picture";
    const whole = (width - 2 * MARGIN) * aspect + 2 * MARGIN;
    const own = Math.round(Math.max(120, Math.min(most, whole)));
    this.stage.style.height = isFilling ? "" : `${own}px`;
    const height = isFilling ? Math.max(120, this.stage.clientHeight) : own;
    this.stage.classList.toggle("dnb-ed-filling", isFilling);
    this.root.setAttribute("aria-label", `Editor of ${label}`);
    this.stage.setAttribute(
      "aria-label",
      `${label} with control points. Tab leads to ` +
        "them, Ctrl and arrows from one to the next, arrows move, Enter adds, question mark lists the keys.",
    );
    const ratio = Math.min(2, Math.max(1, window.devicePixelRatio || 1)),
      v = this.view;
    const [dx, dy] = [(width - v.width) / 2, (height - v.height) / 2];
    Object.assign(v, { width, height, ratio });
    const isResized = this.painter.resize(width, height, ratio);
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    if (this.isFitted) this.fitView();
    else Object.assign(v, { x: v.x + dx, y: v.y + dy });
    if (isResized)
      this.drawNow(); // at once: the canvas is empty
    else this.invalidate(); // a remark of two lines comes and goes while a point is dragged
  }

  /**
   * The place of the picture at a place of the view.
   * @param at CSS pixels
   */
  placeAt([x, y]: Vector2): Vector2 {
    return [(x - this.view.x) / this.view.k, (y - this.view.y) / this.view.k];
  }

  /** The place of the view at a place of the picture. */
  onView([a, b]: Vector2): Vector2 {
    return [this.view.k * a + this.view.x, this.view.k * b + this.view.y];
  }

  get #fittedScale() {
    const [a0, a1, b0, b1] = this.sheet,
      { width, height } = this.view;
    return Math.min((width - 2 * MARGIN) / (a1 - a0), (height - 2 * MARGIN) / (b1 - b0));
  }

  fitView() {
    const [a0, a1, b0, b1] = this.sheet,
      { width, height } = this.view,
      k = this.#fittedScale;
    Object.assign(this.view, { k, x: width / 2 - (k * (a0 + a1)) / 2, y: height / 2 - (k * (b0 + b1)) / 2 });
    this.isFitted = true;
    this.invalidate();
  }

  panBy(dx: number, dy: number) {
    Object.assign(this.view, { x: this.view.x + dx, y: this.view.y + dy });
    this.#keepInView();
    this.moving();
  }

  zoomAt(factor: number, x = this.view.width / 2, y = this.view.height / 2) {
    const v = this.view,
      fitted = this.#fittedScale,
      k = Math.max(fitted / 4, Math.min(fitted * 64, v.k * factor));
    const f = k / v.k;
    Object.assign(v, { k, x: x + f * (v.x - x), y: y + f * (v.y - y) });
    this.#keepInView();
    this.moving();
  }

  /** Show a point in the middle of the view, magnified enough to show what it holds. */
  lookAt(id: number) {
    const p = this.pointOf(id),
      v = this.view,
      k = Math.max(v.k, LOOK_ZOOM * this.#fittedScale);
    if (!p) return;
    Object.assign(v, { k, x: v.width / 2 - k * p.target[0], y: v.height / 2 - k * p.target[1] });
    this.#keepInView();
    this.moving();
    this.stage.scrollIntoView({ block: "nearest" }); // a request from a table below: the picture may be out of sight
    this.handles.blink([id]);
  }

  /** Keep at least a tenth of the picture in the view, or fill a tenth of it. */
  #keepInView() {
    const [a0, a1, b0, b1] = this.sheet,
      v = this.view;
    const least = (length: number, room: number) => LEAST_SEEN * Math.min(v.k * length, room);
    const across = least(a1 - a0, v.width),
      down = least(b1 - b0, v.height);
    v.x = Math.max(across - v.k * a1, Math.min(v.width - across - v.k * a0, v.x));
    v.y = Math.max(down - v.k * b1, Math.min(v.height - down - v.k * b0, v.y));
    this.isFitted = false;
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  /** The points or settings are others. */
  changed(isMoving = false) {
    this.isDirty = true;
    if (isMoving) this.moving();
    else this.invalidate();
  }

  moving() {
    this.isMoving = true;
    clearTimeout(this.restTimer);
    this.restTimer = 0;
    this.invalidate();
  }

  #rest() {
    this.restTimer = 0;
    this.isMoving = false;
    this.isResting = true;
    this.grid = null;
    this.invalidate();
  }

  draw() {
    const { model, view, isMoving, pointTools } = this;
    // From a picture on, not from a movement: a slow machine would draw full pictures in between.
    if (isMoving && !this.restTimer) this.restTimer = setTimeout(() => this.#rest(), REST);
    this.isBefore = this.gridNodes.side === "before";
    if (this.isDirty) this.#refit();
    const fit = this.isOriginal ? null : this.layered,
      { original } = this;
    this.painter.paint(view, fit, { isMoving, paper: this.colours.stage, sheet: this.sheet, original });
    this.painter.drawFrame(view, this.sheet);
    const known = fit ? (this.painter.sampled ?? fit) : null; // at the nodes of the picture while something moves
    const { latest } = this.bus;
    if (latest && latest.layered === fit && latest.phase === "move") latest.sampled = this.painter.sampled;
    if (model.get("show_grid") && model.get("density") > 0) this.#drawGrids(known, original.share);
    this.ghost.draw();
    if (!this.isResting || !this.folds) this.#drawOverlay(fit, known);
    else this.invalidate();
    this.isResting = false;
    this.overlay.canvas.style.clipPath = original.share > 0 ? `inset(0 0 0 ${100 * original.share}%)` : "";
    const reach = this.#reach(),
      radius = model.get("show_radius") ? reach : 0,
      isLost = this.shapeTools.draw();
    this.handles.suspects = new Set(model.get("marked") ?? []);
    this.gridNodes.update(fit);
    const shown = this.gridNodes.shown(this.points),
      marks = (p: Point) => this.shapeTools.markOf(p);
    if (this.handles.update(shown, this.selected, view, radius, reach, marks) || isLost) this.focusStage();
    this.marks.update({
      mirror: pointTools.mirror,
      view,
      points: this.points,
      selected: this.selected,
      brush: this.brush,
      pen: this.pen,
      isLocked: this.isLocked,
      isHolding: pointTools.drag0 !== null,
      isAdding: this.isAdding,
      onView: (place) => this.onView(place),
    });
    this.brush.show();
    this.windowTool.show();
    this.wand.show();
    this.cutBar.show();
    this.colourBar.update();
    this.statusLine.update();
    this.#updateToolbar();
    this.rate.drew(performance.now());
  }

  /**
   * The fit of points, and of shapes, with the settings of now; the last one made if it was of the same. So a drag that
   * a look at folds let pass, and its drop, are fitted once.
   * @throws {RbfError} where there is none
   */
  fitOf(points: Point[], shapes?: Partial<Shapes>): LayeredFit {
    const { made } = this,
      settings = { ...this.settings, ...shapes };
    const names = Object.keys({ ...settings, ...made?.settings }) as (keyof FitSettings)[];
    if (made && names.every((name) => made.settings[name] === settings[name]) && samePoints(made.points, points)) {
      return made.layered;
    }
    const layered = layeredFit(points, { ...settings, previous: this.layered });
    this.made = { points, settings, layered };
    return layered;
  }

  #refit() {
    this.isDirty = false;
    if (this.isBefore) return; // shows no fit
    const { settings } = this;
    try {
      this.layered = this.fitOf(this.points);
      this.error = "";
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      this.error = error.message; // the last good picture stays
    }
    this.grid = this.folds = null; // of these points, looked at once more when they rest
    const layered = this.error ? null : this.layered;
    if (!this.isFollowing) {
      publishPoints(this.bus, {
        origin: this.id,
        points: this.points,
        settings,
        fit: layered?.fit ?? null,
        layered,
        phase: this.isDragging ? "move" : "end",
      });
    }
    this.isFollowing = false;
    this.pointTools.sendMove();
  }

  /** The fit where there are no cuts, for tests and for debugging. */
  get fit() {
    return this.layered?.fit ?? null;
  }

  /** Draw the grid: straight left of a share of the width, deformed right of it. */
  #drawGrids(layered: LayeredFit | null, share: number) {
    const { context: c } = this.painter,
      { width, height } = this.painter.canvas,
      cut = share * width;
    if (cut <= 0) {
      drawGrid(c, this.view, this.#gridOf(layered), this.colours.grid);
      return;
    }
    const straight = deformedGrid(NO_CUTS, this.box, this.model.get("density"), 1, 1);
    for (const { lines, x, wide } of [
      { lines: straight, x: 0, wide: cut },
      { lines: this.#gridOf(layered), x: cut, wide: width - cut },
    ]) {
      c.save();
      c.beginPath();
      c.rect(x, 0, wide, height);
      c.clip();
      drawGrid(c, this.view, lines, this.colours.grid);
      c.restore();
    }
  }

  #gridOf(layered: LayeredFit | null) {
    const cells = this.model.get("density"),
      { isMoving } = this,
      count = layered?.count ?? 0;
    const affordable = Math.floor((isMoving ? 8e4 : 32e4) / (cells * cells * Math.max(1, count)));
    const isBent = (layered?.fits ?? []).some(({ fit }) => !isStill(fit)) || (layered?.regions.length ?? 0) > 0;
    const parts = isBent ? Math.min(isMoving ? 3 : 8, Math.max(isMoving ? 1 : 2, affordable)) : 1;
    const key = [layered, cells, parts, String(this.box)],
      { grid } = this;
    const isSame = grid !== null && key.every((value, k) => value === grid.key[k]);
    const lines = isSame
      ? grid.lines
      : deformedGrid(layered ?? NO_CUTS, this.box, cells, parts, (isMoving ? 0.2 : 0.05) / this.view.k);
    this.grid = { key, lines };
    return lines;
  }

  /** @param known the same, at the nodes of the picture while something moves */
  #drawOverlay(fit: LayeredFit | null, known: LayeredFit | null) {
    const { layered, folds, isMoving } = this;
    const isDue = !folds || (folds.isRough && !isMoving);
    if (layered && isDue) this.folds = this.#measuredFolds(known ?? layered);
    this.overlay.draw(fit, known, this.folds, isMoving);
  }

  /**
   * The folds of the map; only at rest as finely as the status line reports them.
   * @param known at the nodes of the picture while something moves
   */
  #measuredFolds(known: LayeredFit) {
    const { isMoving } = this,
      probes = probesOf(known, isMoving ? 5e4 : 4e5);
    const nodes = known.count > 200 ? 9 : isMoving ? 17 : 33;
    return { ...foldsOf(known, this.box, nodes, probes, this.tissueTest(known)), probes, isRough: isMoving };
  }

  /** A test whether tissue is seen at a place; undefined where the picture does not show it. */
  tissueTest(layered: LayeredFit) {
    const { source } = this.painter,
      air = this.model.get("air");
    return source?.grey && typeof air === "number" ? tissueTest(layered, source, air) : undefined;
  }

  /** The reach of a point in units of the picture; 0 where that is not known. */
  #reach() {
    const fit = this.layered?.fits.map((one) => one.fit).find((one) => one.count > 0);
    if (!fit) return 0;
    const { order } = RBF_KERNELS[fit.kernel]!; // with cuts, every region has its own reach: this is the first one's
    return order >= 2 || fit.kernel === "linear" ? 0 : fit.support; // those kernels have no radius
  }

  #updateToolbar() {
    const { points, selected, model, brush, pointTools, shapeTools, sender } = this,
      tool = this.pen.draft?.tool;
    const isShape = shapeTools.chosenShape !== null && selected.size === 0;
    this.toolbar.hide("wand", !this.wand.isThere);
    const own = points.filter((p) => selected.has(p.id));
    const pressed = Object.entries({
      add: this.isAdding,
      select: this.isSelecting,
      compare: this.isComparing,
      cut: tool === "cut",
      part: tool === "part",
      fixed: tool === "fixed",
      move: brush.tool === "move",
      grow: brush.tool === "grow",
      mirror: pointTools.mirror.on,
      snap: pointTools.snap > 0,
      stop: model.get("stop_at_folds"),
      window: this.windowTool.isOn,
      wand: this.wand.isOn,
      lock: own.length > 0 && own.every((p) => p.locked),
      grid: model.get("show_grid"),
      radius: model.get("show_radius"),
      help: this.help.isOpen,
    });
    this.toolbar.update({
      count: points.length,
      selected: isShape ? 1 : selected.size,
      pointsSelected: selected.size,
      turns: isShape && shapeTools.canTurn,
      past: sender.canStep("undo"),
      future: sender.canStep("redo"),
      steps: model.get("history") ?? {},
      pressed: pressed.filter(([, is]) => is).map(([name]) => name),
      readOnly: this.isLocked,
    });
  }

  /** Show a sentence over the picture, in place of a question about a rigid part. */
  showMessage(message: string, isPassing = false) {
    this.shapeTools.forgetOffer();
    super.showMessage(message, isPassing);
  }

  // ---- points, selection and commands -------------------------------------------------------------------------------

  pointOf(id: number) {
    return this.points.find((p) => p.id === id);
  }

  /** @param isShared whether Python gets the selection */
  select(ids: Iterable<number>, isShared: boolean = true) {
    const known = new Set(this.points.map((p) => p.id)),
      next = new Set([...(ids ?? [])].filter((id) => known.has(id)));
    const isSame = next.size === this.selected.size && [...next].every((id) => this.selected.has(id));
    this.selected = next;
    if (next.size) this.shapeTools.choose(null);
    this.invalidate();
    if (isSame || !isShared) return;
    this.selection.sendSoon([...this.selected]);
  }

  toggleSelected(id: number) {
    this.select(this.selected.has(id) ? [...this.selected].filter((other) => other !== id) : [...this.selected, id]);
  }

  /** The ids of the points in a rectangle of the view. */
  pointsInside({ x, y, width, height }: { x: number; y: number; width: number; height: number }) {
    return this.points
      .filter(({ target }) => {
        const [px, py] = this.onView(target as Vector2);
        return px >= x && py >= y && px - x <= width && py - y <= height;
      })
      .map((p) => p.id);
  }

  /** The selected points, or the one in focus if that is not selected. */
  idsAt(focused: number | null) {
    return focused !== null && !this.selected.has(focused) ? [focused] : [...this.selected];
  }

  run(command: string, focused: number | null) {
    const ids = this.idsAt(focused),
      { shapeTools } = this;
    if (focused === null && this.toolbar.isOff(command)) return;
    if (shapeTools.chosen && focused === null && ids.length === 0 && SHAPE_COMMANDS[command]) {
      if (!this.isLocked) SHAPE_COMMANDS[command](shapeTools);
    } else COMMANDS[command]?.(this, ids);
  }

  stepHistory(way: "undo" | "redo") {
    if (this.isDragging || this.isLocked || !this.sender.step(way)) return;
    this.announce(way === "undo" ? "undone" : "redone");
  }

  // ---- modes: adding, selecting, pen and brush ----------------------------------------------------------------------

  setAdding(isAdding: boolean) {
    if (isAdding) {
      this.putDownTools();
      this.setSelecting(false);
    }
    this.isAdding = isAdding && !this.isLocked;
    this.stage.classList.toggle("dnb-ed-adding", this.isAdding);
    if (this.isAdding) this.hint("Press on a feature and drag it in one go, or click to set a point. Esc when done");
    this.invalidate();
  }

  /**
   * While it is on, whatever is dragged around or clicked is added to what is selected: fingers have no Shift key.
   */
  setSelecting(isSelecting: boolean) {
    if (isSelecting) {
      this.putDownTools();
      this.setAdding(false);
    }
    this.isSelecting = isSelecting;
    this.stage.classList.toggle("dnb-ed-selecting", isSelecting);
    if (isSelecting) this.hint("Drag a band around points, or tap one after the other. Esc when done", 4000);
    this.invalidate();
  }

  /** Put away the pen, the brush, the wand, and the tool of the window. */
  putDownTools() {
    this.pen.stop();
    this.brush.stop();
    this.windowTool.stop();
    this.wand.stop();
  }

  /** False if neither was on. */
  stopModes() {
    const was = this.isAdding || this.isSelecting;
    this.setAdding(false);
    this.setSelecting(false);
    return was;
  }

  /**
   * Take up the pen, or put it away if it is drawing this already.
   * @param tool a name of PEN_WORDS
   */
  setPen(tool: string) {
    const was = this.pen.draft?.tool;
    this.putDownTools();
    if (was === tool || this.isLocked) {
      this.invalidate();
      return;
    }
    this.setAdding(false);
    this.setSelecting(false);
    this.shapeTools.choose(null);
    this.shapeTools.dropOffer();
    this.pen.start(tool);
    this.focusStage();
  }

  /** Take up a brush, or put it away. */
  setBrush(tool: string) {
    const was = this.brush.tool;
    this.putDownTools();
    if (was === tool || this.isLocked) return;
    this.setAdding(false);
    this.setSelecting(false);
    this.shapeTools.choose(null);
    this.select([]);
    this.brush.start(tool);
    this.focusStage();
  }

  // ---- names and help -----------------------------------------------------------------------------------------------

  /** Request a name beside a place of the view. */
  promptName(text: string, placeholder: string, [x, y]: Vector2, naming: Naming) {
    const {
      input,
      view: { width, height },
    } = this;
    this.naming = naming;
    input.hidden = false;
    input.value = text;
    input.placeholder = placeholder;
    input.style.left = `${Math.max(4, Math.min(width - 164, x + 12))}px`;
    input.style.top = `${Math.max(4, Math.min(height - 32, y - 30))}px`;
    input.focus();
    input.select();
  }

  endNaming(isKept: boolean) {
    const { naming, input } = this;
    if (!naming || input.hidden) return;
    const hadFocus = treeOf(this.root).activeElement === input;
    input.hidden = true;
    if (isKept) this.guard(() => naming.take(input.value));
    if (!naming.focus() && hadFocus) this.focusStage(); // the point may be gone meanwhile
  }

  /** The focus goes to the list, and back to where it was. */
  toggleHelp() {
    this.help.toggle();
    this.invalidate();
  }

  closeHelp() {
    if (!this.help.isOpen) return false;
    this.toggleHelp();
    return true;
  }

  focusStage() {
    this.stage.focus({ preventScroll: true });
  }
}

/**
 * Whether the body is seen at a place, there or within two pixels.
 * @param air the value of the picture up to which nothing is seen
 */
function tissueTest(layered: LayeredFit, source: PictureSource, air: number) {
  const {
      spacing: [du, dv],
    } = source.raster,
    steps = [-2, 0, 2];
  return (a: number, b: number) => {
    const [da, db] = placeOf(layered, a, b, du);
    return steps.some((i) => steps.some((j) => source.isBody([a + da + j * du, b + db + i * dv], air)));
  };
}

function render({ model, el }: { model: Model; el: HTMLElement }) {
  const editor = new EditorView(model, el);
  return () => editor.close();
}

export default { initialize, render };
