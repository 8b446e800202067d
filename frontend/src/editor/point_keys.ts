// Keys on control points: arrows move and turn them, Enter selects or adds one.

import { TURN_CODES, TURN_WAYS } from "../maths/points.ts";
import { ARROWS } from "../ui/dom.ts";
import type { EditorParts } from "./parts.ts";

/** Dependencies of the keys on the editor. */
export type PointKeysEditor = EditorParts<"points", "points" | "turns" | "parts", "handles">;

export class PointKeys {
  constructor(readonly editor: PointKeysEditor) {}

  /** Move the focus to another point. */
  focusNext(step: number, focused: number | undefined) {
    const { layers, points } = this.editor;
    layers.handles.focusNext(
      points.list.map((p) => p.id),
      step,
      focused,
    );
  }

  /**
   * Handle a key; returns whether it is one of points.
   * @param focused the point that has the focus
   */
  press(event: KeyboardEvent, key: string, focused: number | null, isAlt: boolean) {
    const { points, tools } = this.editor,
      arrow = ARROWS[key],
      way = TURN_WAYS[isAlt ? TURN_CODES[event.code]! : key];
    if (arrow) tools.points.nudge(focused, arrow, event.shiftKey ? 10 : 1, isAlt ? "both" : "target");
    else if (way && !isAlt && points.selected.size === 0 && tools.parts.isOn) tools.parts.turnKey(way, event.shiftKey);
    else if (way) tools.turns.turnKey(way, { isLarge: event.shiftKey, isScale: isAlt });
    else if (key === "Enter" && !isAlt) {
      if (focused !== null) points.toggle(focused);
      else if (!points.isLocked) tools.points.addInMiddle();
    } else return false;
    return true;
  }
}
