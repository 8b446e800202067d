// The editor of a picture, which follows its control points.
// Messages to Python: edit and history, by sync/edits.js. Messages from Python: done (sender, seq), error (message),
// draw (tool), parts (parts, kind), look (id).

import type { EditorToFrontEnd, ShowPart } from "../generated.ts";
import { samePoints } from "../maths/points.ts";
import { busOf } from "../sync/bus.ts";
import type { Change } from "../sync/edits.ts";
import type { LayeredFit, Model, PicturePoint, PointsDetail, Vector2 } from "../types.ts";
import { beforeActionOutside } from "../ui/dom.ts";
import { HelpPanel } from "../ui/keys.ts";
import { Toolbar } from "../ui/toolbar.ts";
import { EditorDrawing, initialize } from "./base.ts";
import { BendTools } from "./bend_tools.ts";
import { BoxWarning } from "./box_warning.ts";
import { Brush } from "./brush_tool.ts";
import { Clicks } from "./clicks.ts";
import { ColourBar } from "./colour_bar.ts";
import { Commands } from "./commands.ts";
import { CutBar } from "./cut_bar.ts";
import { EditedMap } from "./edited_map.ts";
import { EditedPoints } from "./edited_points.ts";
import { EditorKeys } from "./editor_keys.ts";
import { FoldOffers } from "./fold_offers.ts";
import { FoldStop } from "./fold_stop.ts";
import { GridLayer } from "./grid_layer.ts";
import { GridNodes } from "./grid_nodes.ts";
import { Handles, ToolMarks } from "./handles.ts";
import { HitTest } from "./hit_test.ts";
import { MarkGrips } from "./mark_grips.ts";
import { Modes } from "./modes.ts";
import { NamePrompt } from "./name_prompt.ts";
import { OtherWindows } from "./others.ts";
import { GHOST_TRAITS, Ghost, OVERLAY_TRAITS, Overlay } from "./overlays.ts";
import { PartTools } from "./part_tools.ts";
import type { Parts } from "./parts.ts";
import { PointDrag } from "./point_drag.ts";
import { PointKeys } from "./point_keys.ts";
import { PointStrokes } from "./point_strokes.ts";
import { PointTools } from "./point_tools.ts";
import { PointTurns } from "./point_turns.ts";
import { Gestures } from "./pointer.ts";
import { Presses } from "./presses.ts";
import { ShapeKeys } from "./shape_keys.ts";
import { Pen, ShapeTools } from "./shape_tools.ts";
import { ShownPicture } from "./shown_picture.ts";
import { Stage } from "./stage.ts";
import { StatusLine } from "./status_line.ts";
import { offerTools, pictureViewTools } from "./view_tools.ts";
import { MARGIN, Viewport } from "./viewport.ts";
import { Wand } from "./wand_tool.ts";
import { Wheel } from "./wheel.ts";
import { WindowTool } from "./window_tool.ts";

/** Other traits that the drawing depends on. */
const SHOWN = [
  "density",
  "show_grid",
  "grid_waits",
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

const UNKNOWN_WIDTH = 420; // CSS pixels, until the layout of the host page

/** The front end of one view of an editor. */
export class EditorView extends EditorDrawing {
  commands: Commands;
  stage: Stage;
  readonly parts: Parts;

  constructor(model: Model, el: HTMLElement) {
    super(model);
    const { sender, messages, frames, theme, root } = this,
      bus = busOf(model);
    bus.views = (bus.views ?? 0) + 1;
    sender.receive();
    // Parts refer to one another, and read each other only once all exist.
    const parts = { model, bus, sender, messages, frames, theme, tools: {}, layers: {}, panels: {} } as Parts;
    const { tools, layers, panels } = parts;
    this.parts = parts;
    this.commands = parts.commands = new Commands(parts);
    panels.toolbar = new Toolbar(this.host, root);
    this.stage = parts.stage = new Stage(el, root);
    parts.viewport = new Viewport(
      frames,
      () => parts.picture.sheet,
      MARGIN,
      () => parts.picture.framed,
    );
    panels.names = new NamePrompt(parts);
    panels.help = new HelpPanel(this.stage.element, root, () => this.stage.focus());
    parts.picture = new ShownPicture(parts);
    parts.points = new EditedPoints(parts);
    parts.map = new EditedMap(parts);
    tools.modes = new Modes(parts);
    layers.grid = new GridLayer(parts);
    layers.ghost = new Ghost(parts);
    layers.overlay = new Overlay(parts);
    tools.shapes = new ShapeTools(parts); // whose shapes are drawn under the points
    tools.parts = new PartTools(parts);
    tools.foldStop = new FoldStop(parts);
    tools.foldOffers = new FoldOffers(parts);
    layers.handles = new Handles(this.stage.svg, (id) => parts.points.numberOf(id));
    tools.drag = new PointDrag(parts);
    tools.points = new PointTools(parts);
    tools.turns = new PointTurns(parts);
    tools.strokes = new PointStrokes(parts);
    tools.bends = new BendTools(parts);
    tools.pen = new Pen(parts);
    tools.brush = new Brush<Vector2>(tools.strokes);
    tools.window = new WindowTool(parts);
    tools.wand = new Wand(parts);
    panels.cut = new CutBar(parts);
    panels.colours = new ColourBar(parts);
    layers.marks = new ToolMarks(this.stage.svg, layers.handles.points);
    tools.hits = new HitTest(parts);
    tools.grips = new MarkGrips(parts);
    tools.clicks = new Clicks(parts);
    tools.presses = new Presses(parts);
    tools.gestures = new Gestures(parts);
    tools.wheel = new Wheel(parts);
    tools.shapeKeys = new ShapeKeys(parts);
    tools.pointKeys = new PointKeys(parts);
    tools.keys = new EditorKeys(parts);
    frames.listen(root, "keydown", (event) => tools.keys.press(event), { signal: this.stage.closing.signal });
    layers.nodes = new GridNodes(parts);
    tools.others = new OtherWindows(parts);
    panels.status = new StatusLine(parts);
    panels.box = new BoxWarning(parts);
    offerTools(bus, pictureViewTools(parts), this.stage.closing.signal);
    root.append(messages.liveRegion);
    Object.assign(root, { deformnb: this }); // for tests and for debugging
    this.#followModel();
    this.#followPage();
    frames.guard(() => tools.shapes.choice.receive());
    frames.guard(() => {
      parts.picture.applyColours();
      parts.picture.applyShows();
    });
    frames.guard(() => this.showWaiting());
    frames.guard(() => this.layout());
    this.loadPicture();
    parts.picture.loadDeformed();
  }

  #followModel() {
    const { bus, frames, map, messages, model, picture, points, sender, stage, tools } = this.parts,
      { signal } = stage.closing;
    const on = (name: string, handler: (message: EditorToFrontEnd) => void) => {
      const guarded = (message: EditorToFrontEnd) => frames.guard(() => handler(message));
      model.on(name, guarded);
      signal.addEventListener("abort", () => model.off(name, guarded));
    };
    on("change:selected", () => {
      if (!points.selection.isAhead) points.select(model.get("selected"), false);
    });
    on("change:chosen_shape", () => tools.shapes.choice.receive());
    for (const name of ["image", "raster"]) on(`change:${name}`, () => this.loadPicture());
    for (const name of ["deformed", "deformed_image"]) on(`change:${name}`, () => picture.loadDeformed());
    for (const name of ["beyond", "subject", "height", "label"]) on(`change:${name}`, () => this.layout());
    on("change:theme", () => this.theme.apply());
    on("change:waiting", () => this.showWaiting());
    for (const name of ["settings", "lone_support", "cut_rule"]) on(`change:${name}`, () => map.invalidate());
    for (const name of ["settings", "stop_at_folds"]) on(`change:${name}`, () => tools.foldStop.leave());
    for (const name of ["air", "tissue"]) on(`change:${name}`, () => this.#forgetFolds());
    for (const name of ["cut_off", "enlarges"]) on(`change:${name}`, () => this.parts.panels.box.receive());
    on("change:outline", () => frames.invalidate());
    on("change:window", () => tools.window.apply());
    on("change:colours", () => picture.applyColours());
    on("change:shows", () => picture.applyShows());
    for (const name of SHOWN) on(`change:${name}`, () => frames.invalidate());
    on("msg:custom", (message) => this.message(message));
    const news = {
      points: () => {
        this.receive();
        tools.foldStop.follow();
      },
      status: () => messages.showStatus(sender),
      history: () => {
        tools.shapes.choice.receive();
        frames.invalidate();
      },
    };
    const ignore = sender.listen((what: Change) => frames.guard(news[what]));
    const moved = (event: CustomEvent<PointsDetail>) => frames.guard(() => this.#receiveMove(event.detail));
    bus.addEventListener("deformnb:points", moved);
    signal.addEventListener("abort", () => {
      ignore();
      bus.removeEventListener("deformnb:points", moved);
    });
    sender.channel.greet();
  }

  #followPage() {
    const { frames, points, stage, tools } = this.parts,
      { root } = this,
      { signal } = stage.closing;
    const flush = () => {
      points.selection.flush();
      tools.window.trait.flush();
    };
    beforeActionOutside(root, flush, signal);
    for (const name of ["pointerenter", "pointerleave", "focus", "blur"] as const)
      frames.listen(stage.element, name, () => this.#showFaintGrid(), { signal });
    const sizes = new ResizeObserver(() => frames.guard(() => this.layout()));
    sizes.observe(root);
    signal.addEventListener("abort", () => sizes.disconnect());
  }

  #showFaintGrid() {
    if (this.parts.layers.grid.isWaiting) this.frames.invalidate();
  }

  close() {
    const { bus, frames, layers, messages, points, sender, stage, theme, tools } = this.parts;
    layers.ghost.close();
    sender.flush();
    for (const part of [points.selection, tools.window, tools.wand]) part.close();
    bus.views = (bus.views ?? 1) - 1;
    if (bus.views === 0) bus.latest = null; // nothing fits any more: followers take the traits
    for (const part of [stage, theme, frames, messages]) part.close();
  }

  // ---- the model ----------------------------------------------------------------------------------------------------

  /** Take the points of this window, wherever they came from, unless the user is moving some. */
  receive() {
    const { map, points, sender, tools } = this.parts;
    if (points.isDragging) return;
    if (samePoints(sender.points, points.list) && sender.shapes === points.shapes) return;
    points.list = sender.points;
    tools.shapes.follow(sender.shapes);
    points.select([...points.selected]);
    tools.shapes.choice.receive();
    map.invalidate();
  }

  #receiveMove({ origin, points: list, phase, settings }: PointsDetail) {
    const { map, points } = this.parts;
    if (origin === map.origin || points.isDragging) return;
    if (phase !== "move") {
      this.receive();
      return;
    }
    map.isFollowing = true; // only the view in which the user drags publishes points
    points.list = list as PicturePoint[];
    points.shapes = { cuts: settings.cuts ?? [], parts: settings.parts ?? [] };
    map.invalidate(true);
  }

  message(message: EditorToFrontEnd) {
    const { messages, points, tools } = this.parts;
    if (message.type === "error") messages.show(message.message, true);
    if (message.type === "draw" && tools.pen.draft?.tool !== message.tool) tools.modes.setPen(message.tool);
    if (message.type === "parts" && !points.isDragging) tools.parts.propose(message.parts, message.kind);
    if (message.type === "look") this.lookAt(message.id);
    if (message.type === "see") this.#see(message);
  }

  loadPicture() {
    return this.parts.picture.load(() => {
      this.#forgetFolds();
      this.frames.guard(() => this.layout());
    });
  }

  /** Invalidate the folds found so far: another picture has its tissue elsewhere. */
  #forgetFolds() {
    const { frames, layers, map } = this.parts;
    map.folds = null;
    layers.overlay.drawn = null;
    frames.invalidate();
  }

  /** While Python makes another picture, disable editing; a drag under way is cancelled. */
  showWaiting() {
    const { frames, model, panels, points, stage, tools } = this.parts;
    if (points.isWaiting) {
      tools.gestures.cancel();
      panels.names.end(false);
      tools.modes.setAdding(false);
      tools.pen.stop();
      tools.brush.stop();
    }
    stage.showWaiting(model.get("waiting") || "");
    frames.invalidate();
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  layout() {
    const { frames, model, picture, stage, theme, viewport } = this.parts,
      { root } = this;
    theme.apply(); // a style sheet that loads late changes sizes as well
    const [a0, a1, b0, b1] = picture.sheet,
      aspect = (b1 - b0) / (a1 - a0),
      most = Math.max(120, model.get("height"));
    const isFilling = Boolean(model.get("fill"));
    root.classList.toggle("dnb-ed-fill", isFilling); // its height is that of the box around it
    const width = Math.max(120, stage.element.clientWidth || UNKNOWN_WIDTH),
      label = model.get("label") || "Picture";
    const whole = (width - 2 * MARGIN) * aspect + 2 * MARGIN;
    const own = Math.round(Math.max(120, Math.min(most, whole)));
    stage.element.style.height = isFilling ? "" : `${own}px`;
    const height = isFilling ? Math.max(120, stage.element.clientHeight) : own;
    stage.element.classList.toggle("dnb-ed-filling", isFilling);
    root.setAttribute("aria-label", `Editor of ${label}`);
    stage.element.setAttribute(
      "aria-label",
      `${label} with control points. Tab leads to ` +
        "them, Ctrl and arrows from one to the next, arrows move, Enter adds, question mark lists the keys.",
    );
    const ratio = Math.min(2, Math.max(1, window.devicePixelRatio || 1));
    const isResized = picture.painter.resize(width, height, ratio);
    stage.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    viewport.resize(width, height, ratio);
    if (isResized)
      frames.drawNow(); // immediately: the canvas is empty
    else frames.invalidate(); // a remark of two lines may appear and vanish during a drag
  }

  /** Show a part of the picture, or all of it. */
  #see({ middle, scale }: ShowPart) {
    const { viewport } = this.parts;
    if (middle) viewport.see(middle as Vector2, scale ?? 1);
    else viewport.fit();
  }

  /** Show a point in the middle of the view. */
  lookAt(id: number) {
    const { layers, points, stage, viewport } = this.parts,
      p = points.withId(id);
    if (!p) return;
    viewport.lookAt(p.target);
    stage.element.scrollIntoView({ block: "nearest" }); // a request from a table below: it may be out of sight
    layers.handles.blink([id]);
  }

  draw() {
    const { bus, frames, layers, map, panels, picture, points, theme, tools, viewport } = this.parts,
      { view } = viewport;
    frames.restSoon(() => {
      layers.grid.last = null;
    });
    const { isMoving } = frames;
    picture.isBefore = layers.nodes.side === "before";
    if (map.isDirty) this.#refit();
    const fit = picture.isOriginal ? null : map.layered,
      { original, painter, sheet } = picture;
    const deformed = fit ? picture.deformedBy(points.list, points.shapes) : null;
    painter.paint(view, fit, { isMoving, paper: theme.colours.stage, sheet, original, deformed });
    painter.drawFrame(view, sheet);
    const known = fit ? (painter.sampled ?? fit) : null; // at the nodes of the picture while something moves
    const { latest } = bus;
    if (latest && latest.layered === fit && latest.phase === "move") latest.sampled = painter.sampled;
    if (layers.grid.isOn) {
      painter.context.globalAlpha = layers.grid.opacity;
      layers.grid.draw(known, original.share);
      painter.context.globalAlpha = 1;
    }
    layers.ghost.draw();
    if (!frames.isResting || !map.folds) {
      map.findFolds(known);
      layers.overlay.draw(fit, known, map.folds, isMoving);
    } else frames.invalidate();
    frames.isResting = false;
    layers.overlay.canvas.style.clipPath = original.share > 0 ? `inset(0 0 0 ${100 * original.share}%)` : "";
    this.#drawHandles(fit);
    for (const part of [tools.brush, tools.window, tools.wand, tools.foldOffers, panels.cut]) part.show();
    panels.colours.update();
    panels.status.update();
    panels.box.update();
    this.#updateToolbar();
    frames.rate.recordFrame(performance.now());
  }

  #refit() {
    const { map, picture, tools } = this.parts;
    if (picture.isBefore) {
      map.isDirty = false; // it shows no fit
      return;
    }
    map.refit();
    tools.drag.sendMove();
    tools.parts.sendMove();
  }

  /** Draw shapes, nodes, points and the marks of tools. */
  #drawHandles(fit: LayeredFit | null) {
    const { layers, map, model, points, stage, tools, viewport } = this.parts,
      { reach } = map;
    const radius = model.get("show_radius") ? reach : 0,
      lost = [tools.shapes, tools.parts].filter((tool) => tool.draw());
    layers.handles.suspects = new Set(model.get("marked") ?? []);
    layers.nodes.update(fit);
    const shown = layers.nodes.magnify(points.list),
      marks = (p: PicturePoint) => tools.shapes.markOf(p);
    if (layers.handles.update(shown, points.selected, viewport.view, radius, reach, marks) || lost.length)
      stage.focus();
    tools.others.place();
    layers.marks.update({
      mirror: tools.points.mirror.state,
      view: viewport.view,
      points: points.list,
      selected: points.selected,
      brush: tools.brush,
      pen: tools.pen,
      isLocked: points.isLocked,
      isHolding: tools.drag.drag0 !== null,
      isAdding: tools.modes.isAdding,
      toView: (place) => viewport.toView(place),
    });
  }

  #updateToolbar() {
    const { layers, model, panels, picture, points, sender, tools } = this.parts,
      { choice } = tools.shapes,
      { list, selected } = points,
      tool = tools.pen.draft?.tool;
    const isShape = choice.shape !== null && selected.size === 0;
    panels.toolbar.hide("wand", !tools.wand.isThere);
    const own = list.filter((p) => selected.has(p.id));
    const pressed = Object.entries({
      add: tools.modes.isAdding,
      select: tools.modes.isSelecting,
      compare: picture.isComparing,
      cut: tool === "cut",
      part: tool === "part",
      fixed: tool === "fixed",
      straighten: tool === "straighten",
      hinge: tool === "hinge",
      move: tools.brush.tool === "move",
      grow: tools.brush.tool === "grow",
      mirror: tools.points.mirror.state.on,
      snap: tools.points.snap.step > 0,
      stop: model.get("stop_at_folds"),
      window: tools.window.isOn,
      wand: tools.wand.isOn,
      lock: own.length > 0 && own.every((p) => p.locked),
      grid: model.get("show_grid") && !layers.grid.isWaiting,
      radius: model.get("show_radius"),
      help: panels.help.isOpen,
    });
    panels.toolbar.update({
      count: list.length,
      selected: isShape ? 1 : selected.size,
      pointsSelected: selected.size,
      turns: isShape && choice.canTurn,
      past: sender.canStep("undo"),
      future: sender.canStep("redo"),
      steps: model.get("history") ?? {},
      pressed: pressed.filter(([, is]) => is).map(([name]) => name),
      readOnly: points.isLocked,
    });
  }
}

function render({ model, el }: { model: Model; el: HTMLElement }) {
  const editor = new EditorView(model, el);
  return () => editor.close();
}

export default { initialize, render };
