// The editor in space: three linked pictures of a volume with the same points.
// To Python: edit and history, by sync/edits.js; hello, look (view state), seen. From Python: pictures, error, done.

import { EditorDrawing, initialize } from "../editor/base.ts";
import { Brush } from "../editor/brush_tool.ts";
import { EditedPoints } from "../editor/edited_points.ts";
import { NamePrompt } from "../editor/name_prompt.ts";
import { OVERLAYS } from "../editor/overlays.ts";
import { offerTools } from "../editor/view_tools.ts";
import type { Pictures, SlicesMoved, SpaceEditorToFrontEnd } from "../generated.ts";
import { SampledDets } from "../maths/sampled_dets.ts";
import { bytesOf, joinFragments } from "../sync/buffers.ts";
import { busOf } from "../sync/bus.ts";
import { type Change, setTrait } from "../sync/edits.ts";
import type { Model, ModelHandler, PointsDetail } from "../types.ts";
import { beforeActionOutside, OWN_KEYS, pageElement } from "../ui/dom.ts";
import { HelpPanel, SPACE_EDITOR_KEYS, tipOf } from "../ui/keys.ts";
import type { ToolEntry } from "../ui/toolbar.ts";
import { Toolbar } from "../ui/toolbar.ts";
import type { Bytes } from "../view/types.ts";
import { SpaceCommands } from "./commands.ts";
import { SliceCursor } from "./cursor.ts";
import { SpaceEdits } from "./edits.ts";
import { SpaceFoldOffers } from "./fold_offers.ts";
import { SpaceFoldStop } from "./fold_stop.ts";
import { spaceKey } from "./keys.ts";
import { SpaceModes } from "./modes.ts";
import { SpacePane } from "./pane.ts";
import { PaneRow } from "./pane_row.ts";
import type { SpaceParts } from "./parts.ts";
import { SpacePointTools } from "./point_tools.ts";
import { PaneGestures } from "./pointer.ts";
import { PictureRequests } from "./requests.ts";
import { SpaceShapes } from "./shapes.ts";
import { SpaceMap } from "./space_map.ts";
import { SpaceStatus } from "./status_line.ts";
import { SpaceStrokes } from "./strokes.ts";
import { spaceViewTools } from "./view_tools.ts";

const SPACE_PROJECTIONS: Record<string, string> = {
  slice: "Slices",
  mip: "Maximum (MIP)",
  composite: "Composite",
  shaded: "Shaded",
};

const SPACE_OVERLAYS = ["none", "folds"]; // of those on a picture

const SPACE_GROUPS: ToolEntry[][] = [
  [
    ["add", "Add", "Add points: click where", true],
    ["select", "Select", "Select several points: drag a band, or tap them", true],
    ["remove", "Delete", "Delete the selected points, or the chosen part", false, "selection"],
    ["rename", "Rename", "Name the selected point or part", false, "one"],
    ["switch", "On/off", "Switch the selected points or part on or off", false, "selection"],
    ["lock", "Lock", "Lock the selected points, or free them", true, "points_selected"],
    ["reset", "Put back", "Put the selected points, or all, back where they were taken", false, "points"],
  ],
  [
    ["move", "Move", "Move brush: drag what lies in its ball", true],
    ["grow", "Grow", "Grow brush: drag right to grow what lies in its ball, left to shrink it", true],
  ],
  [["part", "Rigid", "Draw a part that stays rigid: drag it open in one slice, fit it in the others", true]],
  [
    ["undo", "Undo", "Undo", false, "past"],
    ["redo", "Redo", "Redo", false, "future"],
  ],
  [["stop", "Safe drag", "Stop drags before tissue folds", true]],
  [
    ["go", "Go to", "Move the slices to the selected point", false, "one"],
    ["grid", "Grid", "Show the deformed grid", true],
    ["compare", "Before", "Show the volume as it was", true],
  ],
  [
    ["zoom-out", "", "Zoom out"],
    ["zoom-in", "", "Zoom in"],
    ["fit", "Fit", "Show the whole pictures"],
  ],
  [
    ["more", "More", "More tools", false],
    ["help", "Keys", "Keys and gestures", true],
  ],
];

const SPACE_MORE: ToolEntry[][] = [
  [
    ["mirror", "Mirror", "Do the same on both sides of a plane", true],
    ["mirror-axis", "Mirror in another direction", "Put the plane of the mirror across the next axis", false],
    ["snap", "Snap to a lattice", "Targets keep to the nodes of a lattice", true],
  ],
  [
    [
      "turn-left",
      "Turn left by 15\u00b0",
      "Turn the selected points to the left in the picture",
      false,
      "points_selected",
    ],
    [
      "turn-right",
      "Turn right by 15\u00b0",
      "Turn the selected points to the right in the picture",
      false,
      "points_selected",
    ],
  ],
];

export class SpaceEditorView extends EditorDrawing {
  commands: SpaceCommands;
  parts: SpaceParts;
  stage: PaneRow;
  chooser: HTMLSelectElement;
  overlays: HTMLSelectElement;

  #ends: (() => void)[] = []; // of listening

  constructor(model: Model, el: HTMLElement) {
    super(model);
    const { frames, messages, root, sender, theme } = this;
    sender.receive();
    root.classList.add("dnb-space");
    // Parts refer to one another, and read each other only once all exist.
    const parts = { model, sender, messages, frames, theme } as SpaceParts;
    this.parts = parts;
    this.commands = parts.commands = new SpaceCommands(parts);
    parts.toolbar = new Toolbar(this.host, root, SPACE_GROUPS, SPACE_EDITOR_KEYS, SPACE_MORE);
    this.chooser = this.#makeChooser(parts.toolbar.root);
    this.overlays = this.#makeOverlays(parts.toolbar);
    this.stage = parts.row = new PaneRow(el, root, (index) => {
      setTrait(model, "large_slice", model.get("large_slice") === index ? -1 : index);
    });
    parts.points = new EditedPoints(parts);
    parts.map = new SpaceMap(parts);
    parts.foldStop = new SpaceFoldStop(parts);
    parts.edits = new SpaceEdits(parts);
    parts.requests = new PictureRequests(model, parts.edits.id, () => frames.guard(() => this.showWaiting()));
    parts.cursor = new SliceCursor(parts);
    parts.tools = new SpacePointTools(parts);
    parts.strokes = new SpaceStrokes(parts);
    parts.modes = new SpaceModes(parts);
    for (const k of parts.cursor.panes.keys()) {
      const pane = new SpacePane(parts, k);
      parts.row.panes.push(pane);
      parts.row.gestures.push(new PaneGestures(parts, pane));
    }
    parts.row.element.append(parts.row.veil);
    parts.brush = new Brush(parts.strokes);
    parts.shapes = new SpaceShapes(parts); // whose bar is over the pictures
    parts.foldOffers = new SpaceFoldOffers(parts);
    parts.names = new NamePrompt({ frames, stage: parts.row });
    parts.help = new HelpPanel(
      parts.row.element,
      root,
      () => parts.row.panes[0]!.stage.focus({ preventScroll: true }),
      SPACE_EDITOR_KEYS,
    );
    parts.status = new SpaceStatus(parts, root);
    offerTools(busOf(model), spaceViewTools(parts), parts.row.closing.signal);
    root.append(messages.liveRegion);
    Object.assign(root, { deformnb: this }); // for tests and debugging
    this.#followModel();
    this.#followPage();
    frames.guard(() => {
      this.layout();
      this.showWaiting();
    });
    parts.requests.begin();
  }

  #makeChooser(bar: HTMLElement) {
    const group = pageElement("div", "dnb-ed-group", null);
    bar.insertBefore(group, bar.children[2]!);
    const chooser = pageElement("select", "dnb-sp-select", group, {
      "aria-label": "What the pictures show",
      title: "What the pictures show",
      ...OWN_KEYS,
    });
    for (const [name, title] of Object.entries(SPACE_PROJECTIONS)) {
      pageElement("option", "", chooser, { value: name }, title);
    }
    return chooser;
  }

  #makeOverlays({ buttons }: Toolbar) {
    const { frames, model } = this,
      group = buttons.get("compare")?.button.parentElement ?? null,
      label = tipOf(SPACE_EDITOR_KEYS, "overlay", "Overlay");
    const menu = pageElement("select", "dnb-ed-menu", group, { "aria-label": label, title: label, ...OWN_KEYS });
    for (const value of SPACE_OVERLAYS) {
      const [words, title] = OVERLAYS[value]!;
      pageElement("option", "", menu, { value, title: title! }, words!);
    }
    menu.addEventListener("change", () => frames.guard(() => setTrait(model, "overlay", menu.value)));
    return menu;
  }

  #followModel() {
    const { frames, messages, model, sender } = this,
      { cursor, edits, foldStop, points, shapes } = this.parts,
      bus = busOf(model);
    const on = (name: string, handler: ModelHandler) => {
      const guarded: ModelHandler = (...given) => frames.guard(() => handler(...given));
      model.on(name, guarded);
      this.#ends.push(() => model.off(name, guarded));
    };
    on(
      "msg:custom",
      joinFragments((message, buffers) => this.message(message, buffers)),
    );
    on("change:selected", () => {
      if (!points.selection.isAhead) points.select(model.get("selected"), false);
    });
    on("change:chosen_shape", () => shapes.choice.receive());
    on("change:cursor", () => cursor.receive());
    on("change:panes", () => this.receivePanes());
    on("change:theme", () => this.theme.apply());
    on("change:waiting", () => this.showWaiting());
    for (const name of ["height", "fill", "large_slice"]) on(`change:${name}`, () => this.layout());
    for (const name of [
      "label",
      "projection",
      "shows_original",
      "read_only",
      "history",
      "mirror",
      "snap",
      "stop_at_folds",
      "brush_radius",
      "settings",
      "tissue",
      "overlay",
      "show_grid",
      "density",
    ]) {
      on(`change:${name}`, () => frames.invalidate());
    }
    for (const name of ["settings", "stop_at_folds"]) on(`change:${name}`, () => foldStop.leave());
    const moved = (event: CustomEvent<PointsDetail>) => frames.guard(() => edits.receiveMove(event.detail));
    bus.addEventListener("deformnb:points", moved);
    this.#ends.push(() => bus.removeEventListener("deformnb:points", moved));
    sender.channel.greet();
    const news = {
      points: () => {
        edits.receive();
        foldStop.follow();
      },
      status: () => messages.showStatus(sender),
      history: () => {
        shapes.choice.receive();
        frames.invalidate();
      },
    };
    this.#ends.push(sender.listen((what: Change) => frames.guard(news[what])));
  }

  #followPage() {
    const { chooser, frames, parts, root } = this,
      { cursor, modes, points, requests, row } = parts,
      { signal } = row.closing,
      options = { signal };
    const choose = () => requests.look({ projection: chooser.value as SlicesMoved["projection"] });
    frames.listen(chooser, "change", choose, options);
    frames.listen(
      root,
      "keydown",
      (event) => {
        if (!spaceKey(parts, event)) return;
        event.preventDefault();
        event.stopPropagation();
      },
      options,
    );
    frames.listen(
      root,
      "keyup",
      (event) => {
        if (event.key === " ") modes.isSpaceDown = false;
        if (/^(Arrow|Page)/.test(event.key)) cursor.rest();
      },
      options,
    );
    frames.listen(
      root,
      "focusout",
      ({ relatedTarget }) => {
        if (!(relatedTarget instanceof Node && root.contains(relatedTarget))) modes.isSpaceDown = false;
      },
      options,
    );
    beforeActionOutside(root, () => points.selection.flush(), signal);
    const sizes = new ResizeObserver(() => frames.guard(() => this.layout()));
    sizes.observe(root);
    signal.addEventListener("abort", () => sizes.disconnect());
  }

  close() {
    const { frames, messages, theme } = this,
      { points, requests, row } = this.parts;
    this.sender.flush();
    for (const end of this.#ends) end();
    for (const part of [points.selection, requests, row, theme, messages, frames]) part.close();
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  layout() {
    const { model, root } = this,
      { edits, row } = this.parts,
      isFilling = Boolean(model.get("fill"));
    this.theme.apply(); // a style sheet that loads late changes sizes as well
    root.setAttribute("aria-label", `Editor in space of ${model.get("label") || "Volume"}`);
    root.classList.toggle("dnb-sp-viewer", edits.isViewer);
    root.classList.toggle("dnb-ed-fill", isFilling); // its height is that of the box around it
    row.layout(model.get("height"), isFilling, model.get("large_slice") ?? -1);
    this.frames.drawNow();
  }

  draw() {
    const { edits, row, status } = this.parts;
    if (row.panes.map((pane) => pane.draw()).some(Boolean)) row.focus(); // no shortcut: all are drawn
    status.update();
    for (const part of [this.parts.brush, this.parts.foldOffers, this.parts.shapes.pen]) part.show();
    this.frames.restSoon(() => {});
    if (!edits.isViewer) this.#updateToolbar();
  }

  #updateToolbar() {
    const { model, sender } = this,
      { brush, help, modes, points, shapes, toolbar, tools } = this.parts,
      { list, selected } = points;
    this.chooser.value = model.get("projection");
    this.overlays.value = model.get("overlay");
    const pressed = Object.entries({
      add: modes.isAdding,
      select: modes.isSelecting,
      move: brush.tool === "move",
      grow: brush.tool === "grow",
      part: shapes.pen.isOn,
      mirror: tools.mirror.on,
      snap: tools.lattice.step > 0,
      stop: model.get("stop_at_folds"),
      grid: model.get("show_grid"),
      compare: model.get("shows_original"),
      help: help.isOpen,
      lock: selected.size > 0 && list.every((p) => p.locked || !selected.has(p.id)),
    });
    toolbar.update({
      count: list.length,
      selected: selected.size || Number(shapes.choice.shape !== null),
      pointsSelected: selected.size,
      past: sender.canStep("undo"),
      future: sender.canStep("redo"),
      steps: model.get("history") ?? {},
      pressed: pressed.filter(([, is]) => is).map(([name]) => name),
      readOnly: points.isLocked,
    });
  }

  // ---- data from Python ---------------------------------------------------------------------------------------------

  message(message: SpaceEditorToFrontEnd, buffers: Bytes[]) {
    if (message.type === "error") this.messages.show(message.message, true);
    if (message.type === "look") this.lookAt(message.id);
    if (message.type === "pictures" && (!message.view || message.view === this.parts.edits.id))
      this.receivePictures(message, buffers);
  }

  receivePictures({ seq, panes, facts }: Pick<Pictures, "seq" | "panes" | "facts">, buffers: Bytes[]) {
    const { requests, row, status } = this.parts;
    const bytes = buffers.map(bytesOf).values();
    const next = () => bytes.next().value!;
    for (const pane of panes) {
      const pixels = next(),
        depths = pane.hasDepths ? new Float32Array(next().slice().buffer) : null;
      const { image, info, map } = row.panes[pane.index]!;
      image.take(pane, pixels, depths, pane.cuts ? next() : null);
      const dets = pane.dets && new Float32Array(next().slice().buffer);
      map.sampled = pane.dets && dets && new SampledDets(pane.dets, dets, info.box);
    }
    status.facts = { folds: status.facts.folds, worst: status.facts.worst, ...facts };
    this.frames.drawNow();
    requests.confirm(seq);
  }

  receivePanes() {
    const { cursor, row } = this.parts;
    cursor.panes = this.model.get("panes");
    for (const pane of row.panes) {
      pane.image.picture = null;
      pane.viewport.isFitted = true;
    }
    this.layout();
  }

  /** Show whether Python makes something else: nothing can be edited then, and a drag is cancelled. */
  showWaiting() {
    const { brush, modes, names, points, requests, row, shapes } = this.parts,
      { isWaiting } = points;
    if (isWaiting) {
      row.cancelGestures();
      names.end(false);
      modes.setAdding(false);
      brush.stop();
      shapes.pen.stop();
    }
    row.showWaiting(this.model.get("waiting") || (requests.isSlow ? "Making the pictures" : ""), isWaiting);
    this.frames.invalidate();
  }

  /** Scroll a point into view. */
  lookAt(id: number) {
    const { points, row } = this.parts,
      p = points.withId(id);
    if (p) for (const pane of row.panes) pane.lookAt(p.target);
  }
}

function render({ model, el }: { model: Model; el: HTMLElement }) {
  const editor = new SpaceEditorView(model, el);
  return () => editor.close();
}

export default { initialize, render };
