// The modes of the editor: adding, selecting, the pen, a brush, and the tools that exclude one another.

import { setTrait } from "../sync/edits.ts";
import type { Vector2 } from "../types.ts";
import type { Gesture } from "./gesture.ts";
import type { EditorParts } from "./parts.ts";

/** A tool that is switched on and off. */
interface HeldTool {
  readonly isOn: boolean;
  /** What to do next with it. */
  readonly advice?: string;
  stop(): boolean;
  /** The gesture that a press begins, or null. */
  grab(at: Vector2, isFinger: boolean): Gesture | null;
  /** Whether a press is not for it: one that belongs to the host page, or on a mark. */
  ignores?(isOthers: boolean, mark: string | null): boolean;
  /** Follow a pointer that is not down. */
  hover?(at: Vector2): void;
  /** The pointer has left the picture. */
  leave?(): void;
  /** Handle a key; returns whether the tool uses it. */
  key(key: string, event: KeyboardEvent, arrow?: Vector2): boolean;
}

/** Dependencies of the modes on the editor. */
export type ModesEditor = EditorParts<
  "model" | "frames" | "messages" | "stage" | "points",
  "pen" | "brush" | "window" | "wand" | "shapes",
  "grid",
  "help"
>;

export class Modes {
  isAdding = false;

  isSelecting = false;

  constructor(readonly editor: ModesEditor) {}

  setAdding(isAdding: boolean) {
    const { frames, messages, points, stage } = this.editor;
    if (isAdding) {
      this.deactivateTools();
      this.setSelecting(false);
    }
    this.isAdding = isAdding && !points.isLocked;
    stage.element.classList.toggle("dnb-ed-adding", this.isAdding);
    if (this.isAdding)
      messages.hint("Press on a feature and drag it in one go, or click to set a point. Esc when done");
    frames.invalidate();
  }

  /**
   * While it is on, all that is dragged around or clicked is added to the selection: fingers have no Shift key.
   */
  setSelecting(isSelecting: boolean) {
    const { frames, messages, stage } = this.editor;
    if (isSelecting) {
      this.deactivateTools();
      this.setAdding(false);
    }
    this.isSelecting = isSelecting;
    stage.element.classList.toggle("dnb-ed-selecting", isSelecting);
    if (isSelecting) messages.hint("Drag a band around points, or tap one after the other. Esc when done", 4000);
    frames.invalidate();
  }

  /** The active tool; undefined for none. */
  get activeTool(): HeldTool | undefined {
    const { pen, brush, wand, window } = this.editor.tools;
    return [pen, brush, wand, window].find(({ isOn }) => isOn);
  }

  /** What to do next in this mode; "" where nothing is special. */
  get advice() {
    if (this.isSelecting) return "Drag a band, or tap points; a second tap takes one out; Esc ends";
    if (this.isAdding) return "Press on a feature and drag it, or click to set a point; Esc ends";
    return this.activeTool?.advice ?? "";
  }

  /** Cancel the pen's drawing, or switch the active tool off; false where there is none. */
  cancelTool() {
    const { pen, brush, wand, window } = this.editor.tools;
    return pen.cancel() || brush.stop() || window.stop() || wand.stop();
  }

  /** Switch off the pen, the brush, the wand, and the tool of the window. */
  deactivateTools() {
    const { pen, brush, window, wand } = this.editor.tools;
    for (const tool of [pen, brush, window, wand]) tool.stop();
  }

  /** False if neither was on. */
  stopModes() {
    const was = this.isAdding || this.isSelecting;
    this.setAdding(false);
    this.setSelecting(false);
    return was;
  }

  /**
   * Switch the pen on, or off if it is drawing this already.
   * @param tool a name of PEN_WORDS
   */
  setPen(tool: string) {
    const { frames, points, stage, tools } = this.editor,
      was = tools.pen.draft?.tool;
    this.deactivateTools();
    if (was === tool || points.isLocked) {
      frames.invalidate();
      return;
    }
    this.stopModes();
    tools.shapes.choice.choose(null);
    tools.shapes.dropOffer();
    tools.pen.start(tool);
    stage.focus();
  }

  /** Switch a brush on or off. */
  setBrush(tool: string) {
    const { points, stage, tools } = this.editor,
      was = tools.brush.tool;
    this.deactivateTools();
    if (was === tool || points.isLocked) return;
    this.stopModes();
    tools.shapes.choice.choose(null);
    points.select([]);
    tools.brush.start(tool);
    stage.focus();
  }

  /** Move the focus to the list of keys, and back to where it was. */
  toggleHelp() {
    this.editor.panels.help.toggle();
    this.editor.frames.invalidate();
  }

  /** Show the grid, also before the first edit, or hide it. */
  toggleGrid() {
    const {
        frames,
        layers: { grid },
        model,
      } = this.editor,
      isAwaited = model.get("show_grid") && grid.isWaiting;
    grid.isWanted = isAwaited || !model.get("show_grid");
    if (isAwaited) frames.invalidate();
    else setTrait(model, "show_grid", !model.get("show_grid"));
  }

  /** False if the list of keys was not open. */
  closeHelp() {
    if (!this.editor.panels.help.isOpen) return false;
    this.toggleHelp();
    return true;
  }
}
