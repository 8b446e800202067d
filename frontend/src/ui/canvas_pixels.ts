// Whether a page reads the pixels that a canvas has: against being recognized some browsers give it others.

import { pageElement } from "./dom.ts";

const SIDE = 8,
  COLOUR = [16, 96, 176, 255],
  NOISE = 8; // of 255; browsers that change the last bits alone show a picture well enough

/** What to do where the pixels are hidden. */
export const HIDDEN_PIXELS =
  "this browser hides the pixels of pictures from pages. Allow this page to read them (in Firefox by the sign of a " +
  "picture in the address bar) and load it again, or use another browser.";

export function hidesPixels() {
  const canvas = pageElement("canvas", "", null, { width: SIDE, height: SIDE }),
    context = canvas.getContext("2d", { willReadFrequently: true });
  if (!context) return false; // there is no memory, and who draws says so
  context.fillStyle = `rgb(${COLOUR.slice(0, 3).join(" ")})`;
  context.fillRect(0, 0, SIDE, SIDE);
  const { data } = context.getImageData(0, 0, SIDE, SIDE);
  return data.some((value, k) => Math.abs(value - COLOUR[k % 4]!) > NOISE);
}
