// The commands of the toolbar and of keys.

import { setTrait } from "../sync/edits.ts";
import type { EditorCommands } from "./base.ts";
import type { EditorParts } from "./parts.ts";

/** Dependencies of the commands on the editor. */
export type CommandEditor = EditorParts<
  "model" | "picture" | "points" | "viewport",
  "modes" | "points" | "turns" | "shapes" | "wand" | "window",
  "overlay",
  "toolbar"
>;

/** Switch a trait that is true or false. */
function toggle({ model }: CommandEditor, name: string) {
  setTrait(model, name, !model.get(name));
}

/** Commands of the toolbar and of keys; `ids` are the points that they are about. */
const COMMANDS: Record<string, (editor: CommandEditor, ids: number[]) => void> = {
  add: (editor) => editor.tools.modes.setAdding(!editor.tools.modes.isAdding),
  select: (editor) => editor.tools.modes.setSelecting(!editor.tools.modes.isSelecting),
  remove: (editor, ids) => editor.tools.points.remove(ids),
  rename: (editor, ids) => {
    if (ids.length === 1) editor.tools.points.rename(ids[0]!);
  },
  switch: (editor, ids) => editor.tools.points.switch(ids),
  reset: (editor, ids) => editor.tools.points.reset(ids),
  lock: (editor, ids) => editor.tools.points.toggleLock(ids),
  "select-all": (editor) => editor.points.select(editor.points.list.map((p) => p.id)),
  undo: (editor) => editor.points.step("undo"),
  redo: (editor) => editor.points.step("redo"),
  move: (editor) => editor.tools.modes.setBrush("move"),
  grow: (editor) => editor.tools.modes.setBrush("grow"),
  cut: (editor) => editor.tools.modes.setPen("cut"),
  part: (editor) => editor.tools.modes.setPen("part"),
  fixed: (editor) => editor.tools.modes.setPen("fixed"),
  straighten: (editor) => editor.tools.modes.setPen("straighten"),
  hinge: (editor) => editor.tools.modes.setPen("hinge"),
  mirror: (editor) => editor.tools.points.mirror.toggle(),
  "mirror-axis": (editor) => editor.tools.points.mirror.turn(),
  snap: (editor) => editor.tools.points.snap.toggle(),
  stop: (editor) => toggle(editor, "stop_at_folds"),
  "turn-left": (editor) => editor.tools.turns.turnKey(-1, { isLarge: true, isScale: false }),
  "turn-right": (editor) => editor.tools.turns.turnKey(1, { isLarge: true, isScale: false }),
  grid: (editor) => editor.tools.modes.toggleGrid(),
  radius: (editor) => toggle(editor, "show_radius"),
  overlay: (editor) => editor.layers.overlay.next(),
  compare: (editor) => editor.picture.toggleComparing(),
  "zoom-in": (editor) => editor.viewport.zoomAt(1.25),
  "zoom-out": (editor) => editor.viewport.zoomAt(0.8),
  fit: (editor) => editor.viewport.toggleFit(),
  window: (editor) => editor.tools.window.toggle(),
  wand: (editor) => editor.tools.wand.toggle(),
  help: (editor) => editor.tools.modes.toggleHelp(),
};

/** The same where a shape is chosen. */
const SHAPE_COMMANDS: Record<string, (shapes: CommandEditor["tools"]["shapes"]) => void> = {
  remove: (shapes) => shapes.remove(),
  rename: (shapes) => shapes.rename(),
  switch: (shapes) => shapes.switch(),
  turn: (shapes) => shapes.turn(),
};

export class Commands implements EditorCommands {
  constructor(readonly editor: CommandEditor) {}

  /** @param focused the point that has the focus; null for the selection */
  run(command: string, focused: number | null) {
    const { panels, points, tools } = this.editor,
      ids = points.idsAt(focused);
    // Check the history for a step; the toolbar receives an edit a moment later.
    if (focused === null && !["undo", "redo"].includes(command) && panels.toolbar.isOff(command)) return;
    if (tools.shapes.choice.chosen && focused === null && ids.length === 0 && SHAPE_COMMANDS[command]) {
      if (!points.isLocked) SHAPE_COMMANDS[command](tools.shapes);
    } else COMMANDS[command]?.(this.editor, ids);
  }
}
