// What a hand can take hold of besides points and shapes: the handle that turns what is selected, and the axis of a
// mirror. And the circle of the brush, which shows where it works.

const TURN_AWAY = 38; // CSS pixels from the middle of the selection, or from its upper edge, to the handle
const GRIP_AWAY = 14; // from the edge of the view to the grip of the axis

class HandMarks {
  constructor(svg, points) {
    this.root = svgElement("g", { class: "dnb-ed-marks" });
    svg.insertBefore(this.root, points); // under the points, which come first under a hand
    this.axis = svgElement("g", { class: "dnb-ed-axis", visibility: "hidden" }, this.root);
    this.lines = ["case", "line"].map((name) => svgElement("path", { class: `dnb-ed-axis-${name}` }, this.axis));
    this.grip = svgElement("g", { "data-mark": "axis", class: "dnb-ed-axis-grip", tabindex: "-1", role: "slider",
      "aria-label": "axis of the mirror", ...OWN_KEYS }, this.axis);
    svgElement("circle", { r: 16, class: "dnb-ed-hit" }, this.grip);
    svgElement("rect", { x: -9, y: -9, width: 18, height: 18, rx: 4 }, this.grip);
    this.gripIcon = svgElement("path", { d: "M0-6.5V6.5M-3-3.5L-6.5 0-3 3.5M3-3.5L6.5 0 3 3.5" }, this.grip);
    svgElement("title", {}, this.grip).textContent = "Drag the axis of the mirror";
    this.turn = svgElement("g", { "data-mark": "turn", class: "dnb-ed-turn", visibility: "hidden" }, this.root);
    this.stalk = svgElement("path", { class: "dnb-ed-turn-stalk" }, this.turn);
    this.knob = svgElement("g", {}, this.turn);
    svgElement("circle", { r: 14, class: "dnb-ed-hit" }, this.knob);
    svgElement("circle", { r: 8, class: "dnb-ed-turn-disc" }, this.knob);
    svgElement("path", { d: "M4.2-1.6A4.5 4.5 0 1 0 4 2.2M4.6-4.6V-1.4H1.4", class: "dnb-ed-turn-arrow" }, this.knob);
    svgElement("title", {}, this.turn).textContent = "Turn what is selected; Alt scales it, Shift goes in steps";
    this.brush = svgElement("g", { class: "dnb-ed-circle", visibility: "hidden", "aria-hidden": "true" }, svg);
    this.circles = ["case", "line"].map((name) => svgElement("circle", { class: `dnb-ed-circle-${name}` }, this.brush));
  }

  update(page) {
    this.#axis(page);
    this.#turn(page);
    const { brush, view } = page, isShown = brush.isOn && brush.at !== null && !page.isLocked;
    this.brush.setAttribute("visibility", isShown ? "visible" : "hidden");
    if (!isShown) return;
    for (const circle of this.circles) {
      setAttributes(circle, { cx: brush.at[0].toFixed(1), cy: brush.at[1].toFixed(1), r: (brush.radius * view.k).toFixed(1) });
    }
  }

  #axis({ mirror, view, isLocked, gripAway = GRIP_AWAY }) {
    const isShown = mirror.on && !isLocked;
    this.axis.setAttribute("visibility", isShown ? "visible" : "hidden");
    this.grip.setAttribute("tabindex", isShown ? "0" : "-1");
    if (!isShown) return;
    const isUpright = mirror.axis === "a", at = isUpright ? view.k * mirror.at + view.x : view.k * mirror.at + view.y;
    const line = isUpright ? `M ${at.toFixed(1)} 0 V ${view.height}` : `M 0 ${at.toFixed(1)} H ${view.width}`;
    for (const path of this.lines) path.setAttribute("d", line);
    const place = isUpright ? [at, gripAway] : [gripAway, at];
    this.grip.setAttribute("transform", `translate(${place.map((v) => v.toFixed(1)).join(" ")})${isUpright ? "" : " rotate(90)"}`);
    setAttributes(this.grip, { "aria-valuenow": shownLength(mirror.at),
      "aria-orientation": isUpright ? "horizontal" : "vertical" });
  }

  // Above what is selected: the middle of it is the middle of the turn.
  #turn(page) {
    const { view, selected, points } = page, chosen = points.filter((p) => selected.has(p.id) && !p.locked);
    const isShown = chosen.length > 0 && !page.isLocked && !page.isHolding && !page.brush.isOn && !page.pen.isOn && !page.isAdding;
    this.turn.setAttribute("visibility", isShown ? "visible" : "hidden");
    if (!isShown) return;
    const [x, y] = page.onView(middleOf(chosen)), ys = chosen.map((p) => page.onView(p.target)[1]);
    const up = Math.min(...ys) - TURN_AWAY, down = Math.max(...ys) + TURN_AWAY;
    const end = up > 12 ? up : Math.min(view.height - 12, down);
    this.stalk.setAttribute("d", `M ${x.toFixed(1)} ${y.toFixed(1)} V ${end.toFixed(1)}`);
    this.knob.setAttribute("transform", `translate(${x.toFixed(1)} ${end.toFixed(1)})`);
  }
}
