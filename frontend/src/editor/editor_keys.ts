// The keys of the editor, dispatched to its tools. The keys are listed in ui/keys.ts.

import { formatLength } from "../maths/numbers.ts";
import { TURN_CODES, TURN_WAYS } from "../maths/points.ts";
import type { Vector2 } from "../types.ts";
import { ARROWS } from "../ui/dom.ts";
import { commandOf, EDITOR_KEYS, keyPlace } from "../ui/keys.ts";
import { POINT_STEPS } from "./handles.ts";
import type { ShapeGrip } from "./hit_test.ts";
import { around } from "./hit_test.ts";
import type { EditorParts } from "./parts.ts";

/** Dependencies of the keys on the editor. */
export type KeysEditor = EditorParts<
  "model" | "frames" | "messages" | "stage" | "points" | "picture" | "commands",
  "hits" | "brush" | "modes" | "gestures" | "points" | "turns" | "shapes" | "parts",
  "handles",
  "toolbar"
>;

/** Keys pressed anywhere in the editor. */
export class EditorKeys {
  constructor(readonly editor: KeysEditor) {
    const { root, closing } = editor.stage;
    root.addEventListener("keydown", (e) => editor.frames.guard(() => this.key(e)), { signal: closing.signal });
  }

  key(event: KeyboardEvent) {
    const { editor } = this,
      isThird = event.getModifierState?.("AltGraph") ?? false; // brackets of many keyboards
    const isCommand = (event.ctrlKey || event.metaKey) && !isThird,
      isAlt = event.altKey && !isThird;
    if (around(event, "input, select")) {
      // have their own keys
      if (event.key === "Escape" && event.target === editor.tools.brush.slider) {
        editor.tools.brush.stop();
        editor.stage.focus();
      }
      return;
    }
    if (!isCommand && around(event, ".dnb-ed-help")) {
      if (event.key === "Escape" || commandOf(EDITOR_KEYS, event.key) === "help") editor.tools.modes.closeHelp();
      return;
    }
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const handled = isCommand ? this.#command(key, event) : this.#plain(key, event, isAlt);
    if (!handled) return;
    event.preventDefault();
    event.stopPropagation();
  }

  #command(key: string, event: KeyboardEvent) {
    const { editor } = this,
      focused = editor.tools.hits.pointAt(event);
    if (POINT_STEPS[key] && around(event, "button")) return false;
    if (POINT_STEPS[key])
      editor.layers.handles.focusNext(
        editor.points.list.map((p) => p.id),
        POINT_STEPS[key],
        focused?.id,
      );
    else {
      const command =
        (event.shiftKey && commandOf(EDITOR_KEYS, `Control+Shift+${key}`)) || commandOf(EDITOR_KEYS, `Control+${key}`);
      if (!command) return false;
      editor.commands.run(command, null);
    }
    return true;
  }

  /** Keys on a line, a corner or the middle of an edge. */
  #shapeKey(key: string, event: KeyboardEvent, shape: ShapeGrip) {
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
    else if (isDelete && shape.middle !== null) editor.messages.hint("Here is no corner to delete yet");
    else if (isDelete && shape.corner !== null) shapeTools.removeCorner(shape.corner);
    else if (command) editor.commands.run(command, null);
    return true;
  }

  #plain(key: string, event: KeyboardEvent, isAlt: boolean) {
    const { editor } = this,
      { gestures, hits, modes } = editor.tools,
      onButton = around(event, "button"),
      arrow = ARROWS[key];
    const focused = hits.pointAt(event),
      shape = focused ? null : hits.shapeAt(event);
    if (!onButton && !isAlt && modes.activeTool?.key(key, event, arrow)) return true;
    if ((key === "Enter" || key === " ") && hits.markAt(event) === "swap") {
      editor.tools.shapes.turn();
      return true;
    }
    if (arrow && hits.markAt(event) === "axis") return this.#axisKey(arrow, event.shiftKey ? 10 : 1);
    if (shape && !onButton && !isAlt && this.#shapeKey(key, event, shape)) return true;
    if (onButton instanceof HTMLButtonElement && arrow) return editor.panels.toolbar.focusNext(onButton, key);
    if (onButton && (key === "Enter" || key === " ")) return false;
    if (arrow) {
      editor.tools.points.nudge(focused?.id ?? null, arrow, event.shiftKey ? 10 : 1, isAlt ? "both" : "target");
      return true;
    }
    const way = TURN_WAYS[isAlt ? TURN_CODES[event.code]! : key];
    if (way && !isAlt && editor.points.selected.size === 0 && editor.tools.parts.isOn) {
      editor.tools.parts.turnKey(way, event.shiftKey);
      return true;
    }
    if (way) {
      editor.tools.turns.turnKey(way, { isLarge: event.shiftKey, isScale: isAlt });
      return true;
    }
    if (isAlt) return false;
    if (key === " ") {
      gestures.space(true);
      return true;
    }
    if (key === "PageUp" || key === "PageDown")
      return editor.picture.slices.move(key === "PageDown" ? 1 : -1, editor.points.isDragging);
    if (key === "Enter") {
      if (focused) editor.points.toggle(focused.id);
      else if (!editor.points.isLocked) editor.tools.points.addInMiddle();
      return true;
    }
    if (key === "Escape") return gestures.escape();
    const size = keyPlace(EDITOR_KEYS, "brush-radius", key);
    if (size >= 0) {
      editor.tools.brush.grow(size ? 1 : -1);
      return true;
    }
    const command = (event.shiftKey && commandOf(EDITOR_KEYS, `Shift+${key}`)) || commandOf(EDITOR_KEYS, key);
    if (!command) return false;
    editor.commands.run(command === "zoom" ? (key === "-" ? "zoom-out" : "zoom-in") : command, focused?.id ?? null);
    return true;
  }

  #axisKey(arrow: Vector2, pixels: number) {
    const { editor } = this,
      { points: pointTools } = editor.tools,
      {
        mirror: { state: mirror },
      } = pointTools,
      c = mirror.axis === "a" ? 0 : 1;
    pointTools.mirror.moveAxis(mirror.at + pixels * arrow[c] * editor.model.get("raster").spacing[c], true);
    editor.messages.announce(`axis at ${formatLength(pointTools.mirror.state.at)}`);
    return true;
  }
}
