// Keys on a shape: its line, a corner, the middle of an edge, or a handle of its motion.

import { TURN_WAYS } from "../maths/points.ts";
import { ARROWS } from "../ui/dom.ts";
import { commandOf, EDITOR_KEYS } from "../ui/keys.ts";
import type { ShapeGrip } from "./hit_test.ts";
import type { EditorParts } from "./parts.ts";

/** Dependencies of the keys on the editor. */
export type ShapeKeysEditor = EditorParts<"messages" | "points" | "commands", "shapes" | "parts">;

export class ShapeKeys {
  constructor(readonly editor: ShapeKeysEditor) {}

  /** Handle a key; returns whether it is one of the shape. */
  press(key: string, event: KeyboardEvent, shape: ShapeGrip) {
    const { editor } = this,
      { shapes: shapeTools } = editor.tools,
      arrow = ARROWS[key],
      command = commandOf(EDITOR_KEYS, key);
    const isOther = JSON.stringify(shape.chosen) !== JSON.stringify(shapeTools.choice.chosen);
    const isDelete = command === "remove",
      way = TURN_WAYS[key];
    const isOutline = shape.corner !== null || shape.middle !== null;
    if (key === "Enter") {
      if (!isOther && shape.corner !== null && shapeTools.toggleStop(shape.corner)) return true;
      if (shape.middle === null) shapeTools.choice.choose(isOther || shape.corner !== null ? shape.chosen : null);
      else if (!editor.points.isLocked) shapeTools.insertCorner(shape.middle);
      return true;
    }
    if (!arrow && !isDelete && !way && !["rename", "reset", "switch", "turn"].includes(command ?? "")) return false;
    if (isOther) shapeTools.choice.choose(shape.chosen);
    if (editor.points.isLocked) return true;
    const isPart = editor.tools.parts.isOn,
      pixels = event.shiftKey ? 10 : 1;
    if ((way || command === "reset") && !isPart) return false;
    if (way) editor.tools.parts.turnKey(way, event.shiftKey);
    else if (command === "reset") editor.tools.parts.reset();
    else if (arrow && isPart && shape.handle === "turn")
      editor.tools.parts.turnKey(arrow[0] || arrow[1], event.shiftKey);
    else if (arrow && isPart && !isOutline) editor.tools.parts.nudge(arrow, pixels, shape.handle ?? "move");
    else if (arrow) shapeTools.nudge(shape, arrow, pixels);
    else if (isDelete && shape.middle !== null) editor.messages.hint("There is no corner to delete here yet");
    else if (isDelete && shape.corner !== null) shapeTools.removeCorner(shape.corner);
    else if (command) editor.commands.run(command, null);
    return true;
  }
}
