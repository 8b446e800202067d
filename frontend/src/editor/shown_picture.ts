// The picture that the editor shows: its pixels and colours, its boxes, and the visible part of the original.

import { mapVector } from "../maths/camera.ts";
import { pointsKey } from "../maths/points.ts";
import type { PicturePoint, Shapes, Vector2, Vector4 } from "../types.ts";
import { CompareControls } from "../ui/compare_controls.ts";
import type { Original, PictureSource } from "./painter.ts";
import { bytesOf, colourTable, decodePicture, Painter } from "./painter.ts";
import type { EditorParts } from "./parts.ts";
import { Slices } from "./slices.ts";

/** The points and shapes that a picture of a deformed volume is of. */
function stateKey(points: PicturePoint[], { cuts, parts }: Partial<Shapes>) {
  return pointsKey(points ?? []) + JSON.stringify([cuts ?? [], parts ?? []]);
}

/** Dependencies of the picture on the editor. */
export type PictureEditor = EditorParts<"model" | "frames" | "messages" | "stage">;

export class ShownPicture {
  painter: Painter;
  compare: CompareControls;
  slices: Slices;

  #deformed: { source: PictureSource; key: string } | null = null; // the picture of the deformed volume

  isComparing = false; // whether the picture is shown as it was

  isBefore = false; // whether this view shows the original next to another one

  #requests = 0; // of pictures

  #deformedRequests = 0;

  constructor(readonly editor: PictureEditor) {
    this.painter = new Painter(editor.stage.canvas);
    this.compare = new CompareControls(editor.stage.element, () => editor.frames.markMoving());
    this.slices = new Slices(editor.model, editor.messages);
  }

  toggleComparing() {
    this.isComparing = !this.isComparing;
    this.editor.frames.invalidate();
  }

  /** Decode the picture of the trait, and call `loaded` unless another one has been requested meanwhile. */
  async load(loaded: () => void) {
    this.#requests += 1;
    const { model, messages } = this.editor,
      number = this.#requests,
      bytes = model.get("image"),
      raster = model.get("raster");
    try {
      const source = bytes?.byteLength ? await decodePicture(bytes, raster) : null;
      if (this.#requests !== number) return;
      if (source && model.get("window")?.length) source.setWindow(model.get("window"));
      this.painter.source = source;
      messages.set("picture", "");
    } catch (error) {
      const reason = error instanceof Error ? error.message : error;
      if (this.#requests === number)
        messages.set("picture", `The picture could not be shown: ${reason}`, { kind: "error" });
    }
    loaded();
  }

  /** Decode the picture of the deformed volume, where it is not this picture warped in its plane. */
  async loadDeformed() {
    this.#deformedRequests += 1;
    const { model, frames } = this.editor,
      number = this.#deformedRequests,
      bytes = model.get("deformed_image"),
      { raster, points, cuts, parts } = model.get("deformed") ?? {};
    const source = bytes?.byteLength && raster ? await decodePicture(bytes, raster) : null;
    if (this.#deformedRequests !== number) return;
    if (source && model.get("window")?.length) source.setWindow(model.get("window"));
    this.#deformed = source && { source, key: stateKey(points, { cuts, parts }) };
    frames.invalidate();
  }

  /** The picture of the volume deformed by these points and shapes; null where the warped picture is right or newer. */
  deformedBy(points: PicturePoint[], shapes: Partial<Shapes>) {
    return this.#deformed && this.#deformed.key === stateKey(points, shapes) ? this.#deformed.source : null;
  }

  /** Show grey values from black to white of a window. */
  setWindow(window: Vector2) {
    for (const source of [this.painter.source, this.#deformed?.source]) source?.setWindow(window);
  }

  /** Show grey values in the colours of the trait. */
  applyColours() {
    const { model, frames } = this.editor,
      bytes = model.get("colours");
    this.painter.colours = colourTable(bytes?.byteLength ? bytesOf(bytes) : null);
    frames.invalidate();
  }

  /** Whether grey values are shown in colours. */
  get hasColours() {
    return Boolean(this.editor.model.get("colours")?.byteLength);
  }

  /** Show the original by the trait: not at all, wholly, left of a line, or mixed in. */
  applyShows() {
    this.compare.set(this.editor.model.get("shows") ?? "");
    this.editor.frames.invalidate();
  }

  /** Whether all of the picture is shown as it was. */
  get isOriginal() {
    return this.isComparing || this.isBefore || this.compare.shows === "original";
  }

  /** The visible part of the original in the picture. */
  get original(): Original {
    const { shows, share } = this.compare,
      isAll = this.isOriginal;
    return { share: !isAll && shows === "wipe" ? share : 0, opacity: !isAll && shows === "fade" ? share : 0 };
  }

  /** The picture's box, [a0, a1, b0, b1]. */
  get box(): Vector4 {
    const {
      shape: [nv, nu],
      spacing: [du, dv],
      origin: [a, b],
    } = this.editor.model.get("raster");
    return [a - du / 2, a + (nu - 0.5) * du, b - dv / 2, b + (nv - 0.5) * dv];
  }

  /** The bounding box of the drawing: the picture's, and the part of the result's beyond it. */
  get sheet(): Vector4 {
    const { box } = this,
      beyond = this.editor.model.get("beyond") ?? [];
    return mapVector(box, (x, n) => (beyond.length === 4 ? (n % 2 ? Math.max : Math.min)(x, beyond[n]) : x));
  }

  /** The part of the drawing that is framed: the subject's box, and the part of the result's beyond the picture. */
  get framed(): Vector4 {
    const { box, sheet } = this,
      subject = this.editor.model.get("subject") ?? [];
    if (subject.length !== 4) return sheet;
    const [a0, a1, b0, b1] = subject as Vector4;
    const inside: Vector4 = [Math.max(a0, box[0]), Math.min(a1, box[1]), Math.max(b0, box[2]), Math.min(b1, box[3])];
    if (inside[0] >= inside[1] || inside[2] >= inside[3]) return sheet;
    return mapVector(inside, (x, n) => (sheet[n] === box[n] ? x : sheet[n]!));
  }
}
