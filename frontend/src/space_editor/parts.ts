// The parts of the editor in space, and the type of those that one of them uses.

import type { EditorTheme } from "../editor/base.ts";
import type { Brush } from "../editor/brush_tool.ts";
import type { EditedPoints } from "../editor/edited_points.ts";
import type { Frames } from "../editor/frames.ts";
import type { Messages } from "../editor/messages.ts";
import type { NamePrompt } from "../editor/name_prompt.ts";
import type { Sender } from "../sync/edits.ts";
import type { Model, Vector3 } from "../types.ts";
import type { HelpPanel } from "../ui/keys.ts";
import type { Toolbar } from "../ui/toolbar.ts";
import type { SpaceCommands } from "./commands.ts";
import type { SliceCursor } from "./cursor.ts";
import type { SpaceEdits } from "./edits.ts";
import type { SpaceFoldOffers } from "./fold_offers.ts";
import type { SpaceFoldStop } from "./fold_stop.ts";
import type { SpaceModes } from "./modes.ts";
import type { PaneRow } from "./pane_row.ts";
import type { SpacePointTools } from "./point_tools.ts";
import type { PictureRequests } from "./requests.ts";
import type { SpaceShapes } from "./shapes.ts";
import type { SpaceMap } from "./space_map.ts";
import type { SpaceStatus } from "./status_line.ts";
import type { SpaceStrokes } from "./strokes.ts";

interface Parts {
  model: Model;
  sender: Sender<Vector3>;
  messages: Messages;
  frames: Frames;
  theme: EditorTheme;
  /** Its pictures, and the marks over them. */
  row: PaneRow;
  points: EditedPoints<Vector3>;
  edits: SpaceEdits;
  /** The map of the points, as far as it is known here. */
  map: SpaceMap;
  tools: SpacePointTools;
  brush: Brush<Vector3>;
  strokes: SpaceStrokes;
  modes: SpaceModes;
  shapes: SpaceShapes;
  foldStop: SpaceFoldStop;
  foldOffers: SpaceFoldOffers;
  /** The place at which the slices meet. */
  cursor: SliceCursor;
  requests: PictureRequests;
  commands: SpaceCommands;
  toolbar: Toolbar;
  names: NamePrompt;
  help: HelpPanel;
  status: SpaceStatus;
}

/** The parts that one of them uses. */
export type SpaceParts<Part extends keyof Parts = keyof Parts> = Pick<Parts, Part>;
