// Small parts of a view's page: its size, captions and letters of directions, the page's theme, the turns of
// a picture that flickers.

const VIEW_NAMES = { "+y": "A", "-y": "P", "-x": "L", "+x": "R", "-z": "S", "+z": "I" };
const VIEW_TITLES = { A: "from the front", P: "from behind", L: "from the left", R: "from the right", S: "from above",
  I: "from below" };

const FLICKER_MS = 700; // long enough to look at one place, short enough to see it move

/** Gives a view's root the size that its model asks for, as far as there is room; returns its pixels. */
function sized(root, host, model) {
  const width = model.get("width"), height = model.get("height");
  root.style.width = `${width}px`;
  root.style.setProperty("--dnb-shape", `${width} / ${height}`);
  root.style.maxHeight = `${height}px`;
  root.classList.toggle("dnb-fill", Boolean(model.get("fill"))); // the size of the box it stands in instead
  host.style.minWidth = "0"; // in a row of widgets it gets narrower instead of being cut off
  const ratio = Math.min(2, window.devicePixelRatio || 1), box = root.getBoundingClientRect();
  return [(box.width || width) * ratio, (box.height || height) * ratio].map(Math.round);
}

/** A caption and four letters of directions over each picture that is seen: one, or two side by side. */
class Frames {
  constructor(root) {
    this.frames = [0, 1].map(() => {
      const frame = pageElement("div", "dnb-frame", root, { "aria-hidden": "true" });
      return { frame, caption: pageElement("div", "dnb-caption", frame),
        letters: ["left", "right", "top", "bottom"].map((side) => pageElement("span", `dnb-letter dnb-${side}`, frame)) };
    });
  }

  /** captions: one for each picture; empty shows none. */
  show(captions) {
    this.frames.forEach(({ frame, caption }, i) => {
      frame.hidden = i >= captions.length;
      frame.style.left = `${(100 * i) / captions.length}%`;
      frame.style.width = `${100 / captions.length}%`;
      caption.textContent = captions[i] || "";
      caption.hidden = !captions[i];
    });
  }

  write({ right, up }) {
    const texts = [sideOf(scaled(right, -1)), sideOf(right), sideOf(up), sideOf(scaled(up, -1))];
    for (const { letters } of this.frames) letters.forEach((letter, i) => { letter.textContent = texts[i]; });
  }
}

/** Whether the page around is dark: by Jupyter's word, by the colours of VS Code, else by the browser's preference. */
class PageTheme {
  constructor(root, changed) {
    this.probe = pageElement("span", "dnb-paper", root, { hidden: "" });
    this.dark = window.matchMedia("(prefers-color-scheme: dark)");
    this.changed = changed;
    this.dark.addEventListener("change", changed);
    this.observer = new MutationObserver(changed);
    this.observer.observe(document.body, { attributes: true, attributeFilter: ["class", "data-jp-theme-light",
      "data-jp-theme-name", "data-vscode-theme-kind"] });
  }

  get name() {
    const told = document.body.dataset.jpThemeLight; // Jupyter's own word: in Voila the colours come after the widgets
    if (told !== undefined) return told === "false" ? "dark" : "light";
    const [r, g, b, alpha = 1] = (getComputedStyle(this.probe).backgroundColor.match(/[\d.]+/g) ?? []).map(Number);
    const isDark = alpha > 0 && b !== undefined ? 0.2126 * r + 0.7152 * g + 0.0722 * b < 110 : this.dark.matches;
    return isDark ? "dark" : "light";
  }

  close() {
    this.dark.removeEventListener("change", this.changed);
    this.observer.disconnect();
  }
}

/** Turns between two layers, while it can be seen and motion is welcome; else a press turns them. */
class Flicker {
  constructor(root, flip) {
    Object.assign(this, { flip, layer: 0, isOn: false, isPaused: false, isSeen: true });
    this.still = window.matchMedia("(prefers-reduced-motion: reduce)");
    this.look = () => this.#run();
    this.still.addEventListener("change", this.look);
    document.addEventListener("visibilitychange", this.look);
    this.observer = new IntersectionObserver((entries) => { this.isSeen = entries.at(-1).isIntersecting; this.#run(); });
    this.observer.observe(root);
  }

  /** Starts or ends; either way the first layer is shown. */
  set(isOn) {
    this.isOn = isOn;
    this.isPaused = false;
    this.layer = 0;
    this.#run();
  }

  turn() {
    this.layer = 1 - this.layer;
    this.flip(this.layer);
  }

  /** Space: where nothing moves by itself it turns, elsewhere it stops and goes on. A click turns, never stops. */
  press(isKey) {
    if (!this.isOn) return false;
    if (this.still.matches) this.turn();
    else if (isKey) { this.isPaused = !this.isPaused; this.#run(); }
    return true;
  }

  #run() {
    clearInterval(this.timer);
    this.timer = 0;
    const isFree = this.isOn && !this.isPaused && this.isSeen && !document.hidden && !this.still.matches;
    if (isFree) this.timer = setInterval(() => this.turn(), FLICKER_MS);
  }

  close() {
    clearInterval(this.timer);
    this.isOn = false;
    this.still.removeEventListener("change", this.look);
    document.removeEventListener("visibilitychange", this.look);
    this.observer.disconnect();
  }
}
