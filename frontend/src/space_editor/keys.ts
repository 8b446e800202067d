// The keys of the editor in space, dispatched to its parts. The keys are listed in ui/keys.ts.

import { POINT_STEPS } from "../editor/handles.ts";
import { shapeGrip } from "../editor/hit_test.ts";
import { added, scaled } from "../maths/camera.ts";
import { formatLength } from "../maths/numbers.ts";
import { TURN_CODES, TURN_WAYS } from "../maths/points.ts";
import { vectorFromPane } from "../maths/space.ts";
import type { Vector2 } from "../types.ts";
import { ARROWS, targetOf } from "../ui/dom.ts";
import { commandOf, keyPlace, SPACE_EDITOR_KEYS } from "../ui/keys.ts";
import type { SpacePane } from "./pane.ts";
import type { SpaceParts } from "./parts.ts";

/** Dependencies of the keys on the editor. */
export type SpaceKeysEditor = SpaceParts<
  "messages" | "row" | "points" | "tools" | "brush" | "modes" | "cursor" | "commands" | "toolbar" | "shapes"
>;

/** Run the command of a key anywhere in the editor; returns whether there is one. */
export function spaceKey(editor: SpaceKeysEditor, event: KeyboardEvent) {
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key,
    isCommand = event.ctrlKey || event.metaKey;
  const target = targetOf(event),
    { brush, cursor, modes, points, tools } = editor,
    fast = event.shiftKey ? 10 : 1;
  if (target.closest("input[type=text], select")) return false; // have their own keys
  const onButton = target.closest("button"),
    pane = editor.row.paneOf(target);
  const focused = target.closest("[data-id]"),
    id = focused ? Number(focused.getAttribute("data-id")) : null;
  if (isCommand && POINT_STEPS[key] && !onButton) {
    return pane.handles.focusNext(
      points.list.map((p) => p.id),
      POINT_STEPS[key],
      id,
    );
  }
  if (isCommand) return spaceCommand(editor, key, event.shiftKey);
  if (target.closest("input[type=range]")) return false;
  if (onButton && key in ARROWS) return editor.toolbar.focusNext(onButton, key);
  if (onButton && (key === "Enter" || key === " ")) return false;
  if (key in ARROWS && target.closest("[data-mark]")) return mirrorKey(editor, pane, ARROWS[key]!, fast);
  if (!onButton && !event.altKey && brush.isOn && brush.key(key, event, ARROWS[key])) return true;
  if (!onButton && editor.shapes.pen.isOn && editor.shapes.pen.key(key)) return true;
  if (!onButton && partKey(editor, pane, key, event)) return true;
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
    else cursor.scroll(pane.info, by);
    return true;
  }
  if (event.altKey) return false;
  if (key === " ") {
    modes.isSpaceDown = true;
    return true;
  }
  if (key === "Enter") {
    if (id === null) tools.addPlace(cursor.place, pane);
    else points.toggle(id);
    return true;
  }
  if (key === "Escape") return modes.escape();
  const size = keyPlace(SPACE_EDITOR_KEYS, "brush-radius", key);
  if (size >= 0) {
    brush.grow(size ? 1 : -1);
    return true;
  }
  const command = (event.shiftKey && commandOf(SPACE_EDITOR_KEYS, `Shift+${key}`)) || commandOf(SPACE_EDITOR_KEYS, key);
  if (!command) return false;
  editor.commands.run(command === "zoom" ? (key === "-" ? "zoom-out" : "zoom-in") : command, id);
  return true;
}

/** A key on a rigid part or on a handle of its motion; returns whether it is one of the part. */
function partKey({ points, shapes }: SpaceKeysEditor, pane: SpacePane, key: string, event: KeyboardEvent) {
  const grip = shapeGrip(event, shapes.choice.chosen),
    arrow = ARROWS[key],
    way = TURN_WAYS[key],
    isLarge = event.shiftKey,
    { moves } = shapes;
  if (!grip || event.altKey) return false;
  if (key === "Enter") {
    const { chosen } = shapes.choice;
    shapes.choice.choose(chosen?.what === grip.chosen.what && chosen.index === grip.chosen.index ? null : grip.chosen);
    return true;
  }
  if (!arrow && !way) return false;
  shapes.choice.choose(grip.chosen);
  if (points.isLocked || !moves.isOn) return true;
  moves.enter(pane);
  if (way) moves.turnKey(way, isLarge);
  else if (grip.handle === "turn") moves.turnKey(arrow![0] || arrow![1], isLarge);
  else moves.nudge(arrow!, isLarge ? 10 : 1, grip.handle ?? "move");
  return true;
}

/** Move the plane of the mirror by voxels of a picture perpendicular to it. */
function mirrorKey(editor: SpaceKeysEditor, pane: SpacePane, [dx, dy]: Vector2, voxels: number) {
  const {
      info,
      info: {
        spacing: [du, dv],
      },
    } = pane,
    { tools } = editor,
    { at, normal } = tools.mirror;
  const way = vectorFromPane(info, dx * voxels * du, dy * voxels * dv);
  tools.moveMirror(added(scaled(normal, at), way), true);
  editor.messages.announce(`mirror at ${formatLength(tools.mirror.at)}`);
  return true;
}

function spaceCommand({ commands }: SpaceKeysEditor, key: string, isShift: boolean) {
  const command =
    (isShift && commandOf(SPACE_EDITOR_KEYS, `Control+Shift+${key}`)) || commandOf(SPACE_EDITOR_KEYS, `Control+${key}`);
  if (!command) return false;
  commands.run(command, null);
  return true;
}
