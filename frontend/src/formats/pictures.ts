// Pictures (PNG, JPEG) as volumes of one slice, as deformnb/io/volumes/images.py reads them: grey values by ITU-R 601 as Pillow
// rounds them, rotated as the camera states, rows along y. The browser unpacks them.

import { HIDDEN_PIXELS, hidesPixels } from "../ui/canvas_pixels.ts";
import { checkGrid, IDENTITY } from "../volume/grid.ts";
import { FileError, shownText } from "./reading.ts";

import type { Volume } from "./volume_files.ts";

/** Suffixes of pictures. */
export const PICTURE_SUFFIXES = [".png", ".jpg", ".jpeg"];
const MOST_PIXELS = 2 ** 26; // 67 million; phones take pictures of 12 to 50
const STRIP = 2 ** 22; // pixels that are drawn at once
const NO_MEMORY = "there is not enough memory for it; make it smaller.";
const SHOWN = 2048; // pixels along a side that the editor shows

export interface Photograph {
  volume: Volume;
  /** Whether Python reads the very same values */
  isExact: boolean;
  /** The picture in its colours, averaged over squares of so many pixels */
  shown: { rgba: Uint8ClampedArray<ArrayBuffer>; width: number; height: number; factor: number };
}

/**
 * Width and height in the header of a PNG or a JPEG, and whether every browser finds the same grey values as Pillow.
 */
export function pictureSize(data: Uint8Array) {
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  if (data.length >= 33 && view.getUint32(0) === 0x89504e47 && view.getUint32(4) === 0x0d0a1a0a) {
    const text = new TextDecoder("latin1").decode(data.subarray(0, 2 ** 16)),
      depth = view.getUint8(24),
      colour = view.getUint8(25);
    const isExact = depth <= 8 && [0, 2, 3].includes(colour) && !/tRNS|gAMA|iCCP|eXIf|cICP/.test(text);
    return { width: view.getUint32(16), height: view.getUint32(20), isExact };
  }
  if (data.length >= 4 && view.getUint16(0) === 0xffd8) {
    for (let at = 2; at + 9 < data.length; ) {
      const mark = view.getUint16(at);
      if (mark < 0xff00) break;
      const isFrame = mark >= 0xffc0 && mark <= 0xffcf && ![0xffc4, 0xffc8, 0xffcc].includes(mark);
      if (isFrame) return { width: view.getUint16(at + 7), height: view.getUint16(at + 5), isExact: false };
      at += mark === 0xffff ? 1 : 2 + view.getUint16(at + 2);
    }
  }
  throw new FileError("it is cut short or no picture (PNG or JPEG).");
}

/** The picture of a file. */
export async function readPicture(blob: Blob, name: string): Promise<Photograph> {
  try {
    const { width, height, isExact } = pictureSize(new Uint8Array(await blob.slice(0, 2 ** 22).arrayBuffer()));
    if (width < 1 || height < 1 || width * height > MOST_PIXELS) {
      throw new FileError(`it has ${width} x ${height} pixels, and this page holds ${MOST_PIXELS}; make it smaller.`);
    }
    return { ...(await decodePicture(blob, name)), isExact };
  } catch (error) {
    if (error instanceof FileError) throw new FileError(`${shownText(name)}: ${error.message}`);
    throw error;
  }
}

/** The pixels of a picture, strip by strip: a canvas of an iPhone holds 17 million, and a photograph of it has 12 to 48. */
function pixelsOf(bitmap: ImageBitmap) {
  const { width, height } = bitmap,
    rows = Math.min(height, Math.max(1, Math.floor(STRIP / width))),
    canvas = Object.assign(document.createElement("canvas"), { width, height: rows });
  const context = canvas.getContext("2d", { willReadFrequently: true });
  if (!context) throw new FileError(NO_MEMORY);
  if (hidesPixels()) throw new FileError(HIDDEN_PIXELS);
  context.globalCompositeOperation = "copy";
  const rgba = new Uint8ClampedArray(4 * width * height);
  for (let top = 0; top < height; top += rows) {
    context.drawImage(bitmap, 0, -top);
    const high = Math.min(rows, height - top);
    rgba.set(context.getImageData(0, 0, width, high).data, 4 * width * top);
  }
  if (rgba.every((value) => value === 0)) throw new FileError(NO_MEMORY); // what such a browser draws
  return rgba;
}

async function decodePicture(blob: Blob, name: string) {
  let bitmap: ImageBitmap;
  try {
    bitmap = await createImageBitmap(blob, {
      colorSpaceConversion: "none",
      premultiplyAlpha: "none",
      imageOrientation: "from-image",
    });
  } catch {
    throw new FileError("the browser cannot read it; it is damaged or cut short.");
  }
  const { width, height } = bitmap,
    rgba = pixelsOf(bitmap),
    values = new Uint8Array(width * height);
  bitmap.close();
  for (let k = 0; k < values.length; k++) {
    values[k] = (rgba[4 * k]! * 19595 + rgba[4 * k + 1]! * 38470 + rgba[4 * k + 2]! * 7471 + 0x8000) >> 16;
  }
  const grid = checkGrid([1, height, width], [1, 1, 1], [0, 0, 0], IDENTITY);
  const volume = {
    name: name.replace(/\.[^.]*$/, "") || name,
    grid,
    values,
    dtype: "uint8",
    isLabels: false,
    notes: [],
  };
  return { volume, shown: averagePixels(rgba, width, height) };
}

function averagePixels(rgba: Uint8ClampedArray<ArrayBuffer>, width: number, height: number) {
  const factor = Math.max(1, Math.ceil(Math.max(width, height) / SHOWN));
  if (factor === 1) return { rgba, width, height, factor };
  const w = Math.floor(width / factor),
    h = Math.floor(height / factor),
    out = new Uint8ClampedArray(4 * w * h);
  for (let y = 0; y < h; y++) {
    for (let x = 0; x < w; x++) {
      for (let part = 0; part < 4; part++) {
        let sum = 0;
        for (let j = 0; j < factor; j++) {
          const row = 4 * ((y * factor + j) * width + x * factor) + part;
          for (let i = 0; i < factor; i++) sum += rgba[row + 4 * i]!;
        }
        out[4 * (y * w + x) + part] = sum / factor / factor;
      }
    }
  }
  return { rgba: out, width: w, height: h, factor };
}
