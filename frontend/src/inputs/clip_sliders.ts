// Three sliders with two ends each, which clip all outside a part of a view's bounding box. They set the view's
// trait `clip` in the front end, so a live view follows without the kernel.

import { AXES, type Axis, perAxis } from "../maths/axes.ts";
import { dot, scaled, sideOf } from "../maths/camera.ts";
import { type Clip, clipOf, isClipped, UNCLIPPED } from "../maths/clipping.ts";
import type { Matrix3, Model, Vector3 } from "../types.ts";
import { buttonElement, OWN_KEYS, pageElement, setAttributes, setText } from "../ui/dom.ts";

const CLIP_STEP = 0.01;
const THINNEST = 0.02; // of the box: a part can always be taken hold of again
const SIDE_WORDS: Record<string, string> = { L: "left", R: "right", A: "front", P: "back", S: "top", I: "bottom" };

/** The trait `volume_info`, as far as it is needed here; empty before there is a volume. */
export type VolumeInfo = { axes?: Matrix3; anatomical?: boolean };

/** The lower or the upper end of the visible part. */
type End = 0 | 1;
type Ends<T> = [T, T];
type Row = {
  row: HTMLDivElement;
  from: HTMLSpanElement;
  track: HTMLDivElement;
  ends: Ends<HTMLInputElement>;
  to: HTMLSpanElement;
  value: HTMLOutputElement;
};

/** The direction in space of an index axis. */
const axisOf = ([x, y, z]: Matrix3, i: Axis): Vector3 => [x[i], y[i], z[i]];
const sideWords = (letters: string) =>
  letters in SIDE_WORDS || /^[A-Z]+$/.test(letters)
    ? [...letters].map((letter) => SIDE_WORDS[letter]).join(" and ")
    : `end at ${letters}`;

/** The clip that removes the half of the visible part towards a viewer. */
function clipTowards(direction: Vector3, axes: Matrix3): Clip {
  const along = perAxis((i) => dot(direction, axisOf(axes, i)));
  const axis = AXES.reduce<Axis>((best, i) => (Math.abs(along[i]) > Math.abs(along[best]) ? i : best), 0);
  return perAxis((i) => (i !== axis ? UNCLIPPED[i] : along[i] > 0 ? [0.5, 1] : [0, 0.5]));
}

export class ClipSliders {
  root: HTMLDivElement;
  rows: [Row, Row, Row];
  whole: HTMLButtonElement;
  shown: () => void;

  /** @param model that of the view */
  constructor(
    parent: HTMLElement,
    readonly model: Model,
  ) {
    this.root = pageElement("div", "dnb-clip", parent, {
      role: "group",
      "aria-label": "Part of the volume that is seen",
    });
    this.rows = perAxis((axis) => this.#row(axis));
    const buttons = pageElement("div", "dnb-clip-buttons", this.root);
    this.#button(buttons, "Open towards me", "Takes away the half that lies towards the viewer", () => {
      const { axes } = this.info;
      if (axes) this.put(clipTowards(this.model.get("camera").direction, axes));
    });
    this.whole = this.#button(buttons, "Show all", "Nothing is taken away", () => this.put(UNCLIPPED));
    this.shown = () => this.show();
    for (const name of ["clip", "volume_info"]) model.on(`change:${name}`, this.shown);
    this.show();
  }

  get info(): VolumeInfo {
    return this.model.get("volume_info") ?? {};
  }

  /** A copy of the view's clip. */
  get clip(): Clip {
    const clip = clipOf(this.model);
    return perAxis((axis) => [...clip[axis]]);
  }

  #row(axis: Axis) {
    const row = pageElement("div", "dnb-clip-row", this.root);
    const from = pageElement("span", "dnb-clip-side", row),
      track = pageElement("div", "dnb-clip-track", row);
    pageElement("div", "dnb-clip-rail", track);
    const slider = (end: End) => {
      const input = pageElement("input", "dnb-clip-end", track, {
        type: "range",
        min: 0,
        max: 1,
        step: CLIP_STEP,
        ...OWN_KEYS,
      });
      input.addEventListener("input", () => this.#moveEnd(axis, end, Number(input.value)));
      return input;
    };
    const ends: Ends<HTMLInputElement> = [slider(0), slider(1)];
    return {
      row,
      from,
      track,
      ends,
      to: pageElement("span", "dnb-clip-side", row),
      value: pageElement("output", "dnb-clip-value", row),
    };
  }

  #button(parent: HTMLElement, text: string, title: string, action: () => void) {
    return buttonElement("dnb-clip-button", parent, text, action, { title });
  }

  #moveEnd(axis: Axis, end: End, value: number) {
    const { clip } = this,
      [low, high] = clip[axis];
    clip[axis][end] = end
      ? Math.max(value, Math.min(1, low + THINNEST))
      : Math.min(value, Math.max(0, high - THINNEST));
    this.put(clip);
  }

  put(clip: Clip) {
    const rounded = clip.map((pair) => pair.map((share) => Number(share.toFixed(4))));
    if (JSON.stringify(rounded) !== JSON.stringify(this.clip)) {
      this.model.set("clip", rounded);
      this.model.save_changes();
    }
    this.show();
  }

  show() {
    const {
      clip,
      info: { anatomical, axes },
    } = this;
    this.root.classList.toggle("dnb-clip-idle", !axes);
    this.whole.disabled = !isClipped(clip);
    if (!axes) return;
    for (const axis of AXES) {
      const { from, to, track, ends, value } = this.rows[axis];
      const along = axisOf(axes, axis),
        sides: Ends<string> = [sideOf(scaled(along, -1), anatomical), sideOf(along, anatomical)],
        [low, high] = clip[axis];
      setText(from, sides[0]);
      setText(to, sides[1]);
      track.style.setProperty("--low", String(low));
      track.style.setProperty("--high", String(high));
      const words = low > 0 || high < 1 ? `${Math.round(100 * low)}\u2013${Math.round(100 * high)} %` : "all";
      setText(value, words);
      for (const end of [0, 1] as const) {
        const input = ends[end];
        if (Number(input.value) !== clip[axis][end]) input.value = String(clip[axis][end]);
        setAttributes(input, {
          "aria-label": `cut away from the ${sideWords(sides[end])}`,
          "aria-valuetext": `seen ${Math.round(100 * low)} to ${Math.round(100 * high)} percent`,
        });
      }
      // Where both ends are together at the far side, only the lower one can be moved: it must be on top.
      track.classList.toggle("dnb-clip-far", low > 0.5);
    }
  }

  close() {
    for (const name of ["clip", "volume_info"]) this.model.off(`change:${name}`, this.shown);
    this.root.remove();
  }
}
