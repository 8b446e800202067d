// The picture of a live view that is saved: at twice the size of its pane, from what is drawn already where drawing more
// would take too long, over the ground of the view or over none.

import type { Vector2 } from "../types.ts";
import { drawScale, pngOf, type SavedPicture, savedCanvas } from "../ui/saved_picture.ts";
import type { RayCaster } from "../webgl/raycaster.ts";
import type { FrameLoop } from "./render_loop.ts";
import type { ViewElements } from "./view_elements.ts";

const AFFORDABLE_MS = 1500; // of drawing the pixels of the larger picture; else those that are there are enlarged

/** A view that draws by itself. */
type DrawnView = { caster: RayCaster; loop: FrameLoop; elements: ViewElements };

/** The colours over black and over white differ by what is behind the object: so much of the ground is seen. */
function overNothing(black: ImageData, white: ImageData) {
  const result = new ImageData(black.width, black.height),
    { data } = result;
  for (let k = 0; k < data.length; k += 4) {
    const seen = Math.max(0, ...[0, 1, 2].map((c) => white.data[k + c]! - black.data[k + c]!)),
      alpha = Math.max(0, 255 - seen);
    for (let c = 0; c < 3; c++) data[k + c] = alpha ? Math.min(255, (255 * black.data[k + c]!) / alpha) : 0;
    data[k + 3] = alpha;
  }
  return result;
}

/** Add the scale of a view to a saved picture of it, where it has one. */
export function addScale(context: CanvasRenderingContext2D, { frames: { scale }, background }: ViewElements) {
  if (scale.element.hidden || scale.element.classList.contains("dnb-scale-none")) return;
  const [ink, halo] = background === "light" ? ["#111418", "#ffffffb0"] : ["#ffffff", "#000000b0"];
  drawScale(context, scale.text.textContent ?? "", Number.parseFloat(scale.bar.style.width), ink, halo);
}

/** The saved picture as a PNG. */
export function snapshot(view: DrawnView, { hasScale, isTransparent }: SavedPicture): Promise<Blob | null> {
  const { caster, elements, loop } = view,
    { background, size: before } = caster,
    canvas = savedCanvas(elements.box),
    size: Vector2 = [canvas.width, canvas.height],
    context = canvas.getContext("2d", { willReadFrequently: isTransparent })!;
  try {
    const cost = Math.max(loop.full.cost, loop.quick.cost);
    caster.size = size;
    if (!caster.gpu.isSoftware && cost > 0 && cost * size[0] * size[1] <= AFFORDABLE_MS) loop.drawNow(1);
    const show = (ground: RayCaster["background"]) => {
      caster.background = ground;
      loop.screen.again();
      context.drawImage(elements.canvas, 0, 0, ...size);
      return isTransparent ? context.getImageData(0, 0, ...size) : null;
    };
    if (isTransparent) context.putImageData(overNothing(show("black")!, show("white")!), 0, 0);
    else show(background);
  } finally {
    caster.size = before;
    caster.background = background;
    loop.screen.again();
    loop.touch();
  }
  if (hasScale) addScale(context, elements);
  return pngOf(canvas);
}
