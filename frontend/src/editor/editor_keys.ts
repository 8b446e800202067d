// The keys of the editor, dispatched to its tools. The keys are listed in ui/keys.ts.

import { ARROWS } from "../ui/dom.ts";
import { commandOf, EDITOR_KEYS, keyPlace } from "../ui/keys.ts";
import { POINT_STEPS } from "./handles.ts";
import { around } from "./hit_test.ts";
import type { EditorParts } from "./parts.ts";

/** Dependencies of the keys on the editor. */
export type KeysEditor = EditorParts<
  "points" | "picture" | "commands",
  "hits" | "brush" | "modes" | "gestures" | "grips" | "shapeKeys" | "pointKeys",
  never,
  "toolbar"
>;

/** Keys pressed anywhere in the editor. */
export class EditorKeys {
  constructor(readonly editor: KeysEditor) {}

  press(event: KeyboardEvent) {
    const { editor } = this,
      isThird = event.getModifierState?.("AltGraph") ?? false; // brackets of many keyboards
    const isCommand = (event.ctrlKey || event.metaKey) && !isThird,
      isAlt = event.altKey && !isThird;
    if (around(event, "input, select")) return; // have their own keys
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
    if (POINT_STEPS[key]) editor.tools.pointKeys.focusNext(POINT_STEPS[key], focused?.id);
    else {
      const command =
        (event.shiftKey && commandOf(EDITOR_KEYS, `Control+Shift+${key}`)) || commandOf(EDITOR_KEYS, `Control+${key}`);
      if (!command) return false;
      editor.commands.run(command, null);
    }
    return true;
  }

  #plain(key: string, event: KeyboardEvent, isAlt: boolean) {
    const { editor } = this,
      { gestures, grips, hits, modes, pointKeys, shapeKeys } = editor.tools,
      onButton = around(event, "button"),
      arrow = ARROWS[key];
    const focused = hits.pointAt(event),
      shape = focused ? null : hits.shapeAt(event);
    if (!onButton && !isAlt && modes.activeTool?.key(key, event, arrow)) return true;
    if (grips.key(hits.markAt(event), event, arrow)) return true;
    if (shape && !onButton && !isAlt && shapeKeys.press(key, event, shape)) return true;
    if (onButton instanceof HTMLButtonElement && arrow) return editor.panels.toolbar.focusNext(onButton, key);
    if (onButton && (key === "Enter" || key === " ")) return false;
    if (pointKeys.press(event, key, focused?.id ?? null, isAlt)) return true;
    if (isAlt) return false;
    if (key === " ") {
      gestures.space(true);
      return true;
    }
    if (key === "PageUp" || key === "PageDown")
      return editor.picture.slices.move(key === "PageDown" ? 1 : -1, editor.points.isDragging);
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
}
