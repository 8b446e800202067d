// Three things to begin with on a page that opens files: a carp, one of Thompson's drawings, and a file of one's own.

import type { Vector2 } from "../types.ts";
import { buttonElement, pageElement } from "../ui/dom.ts";
import { planeAlong, voxelRaster } from "../volume/grid.ts";
import { maximumProjection } from "../volume/packing.ts";
import type { Examples } from "./examples.ts";
import { carpVolume, examplePicture } from "./examples.ts";
import type { Opened, ReportProgress } from "./opened_file.ts";
import { openVolume } from "./opened_file.ts";
import { runGuarded } from "./standalone_page.ts";

/** How something is opened. */
export type Opening = (report: ReportProgress, signal: AbortSignal) => Promise<Opened>;

const CARD: Vector2 = [320, 180]; // pixels of the picture of a card
const CARP_SIDE = "-x"; // its head points left
const PLUS = "M160 55V125M125 90H195"; // for a file that nobody has chosen yet

/** The carp from its side, bright on dark. */
function carpCanvas(examples: Examples) {
  const volume = carpVolume(examples),
    plane = planeAlong(volume.grid, CARP_SIDE),
    {
      shape: [height, width],
      spacing: [du, dv],
    } = voxelRaster(volume.grid, plane),
    pixels = new ImageData(width, height);
  maximumProjection(volume, plane).forEach((value: number, k: number) => {
    pixels.data.set([value, value, value, 255], 4 * k);
  });
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  canvas.getContext("2d")!.putImageData(pixels, 0, 0);
  return { canvas, size: [width * du, height * dv] as Vector2 };
}

/** Draw a picture of a size as large as a card allows. */
function drawCard(card: HTMLCanvasElement, image: CanvasImageSource, [width, height]: Vector2, paper: string) {
  const c = card.getContext("2d")!,
    k = Math.min(card.width / width, card.height / height),
    [w, h] = [k * width, k * height];
  c.fillStyle = paper;
  c.fillRect(0, 0, card.width, card.height);
  c.imageSmoothingQuality = "high";
  c.drawImage(image, (card.width - w) / 2, (card.height - h) / 2, w, h);
}

/**
 * The cards, before an element.
 * @param open called with the name of what is chosen, and how it is opened
 * @param choose called for a file
 */
export function beginCards(
  before: Element,
  examples: Examples,
  open: (name: string, opening: Opening) => void,
  choose: () => void,
) {
  const root = pageElement("div", "dnb-page-begin", null, { role: "group", "aria-label": "Begin with" });
  before.before(root);
  const card = (title: string, words: string, act: () => void) => {
    const button = buttonElement("dnb-page-card", root, "", act),
      [width, height] = CARD;
    const picture = pageElement("canvas", "dnb-page-card-picture", button, { width, height, "aria-hidden": "true" });
    pageElement("strong", "", button, {}, title);
    pageElement("span", "", button, {}, words);
    return picture;
  };
  const figure = examples.figures[examples.pairs[0]![0]]!;
  const carp = card("A carp in 3D", "a scan that was computed; bend it", () =>
    open("carp", (report, signal) => openVolume(carpVolume(examples), null, report, signal)),
  );
  const plate = card("A fish drawn by Thompson", "from his book of 1917; turn it into another", () =>
    open(figure.species, async (report, signal) => {
      const { photograph, subject } = await examplePicture(examples, figure);
      return { ...(await openVolume(photograph.volume, photograph, report, signal)), subject };
    }),
  );
  const own = card("Your own file", "a photo, a drawing or a scan", choose).getContext("2d")!;
  Object.assign(own, { strokeStyle: "#7d8794", lineWidth: 10, lineCap: "round" });
  own.stroke(new Path2D(PLUS));
  runGuarded(async () => {
    const { canvas, size } = carpCanvas(examples);
    drawCard(carp, canvas, size, "#000000");
    const { photograph } = await examplePicture(examples, figure),
      { rgba, width, height } = photograph.shown,
      image = await createImageBitmap(new ImageData(rgba, width, height));
    drawCard(plate, image, [width, height], "#ffffff");
  });
  return root;
}
