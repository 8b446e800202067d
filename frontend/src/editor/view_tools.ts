// The tools of the editor of a picture for the same points in a view of the volume: mirror, grid, rigid parts, the stop
// at folds, brushes and pens work there as on the picture. Places of the view come projected on the picture's plane.

import { translatePoints } from "../maths/points.ts";
import type { Bus, EditorTools, Vector, Vector2 } from "../types.ts";
import { slackOf } from "../ui/dom.ts";
import type { EditorParts } from "./parts.ts";

/** Dependencies of the tools for views on the editor. */
export type ViewToolsEditor = EditorParts<"viewport" | "points", "modes" | "points" | "drag" | "brush" | "keys">;

/** Offer the tools of an editor to the views in its window until a signal. */
export function offerTools(bus: Bus, tools: EditorTools, signal: AbortSignal) {
  bus.tools = [...(bus.tools ?? []), tools];
  signal.addEventListener("abort", () => {
    bus.tools = bus.tools?.filter((other) => other !== tools);
  });
}

export function pictureViewTools({ points, tools, viewport }: ViewToolsEditor): EditorTools {
  const { brush, drag, keys, modes } = tools,
    toView = (at: Vector) => viewport.toView(at as Vector2);
  return {
    get isAdding() {
      return modes.isAdding;
    },
    get hasTool() {
      return modes.activeTool !== undefined;
    },
    get radius() {
      return brush.isOn ? brush.radius : 0;
    },
    begin: () => drag.beginDrag(),
    move(ids, way, what, id, isLoose) {
      drag.translate(ids, way as Vector2, what, id, isLoose);
      drag.sendMove();
    },
    end: (isCancelled) => drag.endDrag(isCancelled),
    add: (place) => tools.points.addAt(toView(place)),
    remove: (ids) => tools.points.remove(ids),
    nudge(ids, [da, db]) {
      const before = points.list,
        free = tools.points.movableIds(ids);
      tools.points.changeAsFar(
        (share) => translatePoints(before, free, share * da, share * db, "target"),
        "nudge",
        `nudge ${ids}`,
      );
    },
    press(place, isFinger) {
      const gesture = modes.activeTool?.grab(toView(place), isFinger) ?? null;
      if (!gesture) return null;
      return {
        move: (at, event) => gesture.move(toView(at), slackOf(event.pointerType), event),
        end: (isCancelled) => gesture.end(isCancelled, gesture.at),
      };
    },
    key(event) {
      keys.press(event);
      return event.defaultPrevented;
    },
  };
}
