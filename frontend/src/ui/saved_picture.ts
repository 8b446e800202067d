// The picture that a camera button saves: twice as large as its pane, with a scale bar and without the ground if wanted.

import { HIDDEN_PIXELS, hidesPixels } from "./canvas_pixels.ts";
import { buttonElement, named, OWN_KEYS, pageElement, saveFile, setAttributes } from "./dom.ts";

/** `hasScale`: a scale bar is drawn; `isTransparent`: what is behind the object is clear. */
export type SavedPicture = { hasScale: boolean; isTransparent: boolean };

export const ENLARGED = 2; // times the pane's size in CSS pixels
const FONT = ["600", `${12 * ENLARGED}px`, "sans-serif"].join(" "); // of the text of a scale bar

/** What was chosen last, for all menus of the page. */
const CHOSEN: SavedPicture = { hasScale: false, isTransparent: false };

/** A canvas of the size of a saved picture of a pane, in CSS pixels. */
export function savedCanvas({ width, height }: { width: number; height: number }) {
  const canvas = document.createElement("canvas");
  canvas.width = Math.max(1, Math.round(ENLARGED * width));
  canvas.height = Math.max(1, Math.round(ENLARGED * height));
  return canvas;
}

export function pngOf(canvas: HTMLCanvasElement): Promise<Blob | null> {
  if (hidesPixels()) return Promise.reject(new Error(HIDDEN_PIXELS));
  return new Promise((resolve) => {
    canvas.toBlob(resolve, "image/png");
  });
}

/**
 * Draw a scale bar in the lower right corner.
 * @param length of the bar in CSS pixels of the pane
 */
export function drawScale(context: CanvasRenderingContext2D, text: string, length: number, ink: string, halo: string) {
  const { width, height } = context.canvas,
    k = ENLARGED,
    right = width - 14 * k,
    bottom = height - 14 * k;
  context.save();
  context.font = FONT;
  context.textAlign = "right";
  context.lineJoin = "round";
  for (const [colour, line] of [
    [halo, 4 * k],
    [ink, 1.5 * k],
  ] as const) {
    Object.assign(context, { strokeStyle: colour, fillStyle: colour, lineWidth: line });
    context.beginPath();
    context.moveTo(right - length * k, bottom - 5 * k);
    context.lineTo(right - length * k, bottom);
    context.lineTo(right, bottom);
    context.lineTo(right, bottom - 5 * k);
    context.stroke();
    if (colour === halo) context.strokeText(text, right, bottom - 9 * k);
    else context.fillText(text, right, bottom - 9 * k);
  }
  context.restore();
}

/** The menu under a camera button. */
export class SavedPictureMenu {
  root: HTMLDivElement;
  #leave = new AbortController();

  /**
   * @param opener the button
   * @param name of the file, without its suffix
   * @param picture makes the PNG; null for none
   * @param fail shows why there is none
   */
  constructor(
    readonly opener: HTMLElement,
    parent: Element,
    readonly name: () => string,
    readonly picture: (wanted: SavedPicture) => Promise<Blob | null>,
    readonly fail: (message: string) => void,
  ) {
    setAttributes(opener, { "aria-haspopup": "dialog", "aria-expanded": "false" });
    this.root = pageElement("div", "dnb-saved", parent, {
      role: "dialog",
      "aria-label": "Picture of the view",
      hidden: "",
    });
    this.root.popover = "manual";
    this.#checkbox("Scale bar", "hasScale");
    this.#checkbox("Transparent ground", "isTransparent");
    buttonElement("dnb-saved-button", this.root, "Save PNG", () => this.save(), named("Save PNG"));
    this.root.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      event.stopPropagation();
      this.close();
    });
  }

  #checkbox(words: string, name: keyof SavedPicture) {
    const label = pageElement("label", "dnb-saved-choice", this.root);
    const input = pageElement("input", "", label, { type: "checkbox", "aria-label": words, ...OWN_KEYS });
    pageElement("span", "", label, {}, words);
    input.checked = CHOSEN[name];
    input.addEventListener("change", () => {
      CHOSEN[name] = input.checked;
    });
  }

  toggle() {
    if (!this.root.hidden) {
      this.close();
      return;
    }
    this.root.hidden = false;
    this.root.showPopover();
    this.opener.setAttribute("aria-expanded", "true");
    const { right, bottom } = this.opener.getBoundingClientRect();
    Object.assign(this.root.style, {
      left: `${Math.max(4, right - this.root.offsetWidth)}px`,
      top: `${Math.max(4, Math.min(bottom + 4, window.innerHeight - this.root.offsetHeight - 4))}px`,
    });
    this.root.querySelector("button")?.focus({ preventScroll: true });
    this.#leave = new AbortController();
    const options = { signal: this.#leave.signal, capture: true },
      leave = ({ target }: Event) => {
        if (!(target instanceof Node && (this.root.contains(target) || this.opener.contains(target)))) this.close();
      };
    for (const name of ["pointerdown", "scroll", "resize"]) window.addEventListener(name, leave, options);
  }

  close() {
    this.#leave.abort();
    if (this.root.hidden) return;
    const hadFocus = this.root.contains(document.activeElement);
    this.root.hidden = true;
    if (this.root.isConnected) this.root.hidePopover();
    this.opener.setAttribute("aria-expanded", "false");
    if (hadFocus) this.opener.focus({ preventScroll: true });
  }

  /** Save a picture as it is chosen. */
  async save() {
    this.close();
    try {
      const blob = await this.picture({ ...CHOSEN }),
        name = this.name()
          .replace(/[^\p{L}\p{N}-]+/gu, "_")
          .replace(/^_|_$/g, "");
      if (blob) saveFile(blob, `${name || "picture"}.png`);
      else this.fail("There is no picture yet.");
    } catch (error) {
      this.fail(`The picture could not be saved: ${error instanceof Error ? error.message : error}`);
    }
  }
}
