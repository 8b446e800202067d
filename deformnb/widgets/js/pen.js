// Drawing of cuts, rigid parts and the ground: places are clicked one by one, or drawn in one stroke, or set by keys.

const PEN_HINTS = {
  cut: "Click along the cut, or draw it in one stroke. Enter or double-click ends it; a click on its start closes it. An " +
    "open cut goes on straight through the whole picture: it cannot end inside",
  part: "Click around what shall stay rigid, or draw around it. Enter, double-click or a click on the start closes it",
  ground: "Click two places, or drag a line: what lies on its far side stays where it is. F turns the side over",
};
const PEN_WORDS = { cut: "cut", part: "rigid part", ground: "ground" };
const CLOSE_BY = 10; // CSS pixels around the first place that close the line
const STROKE_ERROR = 1.6; // CSS pixels between a drawn stroke and its corners
const PEN_STEPS = [1, 10]; // CSS pixels of an arrow key with and without Shift: a hand with the keys draws coarsely

class Pen {
  constructor(page) {
    this.page = page;
    this.endedAt = -Infinity;
    this.draft = null; // {tool, places, next, isByKeys, isSet, canClose, isClosing}
  }

  get isOn() { return this.draft !== null; }

  get hasJustEnded() { return performance.now() - this.endedAt < 500; }

  start(tool) {
    const { page } = this;
    this.stroke = null;
    this.draft = { tool, places: [], next: null, isByKeys: false, isSet: false, canClose: false };
    page.stage.classList.add("dnb-ed-drawing");
    page.hint(PEN_HINTS[tool], 12000);
    page.speak(`Drawing a ${PEN_WORDS[tool]}: arrows move the pen, Enter sets a place, Enter again ends, Escape gives up`);
    page.invalidate();
  }

  stop() {
    if (!this.draft) return false;
    this.draft = null;
    this.endedAt = performance.now();
    this.stroke = null;
    this.page.stage.classList.remove("dnb-ed-drawing");
    this.page.hideHint(Object.values(PEN_HINTS));
    this.page.invalidate();
    return true;
  }

  cancel() {
    const was = this.stop();
    if (was) this.page.speak("drawing given up");
    return was;
  }

  // ---- the mouse ----------------------------------------------------------------------------------------------------

  #place([x, y]) { return [(x - this.page.view.x) / this.page.view.k, (y - this.page.view.y) / this.page.view.k]; }

  #gap([a, b], [x, y]) {
    const { view } = this.page;
    return Math.hypot(view.k * a + view.x - x, view.k * b + view.y - y);
  }

  hover(at) {
    const { draft } = this, { places } = draft;
    draft.next = this.#place(at);
    draft.isByKeys = false;
    draft.isClosing = draft.canClose && this.#gap(places[0], at) < CLOSE_BY;
    this.page.invalidate();
  }

  // A stroke from where the mouse went down.
  drag(at) {
    this.stroke ??= [];
    this.stroke.push(this.#place(at));
    this.draft.next = null;
    const { draft } = this;
    draft.shown ??= draft.places.length;
    draft.places.push(this.stroke[this.stroke.length - 1]);
    this.page.invalidate();
  }

  up(from, at) {
    const { draft, stroke } = this;
    if (!stroke) { this.click(at); return; }
    this.stroke = null;
    const before = draft.places.slice(0, draft.shown), all = [this.#place(from), ...stroke], isWhole = before.length === 0;
    draft.shown = undefined;
    const path = draft.tool === "ground" ? [all[0], all[all.length - 1]] : simplified(all, STROKE_ERROR / this.page.view.k);
    const isClosed = draft.tool === "part" || (path.length > 3 && this.#gap(all[0], at) < 2 * CLOSE_BY);
    draft.places = [...before, ...(isWhole && isClosed && this.#gap(all[0], at) < 2 * CLOSE_BY ? path.slice(0, -1) : path)];
    this.#count();
    if (isWhole && !this.finish(isClosed)) { draft.places = before; this.#count(); }
    this.page.invalidate();
  }

  click(at) {
    const { draft } = this, { places } = draft, last = places[places.length - 1];
    if (draft.canClose && this.#gap(places[0], at) < CLOSE_BY) { this.finish(true); return; }
    if (last && this.#gap(last, at) < 3) return; // the second press of a double-click
    this.#set(this.#place(at));
  }

  #set(place) {
    this.draft.places.push(place);
    this.draft.isSet = true;
    this.#count();
    if (this.draft.tool === "ground" && this.draft.places.length === 2) this.finish(false);
    this.page.invalidate();
  }

  #count() { this.draft.canClose = this.draft.tool !== "ground" && this.draft.places.length > 2; }

  // ---- keys ---------------------------------------------------------------------------------------------------------

  key(key, event, arrow) {
    const { draft, page } = this;
    if (key === "Escape") { this.cancel(); return true; }
    if (key === "Backspace" || key === "Delete") {
      draft.places.pop();
      this.#count();
      page.invalidate();
      return true;
    }
    if (arrow) {
      const step = PEN_STEPS[event.shiftKey ? 0 : 1] / page.view.k;
      draft.next ??= draft.places[draft.places.length - 1] ?? this.#place([page.view.width / 2, page.view.height / 2]);
      draft.next = draft.next.map((v, c) => v + step * arrow[c]);
      Object.assign(draft, { isByKeys: true, isSet: false });
      page.speak(`pen at ${draft.next.map(shownLength).join(", ")}`);
      page.invalidate();
      return true;
    }
    if (key !== "Enter") return false;
    if (draft.isByKeys && !draft.isSet) {
      this.#set([...draft.next]);
      if (this.isOn) page.speak(`place ${draft.places.length} set`);
    } else this.finish(draft.tool === "part");
    return true;
  }

  // ---- the end ------------------------------------------------------------------------------------------------------

  // Makes the shape, or says why it cannot be one and goes on drawing.
  finish(isClosed) {
    const { draft, page } = this, { tool, places } = draft, least = isClosed || tool === "part" ? 3 : 2;
    if (places.length < least) { page.hint(`A ${PEN_WORDS[tool]} needs ${least} places at least`, 4000); return false; }
    const [a0, a1, b0, b1] = page.box;
    const region = tool === "ground" ? groundThrough(places[0], places[1], [(a0 + a1) / 2, (b0 + b1) / 2])
      : { kind: isClosed || tool === "part" ? "polygon" : "line", vertices: places };
    const fault = regionFault(region);
    if (fault) { page.say(fault.includes("crosses") ? `${fault} Draw it without a loop.` : fault, true); return false; }
    this.stop();
    page.addShape(tool === "cut" ? "cuts" : "parts", region, tool === "ground" ? "ground" : "");
    return true;
  }
}
