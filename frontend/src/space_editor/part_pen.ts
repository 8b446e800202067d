// The pen for rigid parts in space: an ellipsoid or a box, dragged open in one slice and fitted in the others.

import { OptionBar } from "../editor/option_bar.ts";
import type { DrawnPart } from "../generated.ts";
import { perAxis } from "../maths/axes.ts";
import { dot } from "../maths/camera.ts";
import { formatLength } from "../maths/numbers.ts";
import { fromPane, toPane } from "../maths/space.ts";
import type { PaneInfo, Vector2, Vector3 } from "../types.ts";
import { OWN_KEYS, pageElement, setText } from "../ui/dom.ts";
import type { SpacePane } from "./pane.ts";
import type { SpaceParts } from "./parts.ts";

type Form = DrawnPart["form"];

const FORMS: Record<Form, string> = { ellipsoid: "Ellipsoid", box: "Box" };
const HINT = "Drag open what stays rigid, then fit it in the other slices. Enter makes it, Esc ends";
const LEAST = 4; // CSS pixels of a drag: a shorter one draws nothing

/** The sides of a drawing in a picture, by the sign of the way to each along a and b. */
export const DRAFT_SIDES: Record<string, Vector2> = { left: [-1, 0], right: [1, 0], top: [0, -1], bottom: [0, 1] };

/** A drawing in the coordinates of a picture: its middle, and half its lengths. */
export interface Draft {
  middle: Vector3;
  radii: Vector3;
}

/** What a slice shows of a drawing. */
export interface DraftOnSlice {
  middle: Vector2;
  radii: Vector2;
  form: Form;
}

/** Dependencies of the pen on the editor. */
export type PartPenEditor = SpaceParts<"sender" | "frames" | "messages" | "row" | "points" | "cursor" | "shapes">;

export class PartPen {
  isOn = false;
  readonly advice = HINT;
  /** In the first of the pictures. */
  draft: Draft | null = null;
  /** Before a drag. */
  #start: Draft | null = null;
  #bar: OptionBar;
  #form: HTMLSelectElement;
  #words: HTMLSpanElement;
  #make: HTMLButtonElement;

  constructor(readonly editor: PartPenEditor) {
    this.#bar = new OptionBar({ frames: editor.frames, stage: editor.row }, "dnb-ed-options", "Rigid part");
    this.#form = pageElement("select", "", this.#bar.element, { "aria-label": "form of the rigid part", ...OWN_KEYS });
    for (const [value, words] of Object.entries(FORMS)) pageElement("option", "", this.#form, { value }, words);
    this.#form.addEventListener("input", () => editor.frames.invalidate());
    this.#words = this.#bar.text("dnb-ed-brush-value", { title: "size along the axes" });
    this.#make = this.#bar.button("Make rigid part", "Make rigid part", () => this.make(), "keep it rigid");
    const done = () => {
      this.stop();
      editor.row.focus();
    };
    this.#bar.button("Done", "Done", done, "put the pen away");
  }

  get form() {
    return this.#form.value as Form;
  }

  start() {
    const { frames, messages, row, shapes } = this.editor;
    this.isOn = true;
    this.draft = null;
    shapes.choice.choose(null);
    row.element.classList.add("dnb-ed-drawing");
    messages.hint(HINT, 12000);
    row.focus();
    frames.invalidate();
  }

  /** False if the pen was not in use. */
  stop() {
    const { frames, messages, row } = this.editor;
    if (!this.isOn) return false;
    this.isOn = false;
    this.draft = this.#start = null;
    row.element.classList.remove("dnb-ed-drawing");
    messages.hideHint([HINT]);
    frames.invalidate();
    return true;
  }

  /** Let Python make the rigid part. */
  make() {
    const { cursor, messages, points, row, sender } = this.editor,
      { draft, form } = this;
    if (!draft || points.isLocked) {
      if (!draft) messages.hint(HINT, 5000);
      return;
    }
    this.stop();
    row.focus(); // the button is gone
    sender.drawPart({ form, middle: fromPane(cursor.panes[0]!, draft.middle), radii: draft.radii });
    messages.announce("rigid part drawn");
  }

  show() {
    this.#bar.element.hidden = !this.isOn;
    if (!this.isOn) return;
    setText(this.#words, this.draft?.radii.map((r) => formatLength(2 * r)).join(" \u00d7 ") ?? "");
    this.#make.disabled = !this.draft;
  }

  // ---- places -------------------------------------------------------------------------------------------------------

  /** A drawing of one picture in the coordinates of another; their axes are the same up to order and sign. */
  #convert({ middle, radii }: Draft, from: PaneInfo, to: PaneInfo): Draft {
    const of = (info: PaneInfo) => [info.u, info.v, info.n] as const;
    return {
      middle: toPane(to, fromPane(from, middle)),
      radii: perAxis((k) =>
        perAxis((i) => Math.abs(dot(of(to)[k], of(from)[i])) * radii[i]).reduce((sum, r) => sum + r),
      ),
    };
  }

  /** The drawing on the slice of a picture; null where that does not meet it. */
  onSlice(pane: { readonly info: PaneInfo }): DraftOnSlice | null {
    const { cursor } = this.editor;
    if (!this.draft || !cursor.isSlice) return null;
    const { middle, radii } = this.#convert(this.draft, cursor.panes[0]!, pane.info),
      away = (cursor.depthIn(pane.info) - middle[2]) / radii[2],
      share = Math.abs(away) >= 1 ? 0 : this.form === "box" ? 1 : Math.sqrt(1 - away * away);
    return share
      ? { middle: [middle[0], middle[1]], radii: [share * radii[0], share * radii[1]], form: this.form }
      : null;
  }

  // ---- drags --------------------------------------------------------------------------------------------------------

  begin() {
    this.#start = this.draft;
  }

  /**
   * Draw, move or resize by a drag in a picture.
   * @param what a side, "inside", or null for a new drawing
   */
  drag(pane: SpacePane, what: string | null, from: Vector2, at: Vector2) {
    const { cursor, frames } = this.editor,
      { info, viewport } = pane,
      [p, q] = [viewport.placeAt(from), viewport.placeAt(at)],
      start = this.#start && this.#convert(this.#start, cursor.panes[0]!, info),
      made = what && start ? this.#changed(pane, start, what, p, q) : this.#drawn(pane, p, q);
    if (made) this.draft = this.#convert(made, info, cursor.panes[0]!);
    frames.invalidate();
  }

  #drawn({ info, viewport }: SpacePane, [a, b]: Vector2, [c, d]: Vector2): Draft | null {
    const radii: Vector2 = [Math.abs(c - a) / 2, Math.abs(d - b) / 2];
    if (Math.min(...radii) < LEAST / 2 / viewport.view.k) return null;
    return {
      middle: [(a + c) / 2, (b + d) / 2, this.editor.cursor.depthIn(info)],
      radii: [...radii, (radii[0] + radii[1]) / 2],
    };
  }

  #changed(pane: SpacePane, start: Draft, what: string, from: Vector2, to: Vector2): Draft {
    const { middle, radii } = start,
      by: Vector2 = [to[0] - from[0], to[1] - from[1]],
      side = DRAFT_SIDES[what];
    if (!side) return { radii, middle: [middle[0] + by[0], middle[1] + by[1], middle[2]] };
    const away = (this.editor.cursor.depthIn(pane.info) - middle[2]) / radii[2],
      share = this.form === "box" ? 1 : Math.sqrt(Math.max(0.01, 1 - away * away)), // of the radius that is seen
      k = side[0] ? 0 : 1,
      grown = Math.max(LEAST / 2 / pane.viewport.view.k, radii[k] + (side[k] * by[k]) / 2 / share) - radii[k];
    const change = (values: Vector3, value: number) => perAxis((axis) => values[axis] + (axis === k ? value : 0));
    return { radii: change(radii, grown), middle: change(middle, side[k] * grown * share) };
  }

  /** Take back a drag. */
  cancel() {
    this.draft = this.#start;
    this.editor.frames.invalidate();
  }

  key(key: string) {
    if (key !== "Enter") return false;
    this.make();
    return true;
  }
}
