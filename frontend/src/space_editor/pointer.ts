// Pointer, wheel and keys of the editor in space, turned into calls of the editor.

import { isRightClick, keepFromScrolling, POINT_STEPS, WheelSteps } from "../editor/handles.ts";
import { shownLength } from "../maths/numbers.ts";
import { freeIds, middleOf, TURN_CODES, TURN_WAYS, turnOfDrag } from "../maths/points.ts";
import { inPane, wayInPane } from "../maths/space.ts";
import type { Vector2, Vector3 } from "../types.ts";
import { ARROWS, slackOf, targetOf, treeOf } from "../ui/dom.ts";
import { commandOf, SPACE_EDITOR_KEYS } from "../ui/keys.ts";
import type { SpaceEditorView } from "./editor.ts";
import type { Line, SpacePane } from "./pane.ts";
import { LINES } from "./pane.ts";
import type { Moved } from "./point_tools.ts";

/** A press or a drag; places are in CSS pixels of the picture. */
export interface Press {
  pointer: number;
  from: Vector2;
  at: Vector2;
  /** Whether it has not moved yet */
  isPress: boolean;
  slack: number;
}
export type PlainGesture = Press & { kind: "pan" | "tap" };
export type MirrorGesture = Press & { kind: "mirror"; start: number };
export type TurnGesture = Press & { kind: "turn"; ids: number[]; about: Vector2; start: Vector2; scales: boolean };
export type BandGesture = Press & { kind: "band"; before: number[] };
export type CrossGesture = Press & { kind: "cross"; line: Line | null };
export type PointsGesture = Press & {
  kind: "points";
  id: number;
  ids: number[];
  what: Moved;
  adds: boolean;
  was: boolean;
};
export type Gesture = PlainGesture | MirrorGesture | TurnGesture | BandGesture | CrossGesture | PointsGesture;

/**
 * Pointers of one picture: points, the cross-hair, and the view with the middle button or with the space bar held.
 */
export class PaneGestures {
  gesture: Gesture | null = null;
  /** The place of the stage on the screen; while a gesture goes on, reading it takes 0.5 ms */
  box: DOMRect | null = null;
  isOthers = false; // whether a finger is on a picture of an editor in which nobody works yet
  wheelSteps = new WheelSteps();

  constructor(
    readonly editor: SpaceEditorView,
    readonly pane: SpacePane,
  ) {
    const on = <K extends keyof HTMLElementEventMap>(
      target: Element,
      name: K,
      handler: (event: HTMLElementEventMap[K]) => void,
      options: AddEventListenerOptions = {},
    ) =>
      target.addEventListener(name, (event) => editor.frames.guard(() => handler(event as HTMLElementEventMap[K])), {
        signal: editor.closed.signal,
        ...options,
      });
    on(pane.svg, "pointerdown", (e) => this.down(e));
    on(pane.svg, "pointermove", (e) => this.move(e));
    on(pane.svg, "pointerup", (e) => this.up(e));
    on(pane.svg, "pointercancel", (e) => this.up(e, true));
    on(pane.svg, "lostpointercapture", (e) => this.up(e, true));
    on(pane.svg, "dblclick", (e) => this.doubleClick(e));
    on(pane.svg, "contextmenu", (e) => this.contextMenu(e));
    on(
      pane.svg,
      "touchstart",
      (e) => {
        if (this.isOthers) keepFromScrolling(e);
      },
      { passive: false },
    );
    on(pane.stage, "wheel", (e) => this.wheel(e), { passive: false });
    for (const name of ["scroll", "resize"]) {
      window.addEventListener(
        name,
        () => {
          this.box = null;
        },
        { signal: editor.closed.signal, capture: true },
      );
    }
  }

  place(event: MouseEvent): Vector2 {
    if (!this.gesture) this.box = null;
    this.box ??= this.pane.stage.getBoundingClientRect();
    return [event.clientX - this.box.left, event.clientY - this.box.top];
  }

  /** What lies under the pointer. Clicks of a captured pointer go to the element that has captured it. */
  #elementAt(event: MouseEvent) {
    const isClick = event.type === "dblclick" || event.type === "contextmenu";
    return isClick ? treeOf(this.editor.root).elementFromPoint(event.clientX, event.clientY) : targetOf(event);
  }

  /** The point under the pointer, or null. */
  pointAt(event: MouseEvent): { id: number; what: Moved } | null {
    const found = this.#elementAt(event)?.closest("[data-id], [data-source], [data-line]");
    const id = found?.getAttribute("data-id"),
      source = found?.getAttribute("data-source");
    if (id) return { id: Number(id), what: "target" };
    return source ? { id: Number(source), what: "source" } : null;
  }

  /** The line of the cross-hair under the pointer, or null. */
  #lineAt(event: MouseEvent) {
    const name = targetOf(event).closest("[data-line]")?.getAttribute("data-line");
    return LINES.find((line) => line === name) ?? null;
  }

  down(event: PointerEvent) {
    const { editor, pane } = this,
      at = this.place(event),
      hit = this.pointAt(event);
    const mark = targetOf(event).closest("[data-mark]")?.getAttribute("data-mark");
    if (editor.isWaiting || this.gesture) return;
    this.isOthers = event.pointerType === "touch" && !editor.isWorkedIn; // before this press gives it the focus
    pane.svg.setPointerCapture(event.pointerId);
    event.preventDefault();
    const slack = slackOf(event.pointerType);
    const begun = { pointer: event.pointerId, from: at, at, isPress: true, slack };
    if (event.button === 1 || (event.button === 0 && editor.isSpaceDown)) this.gesture = { ...begun, kind: "pan" };
    else if (event.button !== 0) return;
    else if (mark === "axis") {
      pane.marks.grip.focus({ preventScroll: true });
      this.gesture = { ...begun, kind: "mirror", start: editor.pointTools.mirror.at };
    } else if (mark === "turn") this.#grabTurn(begun);
    else if (hit) this.#grab(event, hit, begun);
    else if (editor.isAdding) {
      const id = editor.pointTools.addAt(pane, at);
      if (id === null) editor.select([]);
      else this.#grab(event, { id, what: "target" }, begun);
    } else if (this.isOthers) this.gesture = { ...begun, kind: "tap" };
    else {
      pane.stage.focus({ preventScroll: true });
      this.gesture =
        event.shiftKey || editor.isSelecting
          ? { ...begun, kind: "band", before: [...editor.selected] }
          : { ...begun, kind: "cross", line: this.#lineAt(event) };
    }
  }

  #grabTurn(begun: Press) {
    const { editor, pane } = this,
      ids = editor.pointTools.beginTurn(),
      { k, x, y } = pane.view;
    if (!ids) return;
    const turned = editor.points.filter((p) => ids.includes(p.id));
    const [a, b] = middleOf(turned.map((p) => ({ target: inPane(pane.info, p.target) })));
    const about: Vector2 = [k * a + x, k * b + y],
      start: Vector2 = [begun.at[0] - about[0], begun.at[1] - about[1]];
    this.gesture = { ...begun, kind: "turn", ids, about, start, scales: false };
  }

  #grab(event: PointerEvent, { id, what }: { id: number; what: Moved }, begun: Press) {
    const { editor, pane } = this,
      was = editor.selected.has(id);
    const adds = editor.isSelecting || event.shiftKey || event.ctrlKey || event.metaKey;
    if (!was) editor.select(adds ? [...editor.selected, id] : [id]);
    pane.handles.focus(id);
    this.gesture = {
      ...begun,
      kind: "points",
      id,
      adds,
      was,
      what: event.altKey ? "both" : what,
      ids: freeIds(editor.points, editor.selected.has(id) ? [...editor.selected] : [id]),
    };
  }

  move(event: PointerEvent) {
    const g = this.gesture,
      at = this.place(event);
    if (!g || g.pointer !== event.pointerId) return;
    if (g.isPress && Math.hypot(at[0] - g.from[0], at[1] - g.from[1]) < g.slack) return;
    const { editor, pane } = this,
      { pointTools: tools } = editor,
      { k } = pane.view;
    if (g.kind === "pan") pane.panBy(at[0] - g.at[0], at[1] - g.at[1]);
    else if (g.kind === "band") this.#band(g, at);
    else if (g.kind === "tap") editor.messages.hint("Tap a picture first, then a finger moves its cross-hair");
    else if (g.kind === "mirror") tools.moveMirror(pane.under(at), false);
    else if (g.kind === "turn") {
      g.scales = event.altKey;
      const [angle, factor] = turnOfDrag(g.start, [at[0] - g.about[0], at[1] - g.about[1]], event);
      tools.turnTo(pane, g.ids, angle, factor);
    } else if (g.kind === "cross") editor.moveCross(pane, at, g.line, true);
    else if (g.kind === "points") {
      if (g.isPress) editor.beginDrag();
      if (!g.ids.length) tools.announceLocked(g.id);
      const way = wayInPane(pane.info, (at[0] - g.from[0]) / k, (at[1] - g.from[1]) / k);
      tools.drag(g.ids, tools.snappedWay(pane.info, g.id, way, g.what, event.altKey), g.what, g.id);
    }
    g.isPress = false;
    g.at = at;
  }

  /** Select what is drawn clearly in a rectangle, besides what was selected. */
  #band(g: BandGesture, at: Vector2) {
    const box = {
      x: Math.min(g.from[0], at[0]),
      y: Math.min(g.from[1], at[1]),
      width: Math.abs(at[0] - g.from[0]),
      height: Math.abs(at[1] - g.from[1]),
    };
    this.pane.handles.showBand(box);
    this.editor.select([...g.before, ...this.pane.pointsInside(box)]);
  }

  up(event: PointerEvent, isCancelled: boolean = false) {
    const g = this.gesture,
      { editor } = this;
    if (!g || g.pointer !== event.pointerId) return;
    this.gesture = null;
    this.pane.handles.showBand(null);
    if (g.kind === "mirror") this.#releaseMirror(g, isCancelled);
    else if (g.kind === "turn") editor.endDrag(isCancelled || g.isPress, g.scales ? "scale" : "turn");
    else if (g.kind === "points") {
      if (!g.isPress) editor.endDrag(isCancelled);
      else if (g.was) editor.select(g.adds ? [...editor.selected].filter((id) => id !== g.id) : [g.id]);
    } else if ((g.kind === "cross" || g.kind === "tap") && !isCancelled) {
      if (g.kind === "tap") {
        if (!g.isPress) return;
        this.pane.stage.focus({ preventScroll: true });
      }
      const line = g.kind === "cross" ? g.line : null;
      if (g.isPress && !line) editor.moveCross(this.pane, g.from, null, false);
      if (g.isPress) editor.select([]);
      editor.lookAtRest();
    }
  }

  #releaseMirror(g: MirrorGesture, isCancelled: boolean) {
    const { pointTools: tools } = this.editor,
      { at, normal } = tools.mirror,
      held = isCancelled ? g.start : at;
    tools.moveMirror(normal.map((x) => held * x) as Vector3, true);
  }

  /** Undo what a drag has done so far (Escape). Returns whether there was one. */
  cancel() {
    const g = this.gesture;
    this.gesture = null;
    this.pane.handles.showBand(null);
    if ((g?.kind === "points" && !g.isPress) || g?.kind === "turn") this.editor.endDrag(true);
    if (g?.kind === "mirror") this.#releaseMirror(g, true);
    return g !== null;
  }

  doubleClick(event: MouseEvent) {
    if (this.editor.isWaiting || this.editor.isSelecting) return;
    const hit = this.pointAt(event);
    if (hit) this.editor.goTo(hit.id);
    else this.editor.pointTools.addAt(this.pane, this.place(event));
    event.preventDefault();
  }

  contextMenu(event: MouseEvent) {
    event.preventDefault();
    const hit = this.pointAt(event);
    if (hit && isRightClick(event)) this.editor.pointTools.remove([hit.id]);
  }

  /** Go through the slices, with Ctrl zoom. The wheel scrolls the page until the user works in here. */
  wheel(event: WheelEvent) {
    const { editor, pane } = this,
      isZoom = event.ctrlKey || event.metaKey;
    if (!isZoom && !editor.isWorkedIn) {
      editor.messages.hint("Click a picture to go through its slices with the wheel");
      return;
    }
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1,
      [x, y] = this.place(event);
    const delta = Math.max(-240, Math.min(240, event.deltaY * lines));
    if (isZoom || !editor.isSlice) {
      pane.zoomAt(Math.exp(-delta * 0.004), x, y);
      return;
    }
    const steps = this.wheelSteps.add(delta);
    if (steps !== 0) editor.scroll(pane, steps);
  }
}

/** Do what a key anywhere in the editor means; returns whether it means something. */
export function spaceKey(editor: SpaceEditorView, event: KeyboardEvent) {
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key,
    isCommand = event.ctrlKey || event.metaKey;
  const target = targetOf(event),
    tools = editor.pointTools,
    fast = event.shiftKey ? 10 : 1;
  if (target.closest("input[type=text], select")) return false; // have keys of their own
  const onButton = target.closest("button"),
    pane = editor.paneOf(target)!;
  const focused = target.closest("[data-id]"),
    id = focused ? Number(focused.getAttribute("data-id")) : null;
  if (isCommand && POINT_STEPS[key] && !onButton) {
    return pane.handles.focusNext(
      editor.points.map((p) => p.id),
      POINT_STEPS[key],
      id,
    );
  }
  if (isCommand) return spaceCommand(editor, key, event.shiftKey);
  if (target.closest("input[type=range]")) return false;
  if (onButton && key in ARROWS) return editor.toolbar.focusNext(onButton, key);
  if (onButton && (key === "Enter" || key === " ")) return false;
  if (key in ARROWS && target.closest("[data-mark]")) return mirrorKey(editor, pane, ARROWS[key]!, fast);
  const way = TURN_WAYS[event.altKey ? TURN_CODES[event.code]! : key];
  if (way) {
    tools.turnKey(pane, way, { isLarge: event.shiftKey, isScale: event.altKey });
    return true;
  }
  if (key in ARROWS) {
    tools.nudge(pane, id, ARROWS[key]!, fast, event.altKey ? "both" : "target");
    return true;
  }
  if (key === "PageUp" || key === "PageDown") {
    const by = (key === "PageUp" ? -1 : 1) * fast;
    if (event.altKey) tools.nudgeDepth(pane, id, by);
    else editor.scroll(pane, by);
    return true;
  }
  if (event.altKey) return false;
  if (key === " ") {
    editor.isSpaceDown = true;
    return true;
  }
  if (key === "Enter") {
    if (id === null) tools.addPlace(editor.cursor, pane);
    else editor.toggleSelected(id);
    return true;
  }
  if (key === "Escape") return editor.escape();
  const command = (event.shiftKey && commandOf(SPACE_EDITOR_KEYS, `Shift+${key}`)) || commandOf(SPACE_EDITOR_KEYS, key);
  if (!command) return false;
  editor.run(command === "zoom" ? (key === "-" ? "zoom-out" : "zoom-in") : command, id);
  return true;
}

/** Move the plane of the mirror by voxels of a picture that looks along it. */
function mirrorKey(editor: SpaceEditorView, pane: SpacePane, [dx, dy]: Vector2, voxels: number) {
  const {
      info,
      info: {
        spacing: [du, dv],
      },
    } = pane,
    { pointTools: tools } = editor,
    { at, normal } = tools.mirror;
  const way = wayInPane(info, dx * voxels * du, dy * voxels * dv);
  tools.moveMirror(normal.map((x, k) => at * x + way[k]!) as Vector3, true);
  editor.messages.announce(`mirror at ${shownLength(tools.mirror.at)}`);
  return true;
}

function spaceCommand(editor: SpaceEditorView, key: string, isShift: boolean) {
  const command =
    (isShift && commandOf(SPACE_EDITOR_KEYS, `Control+Shift+${key}`)) || commandOf(SPACE_EDITOR_KEYS, `Control+${key}`);
  if (!command) return false;
  editor.run(command, null);
  return true;
}
