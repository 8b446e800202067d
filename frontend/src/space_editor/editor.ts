// The editor in space: three linked pictures of a volume with the same points.
// To Python: edit and history, by sync/edits.js; hello, look, seen. From Python: pictures, error, done.

import type { EditorCommands } from "../editor/base.ts";
import { EditorDrawing, initialize } from "../editor/base.ts";
import type { Pictures, PicturesWanted, PointsEdit, Seen, SlicesMoved, SpaceEditorToFrontEnd } from "../generated.ts";
import { NEARLY_FOLDED } from "../generated.ts";
import { shownLength } from "../maths/numbers.ts";
import { freeIds, renamedPoint, resetPoints, samePoints, switchedPoints } from "../maths/points.ts";
import { flatPoint, fromPane, inPane, withSources } from "../maths/space.ts";
import { busOf, publishPoints, settingsOf } from "../sync/bus.ts";
import type { Change } from "../sync/edits.ts";
import { MOST_CHARACTERS, RestingTrait } from "../sync/edits.ts";
import type { Model, ModelHandler, PaneInfo, Point, PointsDetail, Vector2, Vector3 } from "../types.ts";
import { beforeActionOutside, isWorkedIn, OWN_KEYS, pageElement, setAttributes, setText, treeOf } from "../ui/dom.ts";
import { HelpPanel, SPACE_EDITOR_KEYS } from "../ui/keys.ts";
import type { ToolEntry } from "../ui/toolbar.ts";
import { Toolbar } from "../ui/toolbar.ts";
import type { Line } from "./pane.ts";
import { SpacePane } from "./pane.ts";
import { SpacePointTools } from "./point_tools.ts";
import { PaneGestures, spaceKey } from "./pointer.ts";

const LEAST_HEIGHT = 140; // CSS pixels of a picture
const SPACE_FOLD_TIP =
  "Smallest factor by which volumes are stretched, on a coarse lattice: 1 keeps them; below 0 " +
  "the volume folds over itself";
const SLOW_PICTURES = 500; // milliseconds after which a message reports that pictures are being made
const LOOK_PATIENCE = 400; // milliseconds after which a place is sent although pictures of the last one have not come

const SPACE_PROJECTIONS: Record<string, string> = {
  slice: "Slices",
  mip: "Maximum (MIP)",
  composite: "Composite",
  shaded: "Shaded",
};

const SPACE_GROUPS: ToolEntry[][] = [
  [
    ["add", "Add", "Add points: click where", true],
    ["select", "Select", "Select several points: drag a band, or tap them", true],
    ["remove", "Delete", "Delete the selected points", false, "selection"],
    ["rename", "Rename", "Name the selected point", false, "one"],
    ["switch", "On/off", "Switch the selected points on or off", false, "selection"],
    ["lock", "Lock", "Lock the selected points, or free them", true, "selection"],
    ["reset", "Put back", "Put the selected points, or all, back where they were taken", false, "points"],
  ],
  [
    ["undo", "Undo", "Undo", false, "past"],
    ["redo", "Redo", "Redo", false, "future"],
  ],
  [
    ["go", "Go to", "Bring the slices to the selected point", false, "one"],
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
    ["mirror-axis", "Mirror another way", "Lay the plane of the mirror across the next axis", false],
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

/**
 * Remarks of Python: the least det J and the share of the volume that folds, the place where it folds most, a sentence.
 */
export type Facts = { folds?: [number, number] | null; worst?: Vector3 | null; note?: string; isBad?: boolean };

/** A request for other pictures. */
export type ViewRequest = Pick<SlicesMoved, "cursor" | "projection" | "original">;

export class SpaceEditorView extends EditorDrawing {
  commands: EditorCommands = {
    guard: (action) => this.frames.guard(action),
    run: (command, focused) => this.run(command, focused),
    focus: () => this.focusStage(),
  };
  host: HTMLElement;
  selected: Set<number>;
  selection: RestingTrait;
  points: Point[];
  panes: PaneInfo[];
  cursor: Vector3;
  pointTools: SpacePointTools;
  toolbar: Toolbar;
  chooser: HTMLSelectElement;
  row: HTMLDivElement;
  pictures: SpacePane[];
  gestures: PaneGestures[];
  wait: HTMLDivElement;
  input: HTMLInputElement;
  help: HelpPanel;
  factsLine: HTMLSpanElement;
  foldFact: HTMLSpanElement;
  notes: HTMLDivElement;
  observer: ResizeObserver;

  id = Math.random().toString(36).slice(2, 12);
  closed = new AbortController();
  #ends: (() => void)[] = []; // of listening
  /** The points before the drag, or null */
  drag0: Point[] | null = null;
  isAdding = false;
  isSelecting = false;
  isSpaceDown = false;
  /** The point that is being named */
  renamed: { id: number; pane: SpacePane } | null = null;
  facts: Facts = {};
  shownCount = 0; // of the messages with pictures
  /** The places that were sent */
  looked: Set<string> = new Set();
  /** The request that waits */
  pendingLook: (ViewRequest & { moving: boolean }) | null = null;
  waitingSince = -Infinity; // milliseconds
  lookTimer = 0;
  slowTimer = 0;
  isSlow = false; // whether pictures have been waited for long

  constructor(model: Model, el: HTMLElement) {
    super(model);
    this.host = el;
    this.selected = new Set(model.get("selected"));
    this.selection = new RestingTrait(model, "selected");
    this.sender.receive();
    this.points = this.sender.points;
    this.panes = model.get("panes");
    /** The place that the slices meet at */
    this.cursor = [...(model.get("cursor") as Vector3)];
    this.pointTools = new SpacePointTools(this);
    el.classList.add("dnb-ed-host");
    el.append(this.root);
    this.root.classList.add("dnb-space");
    this.toolbar = new Toolbar(this.commands, this.root, SPACE_GROUPS, SPACE_EDITOR_KEYS, SPACE_MORE);
    const group = pageElement("div", "dnb-ed-group", null);
    this.toolbar.root.insertBefore(group, this.toolbar.root.children[2]!);
    this.chooser = pageElement("select", "dnb-sp-select", group, {
      "aria-label": "What the pictures show",
      ...OWN_KEYS,
    });
    for (const [name, title] of Object.entries(SPACE_PROJECTIONS)) {
      pageElement("option", "", this.chooser, { value: name }).textContent = title;
    }
    this.row = pageElement("div", "dnb-sp-row", this.root);
    this.pictures = this.panes.map((_, k) => new SpacePane(this, k, this.row));
    this.gestures = this.pictures.map((pane) => new PaneGestures(this, pane));
    const veil = pageElement("div", "dnb-ed-veil", this.row);
    this.wait = pageElement("div", "dnb-ed-wait", veil, { role: "status" });
    this.input = pageElement("input", "dnb-ed-input", this.row, {
      type: "text",
      maxlength: "80",
      hidden: "",
      "aria-label": "name of the point",
      ...OWN_KEYS,
    });
    this.row.append(this.messages.tip, this.messages.alert);
    this.help = new HelpPanel(
      this.row,
      this.root,
      () => this.pictures[0]!.stage.focus({ preventScroll: true }),
      SPACE_EDITOR_KEYS,
    );
    const status = pageElement("div", "dnb-ed-status", this.root),
      state = pageElement("div", "dnb-ed-state", status);
    this.factsLine = pageElement("span", "dnb-ed-facts", state);
    this.foldFact = pageElement("span", "dnb-ed-folds", state);
    this.notes = pageElement("div", "dnb-ed-notes", status);
    this.root.append(this.messages.liveRegion);
    beforeActionOutside(this.root, () => this.selection.flush(), this.closed.signal);
    Object.assign(this.root, { deformnb: this }); // for tests and debugging
    this.observer = new ResizeObserver(() => this.frames.guard(() => this.layout()));
    this.#followModel();
    this.#followPage();
    this.frames.guard(() => {
      this.layout();
      this.showWaiting();
    });
    model.send({ type: "hello", view: this.id } satisfies PicturesWanted);
    this.#expectPictures();
  }

  #followModel() {
    const { model, sender } = this,
      bus = busOf(model);
    const on = (name: string, handler: ModelHandler) => {
      const guarded: ModelHandler = (...given) => this.frames.guard(() => handler(...given));
      model.on(name, guarded);
      this.#ends.push(() => model.off(name, guarded));
    };
    on("msg:custom", (message, buffers) => this.message(message, buffers ?? []));
    on("change:selected", () => {
      if (!this.selection.isAhead) this.select(model.get("selected"), false);
    });
    on("change:cursor", () => this.receiveCursor());
    on("change:panes", () => this.setPanes());
    on("change:theme", () => this.theme.apply());
    on("change:waiting", () => this.showWaiting());
    for (const name of ["height", "fill"]) on(`change:${name}`, () => this.layout());
    for (const name of ["label", "projection", "shows_original", "read_only", "history", "mirror", "snap"]) {
      on(`change:${name}`, () => this.frames.invalidate());
    }
    const moved = (event: CustomEvent<PointsDetail>) => {
      this.frames.guard(() => this.#receiveMove(event.detail));
    };
    bus.addEventListener("deformnb:points", moved);
    this.#ends.push(() => bus.removeEventListener("deformnb:points", moved));
    sender.greet();
    const news = {
      points: () => this.receive(),
      status: () => this.messages.showStatus(sender),
      history: () => this.frames.invalidate(),
    };
    this.#ends.push(sender.listen((what: Change) => this.frames.guard(news[what])));
  }

  #followPage() {
    const { signal } = this.closed;
    const listen = <K extends keyof HTMLElementEventMap>(
      target: EventTarget,
      name: K,
      handler: (event: HTMLElementEventMap[K]) => void,
    ) =>
      target.addEventListener(name, (event) => this.frames.guard(() => handler(event as HTMLElementEventMap[K])), {
        signal,
      });
    listen(this.chooser, "change", () => this.look({ projection: this.chooser.value as SlicesMoved["projection"] }));
    listen(this.root, "keydown", (event) => {
      if (!spaceKey(this, event)) return;
      event.preventDefault();
      event.stopPropagation();
    });
    listen(this.root, "keyup", (event) => {
      if (event.key === " ") this.isSpaceDown = false;
      if (/^(Arrow|Page)/.test(event.key)) this.lookAtRest();
    });
    listen(this.root, "focusout", ({ relatedTarget }) => {
      if (!(relatedTarget instanceof Node && this.root.contains(relatedTarget))) this.isSpaceDown = false;
    });
    listen(this.input, "keydown", (event) => {
      event.stopPropagation();
      if (event.key === "Enter" || event.key === "Escape") this.endRename(event.key === "Enter");
    });
    listen(this.input, "blur", () => this.endRename(true));
    this.observer.observe(this.root);
  }

  close() {
    this.sender.flush();
    this.closed.abort();
    this.selection.close();
    for (const end of this.#ends) end();
    this.observer.disconnect();
    this.theme.close();
    this.messages.close();
    this.frames.close();
    for (const timer of [this.slowTimer, this.lookTimer]) clearTimeout(timer);
    this.root.remove();
    this.host.classList.remove("dnb-ed-host");
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  layout() {
    this.theme.apply(); // a style sheet that comes late changes sizes as well
    this.root.setAttribute("aria-label", `Editor in space of ${this.model.get("label") || "Volume"}`);
    this.root.classList.toggle("dnb-sp-viewer", this.isViewer);
    const isFilling = Boolean(this.model.get("fill"));
    this.root.classList.toggle("dnb-ed-fill", isFilling); // its height is that of the box around it
    if (isFilling) {
      this.#fillBox();
      this.frames.drawNow();
      return;
    }
    const widths = this.pictures.map((pane) => Math.max(100, pane.stage.clientWidth || 260));
    const wanted = this.panes.map(({ box: [a0, a1, b0, b1] }, k) => (widths[k]! * (b1 - b0)) / (a1 - a0));
    const most = this.model.get("height");
    const height = Math.round(Math.max(LEAST_HEIGHT, Math.min(most, Math.max(...wanted))));
    this.pictures.forEach((pane, k) => {
      pane.layout(widths[k]!, height);
    });
    this.frames.drawNow();
  }

  /** Lay the pictures out in as many columns as show them largest. */
  #fillBox() {
    const { clientWidth, clientHeight } = this.row,
      count = this.panes.length;
    const above = Math.max(0, ...this.pictures.map(({ root, stage }) => root.offsetHeight - stage.offsetHeight));
    const sizes = this.panes.map((_, k) => {
      const columns = k + 1,
        rows = Math.ceil(count / columns);
      const width = Math.max(60, clientWidth / columns),
        height = Math.max(60, clientHeight / rows - above);
      const scales = this.panes.map(({ box: [a0, a1, b0, b1] }) => Math.min(width / (a1 - a0), height / (b1 - b0)));
      return { columns, height, scale: Math.min(...scales) };
    });
    const { columns, height } = sizes.reduce((best, one) => (one.scale > best.scale ? one : best));
    this.row.style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
    for (const pane of this.pictures) pane.layout(pane.stage.clientWidth || 60, Math.floor(height) - 1);
  }

  draw() {
    if (this.pictures.map((pane) => pane.draw()).some(Boolean)) this.focusStage(); // no shortcut: all are drawn
    this.describe();
  }

  describe() {
    const { points, selected, facts, model } = this,
      off = points.filter((p) => !p.active).length;
    const count = `${points.length} ${points.length === 1 ? "point" : "points"}${off ? `, ${off} off` : ""}`;
    const one = selected.size === 1 ? points.find((p) => selected.has(p.id)) : null;
    const chosen = one
      ? `point ${one.id}${one.name ? ` ${one.name}` : ""} at ${one.target.map(shownLength).join(", ")}`
      : selected.size
        ? `${selected.size} selected`
        : "";
    if (this.isViewer) {
      setText(this.notes, facts.note || "Click or drag the cross-hair; the wheel goes through the slices");
      return;
    }
    setText(
      this.factsLine,
      points.length
        ? [count, chosen].filter(Boolean).join(" \u00b7 ")
        : "No points yet: four or more in space bend the volume, one moves it",
    );
    this.#describeFolds(points.length ? facts.folds : null);
    setText(this.notes, facts.note || this.#advice());
    this.notes.classList.toggle("dnb-ed-bad", Boolean(facts.isBad));
    this.notes.classList.toggle("dnb-ed-near", !facts.isBad && Boolean(facts.note));
    this.chooser.value = model.get("projection");
    const pressed = Object.entries({
      add: this.isAdding,
      select: this.isSelecting,
      mirror: this.pointTools.mirror.on,
      snap: this.pointTools.snap > 0,
      compare: model.get("shows_original"),
      help: this.help.isOpen,
      lock: selected.size > 0 && points.every((p) => p.locked || !selected.has(p.id)),
    });
    this.toolbar.update({
      count: points.length,
      selected: selected.size,
      past: this.sender.canStep("undo"),
      future: this.sender.canStep("redo"),
      steps: model.get("history") ?? {},
      pressed: pressed.filter(([, is]) => is).map(([name]) => name),
      readOnly: this.isLocked,
    });
  }

  #describeFolds(folds: [number, number] | null | undefined) {
    const [least, share] = folds ?? [1, 0],
      value = `min det J ${least.toFixed(2)}`;
    this.foldFact.classList.toggle("dnb-ed-bad", least <= 0);
    this.foldFact.classList.toggle("dnb-ed-near", least > 0 && least < NEARLY_FOLDED);
    const much = share > 0 ? ` on ${(100 * share).toFixed(share < 0.1 ? 1 : 0)} %` : "";
    const words =
      least <= 0 ? `\u25b2 folds${much}` : least < NEARLY_FOLDED ? "\u25b2 nearly folds" : "\u2713 no folds";
    setText(this.foldFact, folds ? `${words} (${value})` : "");
    setAttributes(this.foldFact, { title: folds ? SPACE_FOLD_TIP : "" });
  }

  /** A next step for the user, where there is nothing to remark. */
  #advice() {
    if (this.model.get("read_only")) return "These points are shown only";
    if (this.points.length === 0) {
      return "Double-click adds a point; a click brings the slices there; ? for keys";
    }
    if (this.selected.size === 0) {
      const wheel = this.isSlice ? "goes through the slices" : "zooms";
      return `Drag a disc to move what is under it; the wheel ${wheel}; ? for keys`;
    }
    return "Arrows move the selected points, J brings the slices to them, Delete removes them, Home puts them back";
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /**
   * Make an edit. Returns whether there is one.
   * @param join edits with the same are undone as one
   */
  edit(points: Point[], kind: PointsEdit["kind"] = "move", join: string | null = null) {
    if (this.isLocked || samePoints(points, this.points)) return false;
    if (JSON.stringify(points).length > MOST_CHARACTERS) {
      this.messages.show("These are too many points to send at once. Remove some, or edit in Python.");
      return false;
    }
    this.sender.edit(points, kind, join); // which notifies all views, this one too
    return true;
  }

  stepHistory(way: "undo" | "redo") {
    if (this.drag0 || this.isLocked || !this.sender.step(way)) return;
    this.messages.announce(way === "undo" ? "undone" : "redone");
  }

  beginDrag() {
    if (!this.isLocked) this.drag0 = this.points;
  }

  /** Show points on their way. */
  show(points: Point[]) {
    this.points = points;
    this.#publish("move");
    this.sender.move(points);
    this.frames.invalidate();
  }

  endDrag(isCancelled: boolean, kind: PointsEdit["kind"] = "move") {
    const before = this.drag0,
      points = this.points;
    this.drag0 = null;
    if (!before) return;
    this.points = before;
    if (!isCancelled && this.edit(points, kind)) return;
    this.points = this.sender.points; // Python may have moved them meanwhile
    this.#publish("end");
    this.sender.move(this.points); // Python has seen the drag, and now that it is no more
    this.frames.invalidate();
  }

  #publish(phase: "move" | "end") {
    const { id: origin, points, model } = this;
    publishPoints(busOf(model), { origin, points, settings: settingsOf(model), fit: null, phase });
  }

  /** Let the user name a point. */
  rename(id: number, pane: SpacePane) {
    const p = this.points.find((q) => q.id === id);
    if (!p || this.isLocked) return;
    const {
        target: [a, b],
      } = flatPoint(p, pane.info, null),
      { k, x, y } = pane.view;
    const box = this.row.getBoundingClientRect(),
      stage = pane.stage.getBoundingClientRect();
    this.renamed = { id, pane };
    this.input.hidden = false;
    this.input.value = p.name;
    this.input.placeholder = `point ${id}`;
    this.input.style.left = `${Math.max(4, Math.min(box.width - 164, stage.left - box.left + k * a + x + 12))}px`;
    this.input.style.top = `${Math.max(4, stage.top - box.top + k * b + y - 30)}px`;
    this.input.focus();
    this.input.select();
  }

  endRename(isKept: boolean) {
    if (this.input.hidden || !this.renamed) return;
    const { id, pane } = this.renamed,
      hadFocus = treeOf(this.root).activeElement === this.input;
    this.input.hidden = true;
    if (isKept) this.edit(renamedPoint(this.points, id, this.input.value), "rename");
    if (!pane.handles.focus(id) && hadFocus) pane.stage.focus({ preventScroll: true });
  }

  // ---- selection and commands ---------------------------------------------------------------------------------------

  /** @param isShared whether Python gets it */
  select(ids: number[] | null, isShared: boolean = true) {
    const known = new Set(this.points.map((p) => p.id)),
      next = new Set((ids ?? []).filter((id) => known.has(id)));
    const isSame = next.size === this.selected.size && [...next].every((id) => this.selected.has(id));
    this.selected = next;
    this.frames.invalidate();
    if (isSame || !isShared) return;
    this.selection.sendSoon([...this.selected]);
  }

  toggleSelected(id: number) {
    this.select(this.selected.has(id) ? [...this.selected].filter((other) => other !== id) : [...this.selected, id]);
  }

  /** The points of a command: the selected, or the one in focus if it is not among them. */
  chosenIds(id: number | null) {
    return id !== null && !this.selected.has(id) ? [id] : [...this.selected];
  }

  /**
   * Run a command of the toolbar (`focused` is null then) or of a key.
   * @param focused the point in focus
   */
  run(command: string, focused: number | null) {
    const ids = this.chosenIds(focused),
      { points, pictures, pointTools: tools } = this;
    const chosenOrAll = ids.length ? ids : points.map((p) => p.id);
    if (focused === null && !["undo", "redo"].includes(command) && this.toolbar.isOff(command)) return;
    const active = this.paneOf(document.activeElement)!;
    const commands: Record<string, () => void> = {
      add: () => this.setAdding(!this.isAdding),
      select: () => this.setSelecting(!this.isSelecting),
      remove: () => tools.remove(ids),
      "select-all": () => this.select(this.points.map((p) => p.id)),
      undo: () => this.stepHistory("undo"),
      redo: () => this.stepHistory("redo"),
      rename: () => {
        if (ids.length === 1) this.rename(ids[0]!, active);
      },
      switch: () => tools.change(switchedPoints(points, ids), "switch"),
      reset: () => tools.change(resetPoints(points, freeIds(points, chosenOrAll)), "reset"),
      lock: () => tools.toggleLock(ids),
      go: () => {
        if (ids.length === 1) this.goTo(ids[0]!);
      },
      compare: () => this.look({ original: !this.model.get("shows_original") }),
      "zoom-in": () => {
        for (const pane of pictures) pane.zoomAt(1.25);
      },
      "zoom-out": () => {
        for (const pane of pictures) pane.zoomAt(0.8);
      },
      fit: () => {
        for (const pane of pictures) pane.fitView();
      },
      help: () => this.toggleHelp(),
      mirror: () => tools.toggleMirror(),
      "mirror-axis": () => tools.turnMirror(),
      snap: () => tools.toggleSnap(),
      "turn-left": () => tools.turnKey(active, -1, { isLarge: true, isScale: false }),
      "turn-right": () => tools.turnKey(active, 1, { isLarge: true, isScale: false }),
    };
    commands[command]?.();
  }

  /**
   * Switch a mode in which whatever is dragged around or clicked is added to the selection: fingers have no Shift key.
   */
  setSelecting(isSelecting: boolean) {
    if (isSelecting) this.setAdding(false);
    this.isSelecting = isSelecting;
    if (isSelecting) this.messages.hint("Drag a band around points, or tap one after the other. Esc when done", 4000);
    this.frames.invalidate();
  }

  setAdding(isAdding: boolean) {
    if (isAdding) this.setSelecting(false);
    this.isAdding = isAdding && !this.isLocked;
    this.row.classList.toggle("dnb-ed-adding", this.isAdding);
    if (this.isAdding) this.messages.hint("Click where a feature is, and drag it. Esc when done");
    this.frames.invalidate();
  }

  /** Show or hide the list of keys. The focus goes to the list, and back to where it was. */
  toggleHelp() {
    this.help.toggle();
    this.frames.invalidate();
  }

  /** End what is going on; returns whether there was anything. */
  escape() {
    if (this.gestures.some((gestures) => gestures.cancel())) return true;
    if (this.help.isOpen) {
      this.toggleHelp();
      return true;
    }
    if (this.isAdding || this.isSelecting) {
      this.setAdding(false);
      this.setSelecting(false);
      return true;
    }
    if (this.selected.size === 0) return false;
    this.select([]);
    return true;
  }

  focusStage() {
    this.paneOf(document.activeElement)!.stage.focus({ preventScroll: true });
  }

  // ---- data from Python ---------------------------------------------------------------------------------------------

  message(message: SpaceEditorToFrontEnd, buffers: (DataView | ArrayBuffer)[]) {
    if (message.type === "error") this.messages.show(message.message, true);
    if (message.type === "look") this.lookAt(message.id);
    if (message.type === "pictures" && (!message.view || message.view === this.id))
      this.receivePictures(message, buffers);
  }

  receivePictures(
    { seq, panes, facts }: Pick<Pictures, "seq" | "panes" | "facts">,
    buffers: (DataView | ArrayBuffer)[],
  ) {
    const parts = buffers.map((b) =>
      b instanceof DataView ? new Uint8Array(b.buffer, b.byteOffset, b.byteLength) : new Uint8Array(b),
    );
    let used = 0;
    const next = () => {
      used += 1;
      return parts[used - 1];
    };
    for (const pane of panes) {
      const pixels = next()!,
        depths = pane.hasDepths ? new Float32Array(next()!.slice().buffer) : null;
      this.pictures[pane.index]!.take(pane, pixels, depths, pane.shapes ? next()! : null);
    }
    this.#expectPictures(false);
    this.facts = { folds: this.facts.folds, worst: this.facts.worst, ...facts };
    this.shownCount += 1;
    this.frames.drawNow();
    if (seq) this.model.send({ type: "seen", view: this.id, seq } satisfies Seen);
    this.waitingSince = -Infinity;
    this.#sendLook();
  }

  /** Set a trait. */
  set(name: string, value: unknown) {
    this.model.set(name, value);
    this.model.save_changes();
    this.frames.invalidate();
  }

  receive() {
    const { points } = this.sender;
    if (this.drag0) {
      // Python has found where a new point takes hold; the pointer keeps the rest
      this.drag0 = withSources(this.drag0, points);
      this.points = withSources(this.points, points);
      return;
    }
    if (samePoints(points, this.points)) return;
    this.points = points;
    this.select([...this.selected]);
    this.#publish("end");
    this.frames.invalidate();
  }

  /** Take over the points of another view. */
  #receiveMove({ origin, points, phase }: PointsDetail) {
    if (origin === this.id || this.drag0) return;
    if (phase === "move") {
      this.points = points;
      this.frames.invalidate();
    } else this.receive();
  }

  receiveCursor() {
    const given = this.model.get("cursor");
    if (this.looked.delete(JSON.stringify(given)) || this.pendingLook) return; // our own, or an older one
    this.cursor = [...(given as Vector3)];
    this.frames.invalidate();
  }

  setPanes() {
    this.panes = this.model.get("panes");
    for (const pane of this.pictures) {
      pane.picture = null;
      pane.isFitted = true;
    }
    this.layout();
  }

  get isWorkedIn() {
    return isWorkedIn(this.root);
  }

  get isWaiting() {
    return Boolean(this.model.get("waiting"));
  }

  get isLocked() {
    return this.isWaiting || Boolean(this.model.get("read_only"));
  }

  /** Whether there is nothing to edit: slices to look at. */
  get isViewer() {
    return Boolean(this.model.get("read_only")) && this.points.length === 0;
  }

  get isSlice() {
    return this.model.get("projection") === "slice";
  }

  /** Show whether Python makes something else: nothing can be edited then, and a drag is cancelled. */
  showWaiting() {
    const { isWaiting } = this;
    if (isWaiting) {
      for (const gestures of this.gestures) gestures.cancel();
      this.endRename(false);
      this.setAdding(false);
    }
    this.row.classList.toggle("dnb-ed-waiting", isWaiting);
    this.row.setAttribute("aria-busy", String(isWaiting));
    setText(this.wait, this.model.get("waiting") || (this.isSlow ? "Making the pictures" : ""));
    this.frames.invalidate();
  }

  // ---- where the slices lie -----------------------------------------------------------------------------------------

  /**
   * Show a message while pictures are made: the first of a large volume take seconds, as do those of a projection.
   */
  #expectPictures(isExpected: boolean = true) {
    clearTimeout(this.slowTimer);
    if (isExpected) {
      this.slowTimer = setTimeout(
        () =>
          this.frames.guard(() => {
            this.isSlow = true;
            this.showWaiting();
          }),
        SLOW_PICTURES,
      );
    } else if (this.isSlow) {
      this.isSlow = false;
      this.showWaiting();
    }
  }

  /** Request pictures; places at the pace at which pictures come, and the newest only. */
  look(what: ViewRequest, isMoving: boolean = false) {
    this.pendingLook = { ...this.pendingLook, ...what, moving: isMoving };
    if ("projection" in what || "original" in what) this.#expectPictures();
    this.#sendLook();
  }

  #sendLook() {
    clearTimeout(this.lookTimer);
    if (!this.pendingLook) return;
    const now = performance.now(),
      since = now - this.waitingSince;
    if (since < LOOK_PATIENCE) {
      this.lookTimer = setTimeout(() => this.#sendLook(), LOOK_PATIENCE - since);
      return;
    }
    this.waitingSince = now;
    const {
      pendingLook: { cursor },
      looked,
    } = this;
    if (cursor) looked.add(JSON.stringify(cursor));
    for (const oldest of [...looked].slice(0, -20)) looked.delete(oldest);
    this.model.send({ type: "look", view: this.id, ...this.pendingLook } satisfies SlicesMoved);
    this.pendingLook = null;
  }

  lookAtRest() {
    if (this.isSlice) this.look({ cursor: this.cursor }, false);
  }

  /** @param place which is kept inside the volume */
  setCursor(place: Vector3, isMoving: boolean) {
    const next = this.panes.reduce<Vector3>((at, pane) => {
      const [a, b, c] = inPane(pane, at),
        [low, high] = pane.depths;
      return c < low || c > high ? fromPane(pane, [a, b, Math.max(low, Math.min(high, c))]) : at;
    }, place);
    this.cursor = next;
    this.look({ cursor: next }, isMoving);
    this.frames.invalidate();
  }

  setDepth(pane: SpacePane, depth: number) {
    const [a, b] = inPane(pane.info, this.cursor);
    this.setCursor(fromPane(pane.info, [a, b, depth]), true);
  }

  scroll(pane: SpacePane, slices: number) {
    const {
        depths: [first],
        spacing,
      } = pane.info,
      now = Math.round((pane.depth - first) / spacing[2]);
    this.setDepth(pane, first + (now + slices) * spacing[2]);
    this.lookAtRest();
  }

  /**
   * Move the cross-hair of a picture to a place on the screen: all of it, or one line only.
   * @param at in pixels
   */
  moveCross(pane: SpacePane, at: Vector2, line: Line | null, isMoving: boolean) {
    const [a, b] = pane.toPlane(at) as Vector2,
      [a0, b0, c0] = inPane(pane.info, this.cursor);
    const place: Vector3 =
      this.isSlice || line ? [line === "h" ? a0 : a, line === "v" ? b0 : b, c0] : inPane(pane.info, pane.under(at)); // of the whole volume: what is seen there
    this.setCursor(fromPane(pane.info, place), isMoving);
  }

  /** Bring the slices to a point. */
  goTo(id: number) {
    const p = this.points.find((q) => q.id === id);
    if (!p) return;
    this.select([id]);
    this.setCursor([...p.target] as Vector3, false);
    this.messages.announce(`slices at ${p.name || `point ${id}`}`);
  }

  /** Bring a point into sight. */
  lookAt(id: number) {
    const p = this.points.find((q) => q.id === id);
    if (p) for (const pane of this.pictures) pane.lookAt(p.target as Vector3);
  }

  /** The picture that contains an element, else the first. */
  paneOf(element: Element | null) {
    return this.pictures.find((pane) => pane.root.contains(element)) ?? this.pictures[0];
  }
}

function render({ model, el }: { model: Model; el: HTMLElement }) {
  const editor = new SpaceEditorView(model, el);
  return () => editor.close();
}

export default { initialize, render };
