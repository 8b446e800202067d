// The parts of the editor of a picture, and the type of those that one of them uses.

import type { Sender } from "../sync/edits.ts";
import type { Bus, Model, PicturePoint, Vector2 } from "../types.ts";
import type { HelpPanel } from "../ui/keys.ts";
import type { Toolbar } from "../ui/toolbar.ts";
import type { EditorTheme } from "./base.ts";
import type { BendTools } from "./bend_tools.ts";
import type { BoxWarning } from "./box_warning.ts";
import type { Brush } from "./brush_tool.ts";
import type { Clicks } from "./clicks.ts";
import type { ColourBar } from "./colour_bar.ts";
import type { Commands } from "./commands.ts";
import type { CutBar } from "./cut_bar.ts";
import type { EditedMap } from "./edited_map.ts";
import type { EditedPoints } from "./edited_points.ts";
import type { EditorKeys } from "./editor_keys.ts";
import type { FoldOffers } from "./fold_offers.ts";
import type { FoldStop } from "./fold_stop.ts";
import type { Frames } from "./frames.ts";
import type { GridLayer } from "./grid_layer.ts";
import type { GridNodes } from "./grid_nodes.ts";
import type { Handles, ToolMarks } from "./handles.ts";
import type { HitTest } from "./hit_test.ts";
import type { MarkGrips } from "./mark_grips.ts";
import type { Messages } from "./messages.ts";
import type { Modes } from "./modes.ts";
import type { NamePrompt } from "./name_prompt.ts";
import type { OtherWindows } from "./others.ts";
import type { Ghost, Overlay } from "./overlays.ts";
import type { PartTools } from "./part_tools.ts";
import type { PointDrag } from "./point_drag.ts";
import type { PointKeys } from "./point_keys.ts";
import type { PointStrokes } from "./point_strokes.ts";
import type { PointTools } from "./point_tools.ts";
import type { PointTurns } from "./point_turns.ts";
import type { Gestures } from "./pointer.ts";
import type { Presses } from "./presses.ts";
import type { ShapeKeys } from "./shape_keys.ts";
import type { Pen, ShapeTools } from "./shape_tools.ts";
import type { ShownPicture } from "./shown_picture.ts";
import type { Stage } from "./stage.ts";
import type { StatusLine } from "./status_line.ts";
import type { Viewport } from "./viewport.ts";
import type { Wand } from "./wand_tool.ts";
import type { Wheel } from "./wheel.ts";
import type { WindowTool } from "./window_tool.ts";

/** Tools that edit points and shapes, and change the view. */
export interface Tools {
  modes: Modes;
  points: PointTools;
  drag: PointDrag;
  others: OtherWindows;
  turns: PointTurns;
  strokes: PointStrokes;
  shapes: ShapeTools;
  parts: PartTools;
  bends: BendTools;
  foldStop: FoldStop;
  foldOffers: FoldOffers;
  pen: Pen;
  brush: Brush<Vector2>;
  wand: Wand;
  window: WindowTool;
  hits: HitTest;
  grips: MarkGrips;
  clicks: Clicks;
  presses: Presses;
  gestures: Gestures;
  wheel: Wheel;
  keys: EditorKeys;
  shapeKeys: ShapeKeys;
  pointKeys: PointKeys;
}

/** Layers over the picture. */
export interface Layers {
  grid: GridLayer;
  ghost: Ghost;
  overlay: Overlay;
  handles: Handles<PicturePoint>;
  marks: ToolMarks;
  nodes: GridNodes;
}

/** Elements around the picture, and the bars in it. */
export interface Panels {
  toolbar: Toolbar;
  names: NamePrompt;
  help: HelpPanel;
  status: StatusLine;
  box: BoxWarning;
  cut: CutBar;
  colours: ColourBar;
}

/** The parts of an editor. Each of them gets those that its own interface names. */
export interface Parts {
  model: Model;
  bus: Bus;
  sender: Sender<Vector2>;
  messages: Messages;
  frames: Frames;
  theme: EditorTheme;
  commands: Commands;
  stage: Stage;
  viewport: Viewport;
  points: EditedPoints<Vector2>;
  map: EditedMap;
  picture: ShownPicture;
  tools: Tools;
  layers: Layers;
  panels: Panels;
}

/** The parts, tools, layers and panels that a part uses of the editor. */
export type EditorParts<
  Part extends keyof Parts,
  Tool extends keyof Tools = never,
  Layer extends keyof Layers = never,
  Panel extends keyof Panels = never,
> = Pick<Parts, Part> & { tools: Pick<Tools, Tool>; layers: Pick<Layers, Layer>; panels: Pick<Panels, Panel> };
