// The tools of the editor in space for the same points in a view of the volume: mirror, lattice and locks work there as
// on the slices.

import type { EditorTools, Vector3 } from "../types.ts";
import { spaceKey } from "./keys.ts";
import type { SpaceParts } from "./parts.ts";

/** Dependencies of the tools for views on the editor. */
export type SpaceViewEditor = SpaceParts<
  "messages" | "row" | "points" | "edits" | "tools" | "modes" | "cursor" | "commands" | "toolbar"
>;

export function spaceViewTools(editor: SpaceViewEditor): EditorTools {
  const { edits, modes, tools } = editor;
  return {
    hasTool: false,
    radius: 0,
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
    press: () => null,
    key: (event) => spaceKey(editor, event),
  };
}
