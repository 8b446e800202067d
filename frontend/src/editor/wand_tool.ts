// The wand: a click selects the pixels connected within a range of values, which Python computes; its outline, and the
// bar with the range and the uses of the selection.
// Messages to Python: wand (what, place, tolerance, rule, through). The trait "wand" has the answer: region, words, share.

import type { WandRequest } from "../generated.ts";
import { formatLength } from "../maths/numbers.ts";
import type { RegionData, Vector2 } from "../types.ts";
import { OWN_KEYS, pageElement, setAttributes, setText, svgElement } from "../ui/dom.ts";
import { EDITOR_KEYS, keyPlace } from "../ui/keys.ts";
import { OptionBar } from "./option_bar.ts";
import type { EditorParts } from "./parts.ts";
import { shapePaths } from "./shape_handles.ts";
import { WandChanges } from "./wand_changes.ts";

const NO_WAND = "Only pictures of grey values can be selected by the wand: a slice, the maximum or the mean";
const MOST = 2; // widths of the window: the largest tolerance
const START = 25; // of the slider, 0 to 100, at first
const WAIT = 80; // milliseconds between two requests of a slider that moves
const KEY_PIXELS = [4, 20]; // CSS pixels of an arrow key with and without Shift
const RULES = [
  ["near", "Like it"],
  ["brighter", "Like it or brighter"],
  ["darker", "Like it or darker"],
];

/** The outline of the selection, and the cross of the keys. */
interface Outline {
  root: SVGGElement;
  fill: SVGPathElement;
  lines: SVGPathElement[];
  cross: SVGPathElement;
}

/** Dependencies of the wand on the editor. */
export type WandEditor = EditorParts<
  "model" | "frames" | "messages" | "stage" | "viewport" | "picture" | "points" | "map",
  "modes" | "shapes"
>;

export class Wand {
  readonly advice = "Click on the tissue to be selected; [ and ] change the tolerance; Esc ends";
  outline: Outline;
  bar: OptionBar;
  rule: HTMLSelectElement;
  slider: HTMLInputElement;
  tolerated: HTMLSpanElement;
  part: HTMLButtonElement;
  cut: HTMLButtonElement;
  changes: WandChanges;

  isOn = false;

  /** The place of the picture that was clicked. */
  place: Vector2 | null = null;

  /** The cross of the keys, in CSS pixels. */
  at: Vector2 | null = null;

  timer = 0;

  constructor(readonly editor: WandEditor) {
    const root = svgElement("g", { class: "dnb-ed-wand", "aria-hidden": "true" }, editor.stage.svg);
    const path = (name: string) => svgElement("path", { class: `dnb-ed-wand-${name}` }, root);
    this.outline = { root, fill: path("fill"), lines: [path("case"), path("line")], cross: path("cross") };
    this.bar = new OptionBar(editor, "dnb-ed-options dnb-ed-wand-bar", "Wand");
    this.rule = pageElement("select", "", this.bar.element, { "aria-label": "values to select", ...OWN_KEYS });
    for (const [value, words] of RULES as [string, string][]) pageElement("option", "", this.rule, { value }, words);
    this.rule.addEventListener("input", () => editor.frames.guard(() => this.#applyChange()));
    this.slider = this.bar.slider("tolerance", () => this.#applyChange(), { value: START });
    this.tolerated = this.bar.text("dnb-ed-brush-value");
    const done = () => {
      this.stop();
      editor.stage.focus();
    };
    const { bar } = this,
      outline = "cut along the outline of the selection"; // what most need comes first: on a phone the rest is scrolled
    this.part = bar.button("Make rigid part", "Make rigid part", () => this.#make("part"), "keep the selection rigid");
    this.cut = bar.button("Make cut", "Make cut", () => this.#make("cut"), outline);
    bar.button("Done", "Done", done, "put the wand away");
    this.changes = new WandChanges(bar, () => this.#applyChange());
  }

  /** Python's answer; empty where nothing is selected. */
  get answer(): { region?: RegionData | null; words?: string; share?: number; failed?: boolean; pieces?: number } {
    return this.editor.model.get("wand") ?? {};
  }

  /** Whether there is a wand at all: only a studio has one. */
  get isThere() {
    return Object.keys(this.answer).length > 0;
  }

  /** In the unit of the picture. */
  get tolerance() {
    const [low, high] = this.editor.picture.painter.source?.grey?.window ?? [0, 1];
    return (Number(this.slider.value) / 100) ** 2 * MOST * (high - low);
  }

  toggle() {
    const { editor } = this;
    if (this.stop() || editor.points.isLocked || !this.isThere) return;
    if (!editor.picture.painter.source?.grey) {
      editor.messages.hint(NO_WAND, 5000);
      return;
    }
    editor.tools.modes.deactivateTools();
    editor.tools.modes.setAdding(false);
    editor.tools.modes.setSelecting(false);
    editor.tools.shapes.choice.choose(null);
    this.isOn = true;
    editor.stage.element.classList.add("dnb-ed-wanding");
    editor.messages.announce("Wand: arrows move a cross, Enter selects the tissue under it, Escape ends");
    editor.stage.focus();
    editor.frames.invalidate();
  }

  /** False if the tool was not in use. */
  stop() {
    if (!this.isOn) return false;
    this.isOn = false;
    this.at = null;
    if (this.place) this.#send("stop");
    this.place = null;
    clearTimeout(this.timer);
    this.editor.stage.element.classList.remove("dnb-ed-wanding");
    this.editor.frames.invalidate();
    return true;
  }

  close() {
    clearTimeout(this.timer);
  }

  grab(at: Vector2) {
    this.pick(at);
    return null;
  }

  /** @param at CSS pixels */
  pick(at: Vector2) {
    const { editor } = this,
      source = editor.map.visiblePlace(editor.viewport.placeAt(at));
    if (source === null) {
      editor.messages.hint("This is a gap: there is nothing here to select");
      return;
    }
    this.place = source;
    this.changes.reset();
    this.#send("preview");
  }

  #applyChange() {
    this.editor.frames.invalidate();
    clearTimeout(this.timer);
    if (this.place) this.timer = setTimeout(() => this.#send("preview"), WAIT);
  }

  /** Make a shape of the selection; the wand stays active for the next one. */
  #make(what: "part" | "cut") {
    this.#send(what);
    this.editor.stage.focus();
  }

  #send(what: WandRequest["what"]) {
    const { place, tolerance } = this;
    this.editor.model.send({
      type: "wand",
      what,
      place: place ?? [0, 0],
      tolerance,
      rule: this.rule.value as WandRequest["rule"],
      ...this.changes.values,
    } satisfies WandRequest);
    this.editor.frames.invalidate();
  }

  show() {
    const { editor, answer, isOn } = this,
      { region = null, words = "", share = 1, failed = false, pieces = 1 } = answer;
    this.bar.element.hidden = !isOn;
    this.outline.root.setAttribute("visibility", isOn ? "visible" : "hidden");
    const said = words && share < 1 ? `${words} ${Math.round(100 * share)} %` : words;
    editor.messages.set("wand", isOn ? said : "", { kind: failed ? "warning" : "info" });
    if (!isOn) return;
    const paths = region ? shapePaths(region, editor.viewport.view, 0) : { line: "", inside: "" };
    setAttributes(this.outline.fill, { d: paths.inside });
    for (const line of this.outline.lines) setAttributes(line, { d: paths.line });
    setAttributes(this.outline.cross, {
      d: this.at ? `M${this.at[0] - 9} ${this.at[1]}h18M${this.at[0]} ${this.at[1] - 9}v18` : "",
    });
    const { unit = "" } = editor.picture.painter.source?.grey ?? {};
    setText(this.tolerated, `\u00b1 ${formatLength(this.tolerance)}${unit ? ` ${unit}` : ""}`);
    for (const button of [this.part, this.cut]) button.disabled = !region;
    this.changes.show(pieces);
  }

  /**
   * Handle a key; returns whether the wand uses it.
   * @param arrow the direction of an arrow key
   */
  key(key: string, event: KeyboardEvent, arrow?: Vector2) {
    const { editor } = this,
      middle: Vector2 = [editor.viewport.view.width / 2, editor.viewport.view.height / 2];
    const size = keyPlace(EDITOR_KEYS, "brush-radius", key);
    if (size >= 0) {
      this.slider.value = String(Number(this.slider.value) + (size ? 2 : -2));
      this.#applyChange();
      return true;
    }
    if (arrow) {
      const step = KEY_PIXELS[event.shiftKey ? 0 : 1]!,
        [x, y] = this.at ?? middle;
      this.at = [x + step * arrow[0], y + step * arrow[1]];
      editor.messages.announce(`wand at ${editor.viewport.placeAt(this.at).map(formatLength).join(", ")}`);
      editor.frames.invalidate();
      return true;
    }
    if (key !== "Enter") return false;
    this.at ??= middle;
    this.pick(this.at);
    return true;
  }
}
