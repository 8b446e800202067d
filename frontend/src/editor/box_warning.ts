// The warning of tissue that is moved out of the box of the result: at the end of each edit, from the outline of the
// tissue. What Python finds of the same edit, which also knows depths and other steps, takes its place.

import type { LargerBoxRequest } from "../generated.ts";
import { LARGER_BOX, LARGER_BOX_TIP } from "../generated.ts";
import { cutOffText, exceededSides } from "../maths/tissue_extent.ts";
import type { LayeredFit, MaskData, Vector2, Vector4 } from "../types.ts";
import type { EditorParts } from "./parts.ts";

/** What the warning uses of the editor. */
export type WarningEditor = EditorParts<"model" | "frames" | "map" | "messages" | "picture" | "points" | "stage">;

/** The tissue that should stay in the box, the names of its four sides, and that box where it is not what is drawn. */
type Outline = { tissue: MaskData; sides: string[]; box?: Vector4 };

export class BoxWarning {
  #names: string[] = []; // of the sides at which tissue is cut off
  #known: { layered: LayeredFit | null; outline: unknown; box: Vector4 } | null = null;

  constructor(readonly editor: WarningEditor) {}

  /** Take what Python has found. */
  receive() {
    this.#names = this.editor.model.get("cut_off")?.sides ?? [];
    this.#show();
  }

  /** Look where the tissue is, unless something is dragged or nothing has changed. */
  update() {
    const { map, model, picture, points } = this.editor,
      { layered } = map,
      outline: Partial<Outline> = model.get("outline") ?? {},
      box = outline.box ?? picture.sheet,
      known = this.#known;
    if (points.isDragging || !outline.tissue) return;
    const isSame = known?.layered === layered && known.outline === outline;
    if (isSame && known.box.every((side, k) => side === box[k])) return;
    this.#known = { layered, outline, box };
    const pixel: Vector2 = model.get("raster").spacing,
      targets = points.list.filter(({ active }) => active).map(({ target }) => target),
      found = exceededSides(layered, outline.tissue, box, { pixel, targets });
    this.#names = found.map((side) => outline.sides?.[side] ?? "");
    this.#show();
  }

  #show() {
    const { frames, messages, model, stage } = this.editor;
    const enlarge = () =>
      frames.guard(() => {
        stage.focus();
        model.send({ type: "larger_box" } satisfies LargerBoxRequest);
      });
    const actions = model.get("enlarges")
      ? [{ name: "larger_box", text: LARGER_BOX, tip: LARGER_BOX_TIP, act: enlarge }]
      : [];
    messages.set("extent", cutOffText(this.#names), { kind: "warning", actions });
  }
}
