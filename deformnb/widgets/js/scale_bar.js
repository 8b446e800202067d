// How long things are on a picture: a bar of 1, 2 or 5 times a power of ten, as long as it is in the volume.

const BAR = { least: 44, most: 120, share: 0.22 }; // CSS pixels, and of the picture's width at most
const NO_SCALE = "In perspective no length holds for the whole picture: what is near is larger. Parallel views have a scale.";

/** The largest of 1, 2, 5 times a power of ten that is at most so long. */
function roundLength(most) {
  const ten = 10 ** Math.floor(Math.log10(most) + 1e-9), times = [5, 2, 1].find((n) => n * ten <= most * (1 + 1e-9)) ?? 1;
  return times * ten;
}

/** A round length with its unit: 50 mm, 20 m where mm would have five digits, 20 \u00b5m below a tenth of a mm. */
function lengthText(length, unit) {
  const [factor, name] = unit !== "mm" ? [1, unit] : length >= 1e4 ? [1e-3, "m"] : length < 0.1 ? [1e3, "\u00b5m"] : [1, unit];
  return `${Number((length * factor).toPrecision(1))} ${name}`;
}

class ScaleBar {
  constructor(root) {
    this.root = root;
    this.element = pageElement("div", "dnb-scale", root, { hidden: "" });
    this.text = pageElement("span", "dnb-scale-text", this.element);
    this.bar = pageElement("div", "dnb-scale-bar", this.element, { "aria-hidden": "true" });
  }

  /** height: the length in space that the picture is high; bend: of a perspective; unit: none shows no bar; parts: side by side. */
  write({ height, bend }, unit, parts = 1) {
    const { clientWidth, clientHeight } = this.root;
    this.element.hidden = !(unit && height > 0 && clientHeight > 0);
    if (this.element.hidden) return;
    this.element.classList.toggle("dnb-scale-none", bend > 0);
    this.element.title = bend > 0 ? NO_SCALE : "";
    if (bend > 0) { setText(this.text, "perspective"); return; }
    const pixel = height / clientHeight, most = Math.max(BAR.least, Math.min(BAR.most, (BAR.share * clientWidth) / parts));
    const length = roundLength(most * pixel);
    this.bar.style.width = `${(length / pixel).toFixed(1)}px`;
    setText(this.text, lengthText(length, unit));
  }
}
