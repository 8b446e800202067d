// The tools of the editor in space for the same points in a view of the volume: mirror, lattice and locks work there as
// on the slices.

import type { EditorTools, Vector2, Vector3 } from "../types.ts";
import { spaceKey } from "./keys.ts";
import type { SpaceParts } from "./parts.ts";

/** Dependencies of the tools for views on the editor. */
export type SpaceViewEditor = SpaceParts<
  "messages" | "row" | "points" | "edits" | "tools" | "brush" | "modes" | "cursor" | "commands" | "toolbar" | "shapes"
>;

export function spaceViewTools(editor: SpaceViewEditor): EditorTools {
  const { brush, edits, modes, tools } = editor;
  return {
    get hasTool() {
      return brush.isOn;
    },
    get radius() {
      return brush.isOn ? brush.radius : 0;
    },
    get isAdding() {
      return modes.isAdding;
    },
    begin() {
      edits.beginDrag();
      return edits.drag0 !== null;
    },
    move: (ids, way, what, id, isLoose) => tools.dragInSpace(ids, way as Vector3, what, id, isLoose),
    end: (isCancelled) => edits.endDrag(isCancelled),
    add: (place) => tools.addPlace(tools.lattice.nodeAt(place as Vector3), null),
    remove: (ids) => tools.remove(ids),
    nudge: (ids, way) => tools.nudgePoints(ids, way as Vector3),
    press(place) {
      brush.begin(place as Vector3);
      if (!brush.stroke) return null;
      let from: Vector2 | null = null;
      return {
        move(at, { clientX, clientY }) {
          from ??= [clientX, clientY];
          brush.follow(at as Vector3, clientX - from[0] + from[1] - clientY);
        },
        end: (isCancelled) => brush.lift(isCancelled),
      };
    },
    key: (event) => spaceKey(editor, event),
  };
}
