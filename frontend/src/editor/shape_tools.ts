// The editor's tools for cuts, rigid parts and fixed sides: the pen that draws them, and edits of existing ones.

import { LONGEST_KIND } from "../generated.ts";
import { sidesKey } from "../maths/cuts.ts";
import { formatLength } from "../maths/numbers.ts";
import { labelOf, numberOf } from "../maths/point_names.ts";
import { cleanShapes, middleOf, sameShapes, updatePoints } from "../maths/points.ts";
import { regionFault } from "../maths/regions.ts";
import { findConflicts } from "../maths/rigid_stages.ts";
import {
  cornersOf,
  insertCorner,
  inverseDirection,
  isOutline,
  MOST_SHAPES,
  motionOf,
  moveCorner,
  movePlace,
  oppositeHalfPlane,
  removeCorner,
  SHAPE_NAMES,
  setStop,
  shapeLabel,
  shapeName,
  simplifyPath,
  stopsAt,
  swapRegionSides,
  translateRegion,
  updateShape,
} from "../maths/shapes.ts";
import { MOST_CHARACTERS } from "../sync/edits.ts";
import type { PartData, PicturePoint, RegionData, ShapeData, ShapeKind, Shapes, Vector2, Vector4 } from "../types.ts";
import { PenGesture } from "./gestures.ts";
import type { EditorParts } from "./parts.ts";
import { ShapeEdits } from "./shape_edits.ts";
import type { Draft, Grip } from "./shape_handles.ts";
import { namePlace, REGION_MARKS, ShapeHandles } from "./shape_handles.ts";
/** `shown`: places before the stroke under way. */
export type PenDraft = Draft & { isSet: boolean; canClose: boolean; shown?: number };

/** The lists before a drag, the region, its corner that is dragged if it is one, and where that was. */
export type ShapeDrag = { shapes: Shapes; region: RegionData; corner: number | null; at: Vector2; wasFine: boolean };

const PEN_HINTS: Record<string, string> = {
  cut: "Click along the cut or draw it; Enter or a double-click ends it",
  part: "Click or draw around what stays rigid; Enter or a double-click ends it",
  straighten: "Draw or click along the middle of what is bent, from end to end; Enter ends it",
  hinge: "Drag from the joint to the end of the side that turns; or click both",
  fixed: "Draw a line: its hatched side stays fixed; the arrows on it swap the sides",
};
export const PEN_WORDS: Record<string, string> = {
  cut: "cut",
  part: "rigid part",
  fixed: "fixed side",
  straighten: "centre line",
  hinge: "hinge",
};
const CLOSE_HINT = "A click on its start closes it";
const OF_TWO = ["fixed", "hinge"]; // which two places determine
const CLOSE_BY = 10; // CSS pixels around the first place that close the line
const DOUBLE_CLICK = 500; // milliseconds between its presses, at most
const STROKE_ERROR = 1.6; // CSS pixels between a drawn stroke and its corners
const PEN_STEPS = [1, 10]; // CSS pixels of an arrow key with and without Shift: a user of the keys draws coarsely

/** Dependencies of the pen on the editor. */
export type PenEditor = EditorParts<
  "frames" | "messages" | "stage" | "viewport" | "points" | "picture",
  "shapes" | "bends"
>;

/** The pen that draws an outline: places are clicked one by one, drawn in one stroke, or set by keys. */
export class Pen {
  readonly advice = "Backspace removes the last place, Esc cancels";
  /** Where and when a pointer has ended a line, in CSS pixels and milliseconds. */
  ended: { at: Vector2; time: number } | null = null;
  draft: PenDraft | null = null;
  /** Places of a stroke from where the pointer went down. */
  stroke: Vector2[] | null = null;

  constructor(readonly editor: PenEditor) {}

  get isOn() {
    return this.draft !== null;
  }

  /** Whether a double click at a place is still that which has ended a line: its first press did. */
  hasEndedAt([x, y]: Vector2) {
    const { at, time } = this.ended ?? { at: [x, y], time: -Infinity };
    return performance.now() - time < DOUBLE_CLICK && Math.hypot(x - at[0], y - at[1]) < CLOSE_BY;
  }

  /** @param tool a name of PEN_WORDS */
  start(tool: string) {
    const { editor } = this;
    this.stroke = null;
    this.draft = { tool, places: [], next: null, isByKeys: false, isSet: false, canClose: false };
    editor.stage.element.classList.add("dnb-ed-drawing");
    editor.messages.hint(PEN_HINTS[tool]!, 12000);
    editor.messages.announce(
      `Drawing a ${PEN_WORDS[tool]}: arrows move the pen, Enter sets a place, Enter again ends, Escape cancels`,
    );
    editor.frames.invalidate();
  }

  stop() {
    if (!this.draft) return false;
    this.draft = null;
    this.stroke = null;
    this.editor.stage.element.classList.remove("dnb-ed-drawing");
    this.editor.messages.hideHint([...Object.values(PEN_HINTS), CLOSE_HINT]);
    this.editor.frames.invalidate();
    return true;
  }

  cancel() {
    const was = this.stop();
    if (was) this.editor.messages.announce("drawing cancelled");
    return was;
  }

  // ---- the pointer --------------------------------------------------------------------------------------------------

  /** CSS pixels between a place of the picture and one of the view. */
  #gap(place: Vector2, at: Vector2) {
    const [x, y] = this.editor.viewport.toView(place);
    return Math.hypot(x - at[0], y - at[1]);
  }

  grab(at: Vector2) {
    return new PenGesture(at, this);
  }

  hover(at: Vector2) {
    const { draft } = this;
    if (!draft) return;
    draft.next = this.editor.viewport.placeAt(at);
    draft.isByKeys = false;
    draft.isClosing = draft.canClose && this.#gap(draft.places[0]!, at) < CLOSE_BY;
    this.editor.frames.invalidate();
  }

  /** Continue a stroke. */
  drag(at: Vector2) {
    const { draft } = this,
      place = this.editor.viewport.placeAt(at);
    if (!draft) return;
    this.stroke ??= [];
    this.stroke.push(place);
    draft.next = null;
    draft.shown ??= draft.places.length;
    draft.places.push(place);
    this.editor.frames.invalidate();
  }

  /** End a stroke or a click. */
  up(from: Vector2, at: Vector2) {
    const { draft, stroke } = this;
    if (!draft) return;
    if (stroke) this.#endStroke(draft, stroke, from, at);
    else this.click(at);
    if (!this.draft) this.ended = { at, time: performance.now() };
  }

  #endStroke(draft: PenDraft, stroke: Vector2[], from: Vector2, at: Vector2) {
    const { editor } = this;
    this.stroke = null;
    const before = draft.places.slice(0, draft.shown),
      isWhole = before.length === 0;
    const all = [editor.viewport.placeAt(from), ...stroke],
      isNear = this.#gap(all[0]!, at) < 2 * CLOSE_BY;
    draft.shown = undefined;
    const path = OF_TWO.includes(draft.tool)
      ? [all[0]!, all[all.length - 1]!]
      : simplifyPath(all, STROKE_ERROR / editor.viewport.view.k);
    const isClosed = draft.tool === "part" || (draft.tool === "cut" && path.length > 3 && isNear);
    draft.places = [...before, ...(isWhole && isClosed && isNear ? path.slice(0, -1) : path)];
    this.#count(draft);
    if (isWhole && !this.finish(isClosed)) {
      draft.places = before;
      this.#count(draft);
    }
    editor.frames.invalidate();
  }

  click(at: Vector2) {
    const { draft } = this;
    if (!draft) return;
    const { places } = draft,
      last = places[places.length - 1];
    if (draft.canClose && this.#gap(places[0]!, at) < CLOSE_BY) {
      this.finish(true);
      return;
    }
    if (last && this.#gap(last, at) < 3) return; // the second press of a double-click
    this.#set(draft, this.editor.viewport.placeAt(at));
  }

  #set(draft: PenDraft, place: Vector2) {
    draft.places.push(place);
    draft.isSet = true;
    this.#count(draft);
    if (OF_TWO.includes(draft.tool) && draft.places.length === 2) this.finish(false);
    this.editor.frames.invalidate();
  }

  #count(draft: PenDraft) {
    const could = draft.canClose;
    draft.canClose = ["cut", "part"].includes(draft.tool) && draft.places.length > 2;
    if (draft.canClose && !could) this.editor.messages.hint(CLOSE_HINT, 6000);
  }

  // ---- keys ---------------------------------------------------------------------------------------------------------

  /**
   * Handle a key; returns whether the pen uses it.
   * @param arrow the direction of an arrow key
   */
  key(key: string, event: KeyboardEvent, arrow?: Vector2) {
    const { draft, editor } = this;
    if (!draft) return false;
    if (key === "Escape") {
      this.cancel();
      return true;
    }
    if (key === "Backspace" || key === "Delete") {
      draft.places.pop();
      this.#count(draft);
      editor.frames.invalidate();
      return true;
    }
    if (arrow) {
      const step = PEN_STEPS[event.shiftKey ? 0 : 1]! / editor.viewport.view.k;
      const middle = editor.viewport.placeAt([editor.viewport.view.width / 2, editor.viewport.view.height / 2]);
      const from = draft.next ?? draft.places[draft.places.length - 1] ?? middle;
      const next = from.map((v, c) => v + step * arrow[c]!);
      Object.assign(draft, { next, isByKeys: true, isSet: false });
      editor.messages.announce(`pen at ${next.map(formatLength).join(", ")}`);
      editor.frames.invalidate();
      return true;
    }
    if (key !== "Enter") return false;
    if (draft.isByKeys && !draft.isSet && draft.next) {
      this.#set(draft, [...draft.next]);
      if (this.isOn) editor.messages.announce(`place ${draft.places.length} set`);
    } else this.finish(draft.tool === "part");
    return true;
  }

  // ---- the end ------------------------------------------------------------------------------------------------------

  /** Make the shape, or show why it cannot be one and continue drawing. */
  finish(isClosed: boolean) {
    const { draft, editor } = this;
    if (!draft) return false;
    const { tool, places } = draft,
      least = isClosed || tool === "part" ? 3 : 2;
    if (places.length < least) {
      editor.messages.hint(`A ${PEN_WORDS[tool]} needs ${least} places at least`, 4000);
      return false;
    }
    if (tool === "hinge" || tool === "straighten") {
      this.stop();
      if (tool === "hinge") editor.tools.bends.hinge(places[0]!, places[1]!);
      else editor.tools.bends.straighten(places);
      return true;
    }
    const region: RegionData =
      tool === "fixed"
        ? oppositeHalfPlane(places[0]!, places[1]!, movingMiddle(editor.points.list, editor.picture.box))
        : { kind: isClosed || tool === "part" ? "polygon" : "line", vertices: places };
    const fault = regionFault(region);
    if (fault) {
      editor.messages.show(fault.includes("crosses") ? `${fault} Draw it without a loop.` : fault, true);
      return false;
    }
    this.stop();
    editor.tools.shapes.add(tool === "cut" ? "cuts" : "parts", region, tool === "fixed" ? PEN_WORDS.fixed : "");
    return true;
  }
}

/** The place on the moving side: the middle of the points that were dragged, or of the picture where none was. */
function movingMiddle(points: PicturePoint[], [a0, a1, b0, b1]: Vector4): Vector2 {
  const dragged = points.filter((p) => p.active && p.target.some((value, c) => value !== p.source[c]));
  if (!dragged.length) return [(a0 + a1) / 2, (b0 + b1) / 2];
  return middleOf(dragged);
}

/**
 * Parts that wait for an answer about points that contradict them: all parts and points after the edit, and its name.
 */
export type Offer = { parts: PartData[]; points: PicturePoint[]; kind: string };

const ADD_WORDS = { cuts: "add cut", parts: "add rigid part" };

/** Dependencies of the tools on the editor. */
export type ShapeEditor = EditorParts<
  "model" | "sender" | "frames" | "messages" | "stage" | "viewport" | "points" | "map" | "picture",
  "pen" | "points",
  never,
  "names"
>;

/** Edits of the cuts and rigid parts, and the choice of one of them. */
export class ShapeTools extends ShapeEdits {
  handles: ShapeHandles;
  /** The shapes before a drag, null while there is none. */
  drag0: ShapeDrag | null = null;
  /** The edit that waits for an answer. */
  offered: Offer | null = null;

  constructor(override readonly editor: ShapeEditor) {
    super(editor);
    this.handles = new ShapeHandles(editor.stage.svg);
    editor.points.draggers.push(this);
  }

  /** The distance of the two places that turn a half plane, in units of the picture. */
  get reach() {
    const [a0, a1, b0, b1] = this.editor.picture.box;
    return Math.hypot(a1 - a0, b1 - b0) / 8;
  }

  /** Draw all shapes. True if the focus was on one that is gone. */
  draw() {
    const { editor } = this,
      regions = editor.map.layered?.regions ?? [];
    if (this.choice.chosen && !this.choice.shape) this.choice.chosen = null;
    const isLost = this.handles.update(editor.points.shapes, this.choice.chosen, editor.viewport.view, {
      reach: this.reach,
      isLocked: editor.points.isLocked,
      isBefore: editor.picture.isBefore,
      sideKey: (a, b) => sidesKey(regions, a, b),
    });
    this.handles.showDraft(editor.tools.pen.draft ?? this.#proposedDraft, editor.viewport.view);
    return isLost;
  }

  /** The mark of a point: that of the region of its source; null where no cut parts the picture. */
  markOf({ source: [a, b] }: PicturePoint) {
    const regions = this.editor.map.layered?.regions ?? [];
    return regions.length ? sidesKey(regions, a, b) % REGION_MARKS : null;
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /**
   * Replace all cuts or all parts, unless one is no shape or no fit is possible with them: then the reason is shown.
   * Where points contradict a part, the user decides what becomes of them.
   * @param kind the name of the edit
   * @param how whether a fit was possible before; the points, if they change too; edits with the same `join` in quick succession are undone as one
   */
  edit(
    what: ShapeKind,
    shapes: ShapeData[],
    kind: string,
    {
      wasFine = !this.editor.map.error,
      points = this.editor.points.list,
      join = null,
    }: { wasFine?: boolean; points?: PicturePoint[]; join?: string | null } = {},
  ) {
    const { editor } = this;
    if (editor.points.isLocked || sameShapes(shapes, editor.sender.shapes[what])) return false;
    if (shapes.length > MOST_SHAPES[what]) {
      editor.messages.show(
        `A picture takes ${MOST_SHAPES[what]} ${SHAPE_NAMES[what]}s at most; remove one first.`,
        true,
      );
      return false;
    }
    const fault = shapes.map(({ region }) => regionFault(region)).find(Boolean);
    if (fault) {
      editor.messages.show(fault, true);
      return false;
    }
    const parts = wasFine && what === "parts" ? cleanShapes(shapes, what, editor.points.shapes.parts) : [];
    if (this.#offer({ parts, points, kind })) return false;
    if (wasFine && !editor.tools.points.accepts(points, { ...editor.points.shapes, [what]: shapes })) return false;
    if (JSON.stringify(shapes).length > MOST_CHARACTERS) {
      editor.messages.show("These shapes are too large to send.", true);
      return false;
    }
    editor.sender.editShapes(what, shapes, kind.slice(0, LONGEST_KIND), points, join); // which notifies all views
    return true;
  }

  add(what: ShapeKind, region: RegionData, name = "") {
    const shape = cleanShapes([{ region, name }], what)[0]!;
    if (this.edit(what, [...this.editor.points.shapes[what], shape], ADD_WORDS[what])) this.#finishAdd(what);
    else this.editor.stage.focus();
  }

  #finishAdd(what: ShapeKind) {
    const { editor } = this,
      index = editor.points.shapes[what].length - 1,
      chosen = { what, index };
    this.choice.choose(chosen);
    editor.frames.drawNow();
    this.handles.focus(chosen);
    editor.messages.announce(`${shapeLabel(editor.points.shapes[what][index]!, what, index)}, added`);
    if (what !== "cuts") return;
    editor.messages.hint("Each side bends by its own points now: pull it open, or add points and drag", 6000);
  }

  /** Swap the sides of the chosen shape: of a fixed side the other half stays then. */
  turn() {
    const region = this.choice.shape && swapRegionSides(this.choice.shape.region);
    if (!region) {
      this.editor.messages.hint("A closed cut has only one inside");
      return;
    }
    if (this.change({ region }, "swap the sides of")) this.editor.messages.announce("sides swapped");
  }

  rename() {
    const {
      choice: { chosen, shape },
      editor,
    } = this;
    if (editor.points.isLocked || !chosen || !shape) return;
    const { what, index } = chosen,
      [x, y] = namePlace(shape.region, motionOf(shape), editor.viewport.view, this.reach);
    editor.panels.names.prompt(shape.name, shapeName({ ...shape, name: "" }, what, index), [x - 12, y + 18], {
      take: (text) => this.setName(text),
      focus: () => {
        this.handles.focus(chosen);
        return true;
      },
    });
  }

  removeCorner(k: number) {
    const region = this.choice.shape && removeCorner(this.choice.shape.region, k);
    if (!region) {
      this.remove();
      return;
    }
    if (!this.change({ region }, "change")) return;
    this.editor.frames.drawNow();
    this.handles.focusCorner(Math.min(k, region.vertices.length - 1));
    this.editor.messages.announce(`corner ${k + 1} deleted`);
  }

  /** Let the chosen cut stop at its corner k, or continue to the border; false where the corner is no end of a cut. */
  toggleStop(k: number) {
    const {
        choice: { chosen, shape },
        editor,
      } = this,
      isStop = shape && !stopsAt(shape.region, k);
    const region = shape && isStop !== null && chosen?.what === "cuts" ? setStop(shape.region, k, isStop) : null;
    if (!region || editor.points.isLocked) return false;
    if (!this.change({ region }, isStop ? "stop" : "lengthen")) return true;
    editor.frames.drawNow();
    this.handles.focusCorner(k);
    const words = isStop ? "The cut stops here" : "The cut continues to the border";
    editor.messages.hint(`${words}; a double-click on its end changes that`, 4000);
    editor.messages.announce(words);
    return true;
  }

  /** Let the chosen cut stop at both ends, or continue to the border. */
  stopAtEnds(isStop: boolean) {
    const { chosen, shape } = this.choice;
    if (chosen?.what !== "cuts" || shape?.region.kind !== "line") return;
    const { kind, vertices } = shape.region;
    if (
      this.change({ region: { kind, vertices, ...(isStop && { stops: [true, true] }) } }, isStop ? "stop" : "lengthen")
    ) {
      this.editor.messages.announce(isStop ? "The cut stops at its ends" : "The cut continues to the border");
    }
  }

  /** Insert a corner in the middle of edge k. Its number, or null if it could not be inserted. */
  insertCorner(k: number) {
    if (!this.choice.shape || !this.change({ region: splitEdge(this.choice.shape.region, k) }, "change")) return null;
    this.editor.frames.drawNow();
    this.handles.focusCorner(k + 1);
    return k + 1;
  }

  /**
   * Move a corner, or all of the shape, by so many pixels of the picture; the middle of an edge becomes a corner.
   */
  nudge(grip: Grip, [dx, dy]: Vector2, pixels: number) {
    const { editor } = this,
      [du, dv] = editor.model.get("raster").spacing;
    const [da, db] = this.#toOutline([dx * pixels * du, dy * pixels * dv]);
    const corner = grip.middle !== null ? this.insertCorner(grip.middle) : grip.corner,
      shape = this.choice.shape;
    if (!shape) return;
    if (corner === null) this.change({ region: translateRegion(shape.region, da, db) }, "move");
    else {
      const [a, b] = cornersOf(shape.region, this.reach)[corner]!;
      this.change({ region: moveCorner(shape.region, corner, [a + da, b + db], this.reach) }, "change");
    }
    editor.frames.drawNow();
  }

  /**
   * A displacement of the picture as one of the chosen shape's outline, which is where the shape was before its motion.
   */
  #toOutline(way: Vector2) {
    return this.choice.shape ? inverseDirection(motionOf(this.choice.shape), way) : way;
  }

  // ---- drags --------------------------------------------------------------------------------------------------------

  beginDrag(grip: Grip) {
    const {
      editor,
      choice: { shape },
    } = this;
    if (editor.points.isLocked || !shape) return;
    const region = grip.middle !== null ? splitEdge(shape.region, grip.middle) : shape.region;
    const corner = grip.middle !== null ? grip.middle + 1 : grip.corner;
    this.drag0 = {
      shapes: editor.points.shapes,
      region,
      corner,
      wasFine: !editor.map.error,
      at: corner === null ? [0, 0] : cornersOf(region, this.reach)[corner]!,
    };
  }

  /**
   * Move by CSS pixels since the drag began. The last place that makes a shape stays where the next one does not.
   */
  drag(dx: number, dy: number) {
    const {
        editor,
        drag0,
        choice: { chosen },
      } = this,
      { k } = editor.viewport.view;
    if (!drag0 || !chosen) return;
    const { region: region0, corner, at } = drag0,
      { what, index } = chosen;
    const [da, db] = this.#toOutline([dx / k, dy / k]);
    const region =
      corner === null
        ? translateRegion(region0, da, db)
        : moveCorner(region0, corner, [at[0] + da, at[1] + db], this.reach);
    const fault = regionFault(region);
    editor.stage.element.classList.toggle("dnb-ed-refusing", Boolean(fault));
    if (fault) {
      editor.messages.hint(fault, 3000);
      return;
    }
    editor.points.shapes = {
      ...editor.points.shapes,
      [what]: updateShape(editor.points.shapes[what], index, { region }),
    };
    editor.map.invalidate(true);
  }

  endDrag(isCancelled: boolean) {
    const {
        editor,
        drag0,
        choice: { chosen },
      } = this,
      shapes = editor.points.shapes;
    this.drag0 = null;
    editor.stage.element.classList.remove("dnb-ed-refusing");
    if (!drag0 || !chosen) return;
    const { what } = chosen,
      name = this.choice.shape?.name || SHAPE_NAMES[what];
    const kind = `${drag0.corner === null ? "move" : "change"} ${name}`;
    editor.points.shapes = drag0.shapes;
    if (!isCancelled && this.edit(what, shapes[what], kind, { wasFine: drag0.wasFine })) {
      editor.frames.drawNow();
      if (drag0.corner !== null) this.handles.focusCorner(drag0.corner); // of a new one: it had no grip yet
      return;
    }
    editor.points.shapes = editor.sender.shapes;
    editor.map.invalidate();
  }

  // ---- points that contradict a part --------------------------------------------------------------------------------

  /**
   * Keep the outline, show the problem, and offer actions on the points; false if none contradicts a part.
   */
  #offer(offer: Offer) {
    const held = findConflicts(offer.points, offer.parts, this.editor.map.strength),
      { editor } = this;
    if (!held.length) return false;
    const one = held.length === 1,
      [who, it, whose] = one
        ? [labelOf(held[0]!.point, numberOf(offer.points, held[0]!.point.id)), "it", "its"]
        : [`${held.length} control points`, "them", "their"];
    const question =
      `${who[0]!.toUpperCase()}${who.slice(1)} in this rigid part require${one ? "s" : ""} another ` +
      `movement than the part's. Carry ${it} with the part (${whose} drag is removed), or switch ${it} off?`;
    const answer = (name: string, text: string) => ({
      name,
      text,
      act: () => editor.frames.guard(() => this.#takeOffer(offer, name)),
    });
    const actions = [answer("carry", `Carry ${it}`), answer("off", `Switch ${it} off`), answer("cancel", "Cancel")];
    editor.messages.set("question", ""); // the same one may have been closed
    editor.messages.set("question", question, { kind: "warning", actions, closed: () => this.dropOffer() });
    this.offered = offer;
    editor.frames.invalidate();
    return true;
  }

  /** Carried points follow their part; in a fixed one their targets return to their sources. */
  #takeOffer({ parts, points, kind }: Offer, how: string) {
    const { editor } = this,
      count = editor.points.shapes.parts.length;
    const held = new Map(findConflicts(points, parts, editor.map.strength).map(({ point, part }) => [point.id, part]));
    const freed = updatePoints(points, [...held.keys()], ({ id, source }) =>
      how === "carry" ? { target: movePlace(held.get(id)?.motion ?? null, source) } : { active: false },
    );
    this.dropOffer();
    editor.stage.focus();
    if (how === "cancel") return;
    const words = `${kind}, ${how === "carry" ? "carry" : "switch off"} its points`;
    if (!this.edit("parts", parts, words, { wasFine: true, points: freed })) return;
    if (parts.length > count) this.#finishAdd("parts");
  }

  /** Withdraw the question and its outline. False if there is none. */
  dropOffer() {
    if (!this.offered) return false;
    this.offered = null;
    this.editor.messages.set("question", "");
    this.editor.frames.invalidate();
    return true;
  }

  /** The outline of the part that waits for an answer, where it would be. */
  get #proposedDraft(): Draft | null {
    const { parts } = this.offered ?? {},
      { sender } = this.editor;
    const part = parts?.find((one, k) => !sameShapes(one, sender.shapes.parts[k]));
    if (!part) return null;
    const corners = cornersOf(part.region, this.reach).map((place) => movePlace(part.motion, place));
    return { tool: "part", places: [...corners, ...corners.slice(0, 1)], next: null };
  }

  /** Take new lists; the chosen shape stays chosen, at any index. */
  follow(shapes: Shapes) {
    this.dropOffer(); // it was about the old points and parts
    this.choice.follow(shapes);
    this.editor.points.shapes = shapes;
  }
}

/** A region with another corner in the middle of edge k. */
function splitEdge(region: RegionData, k: number) {
  if (!isOutline(region)) return region;
  const { vertices } = region;
  const p = vertices[k]!,
    q = vertices[(k + 1) % vertices.length]!;
  return insertCorner(region, k, [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2]);
}
