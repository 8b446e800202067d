// The brush in the hand: its circle, its bar, and its strokes (maths/brushes.js) by mouse, pen, finger or keys.

import { shownLength } from "../maths/numbers.js";
import { OWN_KEYS, pageElement, setText } from "../ui/dom.js";

const BRUSH_WORDS = { smudge: "Smudge", size: "Expand" };
const BRUSH_HINTS = {
  smudge: "Drag to push what lies in the circle. [ and ] or the wheel change its size, Esc ends",
  size: "Press and drag right to expand what lies in the circle, left to shrink it. [ and ] change its size, Esc ends",
};
const BRUSH_PIXELS = [8, 400]; // CSS pixels of the radius, least and most
const BRUSH_SHARE = 0.09; // of the picture's diagonal: the radius at first
const BRUSH_SWELL = 120; // CSS pixels of a drag that scale the middle by e
const BRUSH_KEYS = [2, 10]; // CSS pixels of an arrow key with and without Shift

export class Brush {
  constructor(page) {
    Object.assign(this, { page, tool: null, at: null, stroke: null, from: null, isByKeys: false });
    this.bar = pageElement("div", "dnb-ed-brush", page.stage, { hidden: "", role: "group", "aria-label": "Brush" });
    this.title = pageElement("span", "", this.bar);
    this.slider = pageElement("input", "", this.bar, { type: "range", min: 0, max: 100, "aria-label": "radius of the brush",
      ...OWN_KEYS });
    this.value = pageElement("span", "dnb-ed-brush-value", this.bar);
    this.done = pageElement("button", "dnb-ed-button", this.bar, { type: "button",
      "aria-label": "put the brush away", ...OWN_KEYS });
    this.done.textContent = "Done";
    this.slider.addEventListener("input", () => page.guard(() => this.setRadius(this.#limits[0]
      * (this.#limits[1] / this.#limits[0]) ** (this.slider.value / 100))));
    this.slider.addEventListener("change", () => page.guard(() => page.focusStage()));
    this.done.addEventListener("click", () => page.guard(() => { this.stop(); page.focusStage(); }));
  }

  get isOn() { return this.tool !== null; }

  get #diagonal() {
    const [a0, a1, b0, b1] = this.page.box;
    return Math.hypot(a1 - a0, b1 - b0);
  }

  get #limits() { return BRUSH_PIXELS.map((pixels) => pixels / this.page.view.k); }

  // In units of the picture.
  get radius() { return this.page.model.get("brush_radius") || BRUSH_SHARE * this.#diagonal; }

  setRadius(radius) {
    const [least, most] = this.#limits;
    this.page.model.set("brush_radius", Math.max(least, Math.min(most, radius)));
    clearTimeout(this.timer); // a slider tells of every pixel
    this.timer = setTimeout(() => this.page.model.save_changes(), 200);
    this.page.invalidate();
  }

  // One notch of the wheel or one press of a key.
  grow(notches) { this.setRadius(this.radius * 1.1 ** notches); }

  start(tool) {
    const { page } = this;
    this.tool = tool;
    this.isByKeys = false;
    page.stage.classList.add("dnb-ed-brushing");
    page.hint(BRUSH_HINTS[tool], 8000);
    page.speak(`${BRUSH_WORDS[tool]} brush: arrows move it, Enter presses and lifts it, Escape ends`);
    page.invalidate();
  }

  stop() {
    if (!this.isOn) return false;
    this.lift(true);
    this.tool = null;
    this.page.stage.classList.remove("dnb-ed-brushing");
    this.page.hideHint(Object.values(BRUSH_HINTS));
    this.page.invalidate();
    return true;
  }

  show() {
    this.bar.hidden = !this.isOn;
    if (!this.isOn) return;
    const [least, most] = this.#limits;
    setText(this.title, BRUSH_WORDS[this.tool]);
    setText(this.value, shownLength(this.radius));
    this.slider.value = 100 * Math.log(this.radius / least) / Math.log(most / least);
  }

  // ---- strokes ------------------------------------------------------------------------------------------------------

  #place([x, y]) { return [(x - this.page.view.x) / this.page.view.k, (y - this.page.view.y) / this.page.view.k]; }

  hover(at) {
    this.at = at;
    this.isByKeys = false;
    this.page.invalidate();
  }

  press(at) {
    const { page } = this;
    this.at = this.from = at;
    const stroke = page.beginStroke(this.#place(at), this.radius, this.tool);
    if (!stroke) return;
    this.stroke = stroke;
    page.paintStroke(stroke);
  }

  drag(at) {
    this.at = at;
    const { stroke, page } = this;
    page.invalidate();
    if (!stroke) return;
    const was = { points: stroke.points, middle: stroke.middle, swell: stroke.swell };
    if (stroke.tool === "smudge") stroke.smudge(this.#place(at));
    else stroke.size((at[0] - this.from[0] + this.from[1] - at[1]) / BRUSH_SWELL);
    if (page.paintStroke(stroke)) return;
    Object.assign(stroke, was); // no further: it would fold, or enter what is rigid
  }

  lift(isCancelled = false) {
    if (!this.stroke) return;
    const { stroke } = this;
    this.stroke = null;
    const isIdle = stroke.tool === "smudge" ? stroke.done === 0 : stroke.swell === 0;
    this.page.endDrag(isCancelled || isIdle, "brush");
    if (!isCancelled && !isIdle) this.page.speak(`${stroke.name} done`);
  }

  // ---- keys ---------------------------------------------------------------------------------------------------------

  key(key, event, arrow) {
    const { page } = this;
    if (key === "[" || key === "]") { this.grow(key === "]" ? 1 : -1); return true; }
    if (key === "Escape") { if (this.stroke) this.lift(true); else this.stop(); return true; }
    if (arrow) {
      const step = BRUSH_KEYS[event.shiftKey ? 0 : 1];
      this.at ??= [page.view.width / 2, page.view.height / 2];
      const next = [this.at[0] + step * arrow[0], this.at[1] + step * arrow[1]];
      if (this.stroke) this.drag(next);
      else this.at = next;
      this.isByKeys = true;
      page.speak(`brush at ${this.#place(next).map(shownLength).join(", ")}`);
      page.invalidate();
      return true;
    }
    if (key !== "Enter") return false;
    if (this.stroke) this.lift();
    else {
      this.press(this.at ?? [page.view.width / 2, page.view.height / 2]);
      page.speak(this.stroke ? "brush pressed" : "no stroke here");
    }
    return true;
  }
}
