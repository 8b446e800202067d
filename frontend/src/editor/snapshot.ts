// The picture of an editor that is saved: at twice the size of its pane, with grid and overlay, without points and tools.

import { drawScale, ENLARGED, pngOf, type SavedPicture, savedCanvas } from "../ui/saved_picture.ts";
import { lengthText, roundLength } from "../ui/view_parts.ts";
import type { EditorParts } from "./parts.ts";

const BAR_SHARE = 0.22; // of the pane's width at most

/** Dependencies of a saved picture on the editor. */
export type SavedEditor = EditorParts<"model" | "frames" | "picture" | "stage" | "viewport", never, "overlay", never>;

/** The saved picture as a PNG. */
export function pictureSnapshot(editor: SavedEditor, { hasScale, isTransparent }: SavedPicture): Promise<Blob | null> {
  const { frames, layers, model, picture, stage, viewport } = editor,
    { width, height, ratio } = viewport.view,
    canvas = savedCanvas({ width, height }),
    context = canvas.getContext("2d")!,
    resize = (pixels: number) => {
      picture.painter.resize(width, height, pixels);
      viewport.resize(width, height, pixels);
      frames.drawNow();
    };
  resize(ENLARGED);
  try {
    const sheet = picture.painter.visible(viewport.view, picture.sheet),
      {
        x,
        y,
        width: w,
        height: h,
      } = isTransparent ? sheet : { x: 0, y: 0, width: canvas.width, height: canvas.height };
    for (const layer of [stage.canvas, layers.overlay.canvas]) {
      const k = layer.width / canvas.width;
      if (w > 0 && h > 0 && k > 0) context.drawImage(layer, x * k, y * k, w * k, h * k, x, y, w, h);
    }
  } finally {
    resize(ratio);
  }
  const { lengths = "" } = model.get("raster"),
    { k } = viewport.view,
    length = roundLength((BAR_SHARE * width) / k);
  if (hasScale) {
    drawScale(context, lengthText(length, lengths), length * k, "#ffffff", "#000000b0");
  }
  return pngOf(canvas);
}
