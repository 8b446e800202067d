// The commands of the toolbar and of keys in the editor in space.

import type { EditorCommands } from "../editor/base.ts";
import { OVERLAYS } from "../editor/overlays.ts";
import { freeIds, renamePoint, resetPoints, togglePoints } from "../maths/points.ts";
import { flatPoint } from "../maths/space.ts";
import { setTrait } from "../sync/edits.ts";
import type { SpacePane } from "./pane.ts";
import type { SpaceParts } from "./parts.ts";

/** Dependencies of the commands on the editor. */
export type SpaceCommandEditor = SpaceParts<
  | "model"
  | "messages"
  | "row"
  | "points"
  | "edits"
  | "tools"
  | "modes"
  | "cursor"
  | "requests"
  | "toolbar"
  | "names"
  | "shapes"
>;

/** Let the user name a point. */
function rename({ edits, names, points, row }: SpaceCommandEditor, id: number, pane: SpacePane) {
  const p = points.withId(id);
  if (!p || points.isLocked) return;
  const {
    target: [a, b],
  } = flatPoint(p, pane.info, null);
  const box = row.element.getBoundingClientRect(),
    stage = pane.stage.getBoundingClientRect(),
    [x, y] = pane.viewport.toView([a, b]);
  names.prompt(p.name, `point ${points.numberOf(id)}`, [stage.left - box.left + x, stage.top - box.top + y], {
    take: (text) => edits.edit(renamePoint(points.list, id, text), "rename"),
    focus: () => pane.handles.focus(id),
  });
}

type Command = (editor: SpaceCommandEditor, ids: number[], pane: SpacePane) => void;

function zoom({ row }: SpaceCommandEditor, factor: number) {
  for (const { viewport } of row.panes) viewport.zoomAt(factor);
}

/** Commands on points of these ids, in a picture. */
const COMMANDS: Record<string, Command> = {
  add: ({ modes }) => modes.setAdding(!modes.isAdding),
  select: ({ modes }) => modes.setSelecting(!modes.isSelecting),
  move: ({ modes }) => modes.setBrush("move"),
  grow: ({ modes }) => modes.setBrush("grow"),
  part: ({ modes }) => modes.setPartPen(),
  remove: ({ tools }, ids) => tools.remove(ids),
  "select-all": ({ points }) => points.select(points.list.map((p) => p.id)),
  undo: ({ points }) => points.step("undo"),
  redo: ({ points }) => points.step("redo"),
  rename: (editor, ids, pane) => {
    if (ids.length === 1) rename(editor, ids[0]!, pane);
  },
  switch: ({ points, tools }, ids) => tools.change(togglePoints(points.list, ids), "switch"),
  reset: ({ points: { list }, tools }, ids) =>
    tools.change(resetPoints(list, freeIds(list, ids.length ? ids : list.map((p) => p.id))), "reset"),
  lock: ({ tools }, ids) => tools.toggleLock(ids),
  go: ({ cursor }, ids) => {
    if (ids.length === 1) cursor.goTo(ids[0]!);
  },
  grid: ({ model }) => setTrait(model, "show_grid", !model.get("show_grid")),
  overlay: ({ model, messages }) => {
    const kind = model.get("overlay") === "none" ? "folds" : "none";
    setTrait(model, "overlay", kind);
    messages.hint(OVERLAYS[kind]!.join(": "));
  },
  compare: ({ model, requests }) => requests.look({ original: !model.get("shows_original") }),
  window: ({ requests }) => requests.look({ window: [] }),
  "zoom-in": (editor) => zoom(editor, 1.25),
  "zoom-out": (editor) => zoom(editor, 0.8),
  fit: ({ row }) => {
    for (const { viewport } of row.panes) viewport.fit();
  },
  help: ({ modes }) => modes.toggleHelp(),
  mirror: ({ tools }) => tools.toggleMirror(),
  "mirror-axis": ({ tools }) => tools.turnMirror(),
  stop: ({ model }) => setTrait(model, "stop_at_folds", !model.get("stop_at_folds")),
  snap: ({ tools }) => tools.lattice.toggle(),
  "turn-left": ({ tools }, _ids, pane) => tools.turnKey(pane, -1, { isLarge: true, isScale: false }),
  "turn-right": ({ tools }, _ids, pane) => tools.turnKey(pane, 1, { isLarge: true, isScale: false }),
};

/** Commands on the chosen rigid part, where no points are selected. */
const SHAPE_COMMANDS: Record<string, (editor: SpaceCommandEditor, pane: SpacePane) => void> = {
  remove: ({ shapes }) => shapes.remove(),
  rename: ({ shapes }, pane) => shapes.rename(pane),
  switch: ({ shapes }) => shapes.switch(),
  reset: ({ shapes }) => shapes.moves.reset(),
};

export class SpaceCommands implements EditorCommands {
  constructor(readonly editor: SpaceCommandEditor) {}

  /** @param focused the point that has the focus; null for the selection */
  run(command: string, focused: number | null) {
    const { points, row, shapes, toolbar } = this.editor,
      pane = row.paneOf(document.activeElement);
    if (focused === null && !["undo", "redo"].includes(command) && toolbar.isOff(command)) return;
    const isShape = focused === null && points.selected.size === 0 && shapes.choice.shape !== null,
      onShape = isShape ? SHAPE_COMMANDS[command] : null;
    if (onShape) onShape(this.editor, pane);
    else COMMANDS[command]?.(this.editor, points.idsAt(focused), pane);
  }
}
