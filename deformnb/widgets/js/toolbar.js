// The buttons over the picture, and the list of keys.

// Icons of 16 x 16, drawn with lines of the text's colour.
const ICONS = {
  add: "M8 3v10M3 8h10",
  remove: "M3.5 4.5h9M6.5 4.5v-2h3v2M5 4.5l.6 9h4.8l.6-9M7 7v4M9 7v4",
  rename: "M3 13l.6-2.8L10.8 3l2.2 2.2-7.2 7.2zM9.4 4.4l2.2 2.2",
  switch: "M8 2.5v5M5 4.2a5 5 0 1 0 6 0",
  cut: "M3.5 13.5L12 3M4 3l8.5 10.5M2.6 2.6a1.5 1.5 0 1 0 .1 0M13.3 2.6a1.5 1.5 0 1 0 .1 0",
  part: "M8 2.2l5.2 3.6-2 6.8H4.8l-2-6.8zM5.2 11l4.6-6M8 12.3l3.4-4.6",
  ground: "M1.5 9h13M3 13l3-4M7 13l3-4M11 13l3-4",
  turn: "M8 2v12M5.5 5L2.5 8l3 3M10.5 5l3 3-3 3",
  undo: "M6 3L3 6l3 3M3 6h6a3.5 3.5 0 0 1 0 7H6",
  redo: "M10 3l3 3-3 3M13 6H7a3.5 3.5 0 0 0 0 7h3",
  reset: "M3 8a5 5 0 1 0 1.6-3.7M3 2.5v3h3",
  net: "M3 3h10v10H3zM3 6.3h10M3 9.7h10M6.3 3v10M9.7 3v10",
  radius: "M8 8h.01M13 8A5 5 0 1 1 3 8a5 5 0 0 1 10 0M8 8l3.5-3.5",
  compare: "M3 3h10v10H3zM8 1.5v13M3.2 11l4-4M3.2 7l3-3",
  "zoom-in": "M11.4 11.4l3 3M12.5 7.2a5.2 5.2 0 1 1-10.4 0 5.2 5.2 0 0 1 10.4 0M7.3 5v4.4M5 7.2h4.5",
  "zoom-out": "M11.4 11.4l3 3M12.5 7.2a5.2 5.2 0 1 1-10.4 0 5.2 5.2 0 0 1 10.4 0M5 7.2h4.5",
  fit: "M2.5 6V2.5H6M10 2.5h3.5V6M13.5 10v3.5H10M6 13.5H2.5V10",
  go: "M8 1.5v4M8 10.5v4M1.5 8h4M10.5 8h4M8 8h.01",
  help: "M5.7 5.9a2.3 2.3 0 1 1 3.4 2c-.8.5-1.1.9-1.1 1.8M8 12.2v.1",
};

// command, label, tip, whether it stays pressed, what it needs: points, a selection, or history
const GROUPS = [
  [["add", "Add", "Add points: click where (A, or double-click)", true],
    ["remove", "Delete", "Delete the selected points, or the chosen shape (Del)", false, "selection"],
    ["rename", "Rename", "Name the selected point or shape (F2)", false, "one"],
    ["switch", "On/off", "Switch the selected points or shape on or off (O)", false, "selection"],
    ["reset", "Put back", "Put the selected points, or all, back where they were taken (Home)", false, "points"]],
  [["cut", "Cut", "Draw a cut, along which the picture comes apart (X)", true],
    ["part", "Rigid", "Draw around a part that stays rigid (P)", true],
    ["ground", "Ground", "Draw a line beyond which all stays where it is (G)", true],
    ["turn", "Turn over", "Turn the chosen line over to its other side (F)", false, "turns"]],
  [["undo", "Undo", "Undo (Ctrl+Z)", false, "past"], ["redo", "Redo", "Redo (Ctrl+Y)", false, "future"]],
  [["net", "Grid", "Show the deformed grid (N)", true], ["radius", "Radius", "Show how far points reach (R)", true],
    ["compare", "Before", "Show the picture as it was (C)", true]],
  [["zoom-out", "", "Zoom out (-)"], ["zoom-in", "", "Zoom in (+)"], ["fit", "Fit", "Show the whole picture (0)"]],
  [["help", "Keys", "Keys and gestures (?)", true]],
];

const HELP = [
  ["Double-click, A", "add a point"], ["Drag a disc", "move a feature"], ["Drag a ring", "where it was taken"],
  ["Alt + drag", "move both"],
  ["Del, right click", "delete"], ["Home, O", "put back, on or off"],
  ["F2, double-click", "rename a point"], ["Shift + click, band", "select several"],
  ["Ctrl + A, Esc", "select all, none"],
  ["Tab", "next point or line"], ["(Shift +) arrows", "move 1 (10) pixels"],
  ["Enter on a point", "select it"],
  ["Enter on the picture", "add a point in the middle"],
  ["X, P, G", "cut, rigid, ground"], ["Click a line", "reshape, F turns it"],
  ["Ctrl + Z, Ctrl + Y", "undo, redo"],
  ["Wheel, pinch, +, -", "zoom"], ["Space, middle drag", "move the view"],
  ["0", "whole picture"], ["N, R, C, V", "grid, radius, before, overlay"],
];

class Toolbar {
  constructor(page, parent, groups = GROUPS) {
    this.root = pageElement("div", "dnb-ed-bar", parent, { role: "toolbar", "aria-label": "Control points" });
    this.buttons = new Map();
    for (const group of groups) {
      const box = pageElement("div", "dnb-ed-group", this.root, { role: "group" });
      for (const [command, label, tip, stays, needs] of group) {
        const button = pageElement("button", "dnb-ed-button", box, { type: "button", title: tip, "aria-label": tip,
          ...OWN_KEYS });
        const icon = svgElement("svg", { viewBox: "0 0 16 16", "aria-hidden": "true", focusable: "false" }, button);
        svgElement("path", { d: ICONS[command] }, icon);
        if (label) pageElement("span", "dnb-ed-label", button).textContent = label;
        if (stays) button.setAttribute("aria-pressed", "false");
        button.dataset.command = command;
        button.tabIndex = this.buttons.size ? -1 : 0; // one stop for Tab, arrows between the buttons
        button.addEventListener("click", () => page.guard(() => page.run(command, null)));
        this.buttons.set(command, { button, tip, needs });
      }
    }
  }

  update({ count, selected, turns, past, future, steps, pressed, readOnly }) {
    const met = { points: count > 0, selection: selected > 0, one: selected === 1, turns, past, future };
    const edits = ["add", "cut", "part", "ground", "turn", "remove", "rename", "switch", "reset", "undo", "redo"];
    for (const [command, { button, tip, needs }] of this.buttons) {
      const isOff = (needs !== undefined && !met[needs]) || (readOnly && edits.includes(command));
      if (button.ariaDisabled !== String(isOff)) button.setAttribute("aria-disabled", String(isOff));
      if (needs === "past" || needs === "future") this.#say(button, tip, steps[command]);
      if (button.hasAttribute("aria-pressed")) button.setAttribute("aria-pressed", String(pressed.includes(command)));
    }
  }

  // Where Python owns the history, the tip says what would be undone.
  #say(button, tip, step) {
    const text = step ? tip.replace(" (", ` ${step} (`) : tip;
    if (button.title === text) return;
    button.title = text;
    button.setAttribute("aria-label", text);
  }

  isOff(command) { return this.buttons.get(command)?.button.getAttribute("aria-disabled") === "true"; }

  focusNext(button, key) {
    if (key === "ArrowUp" || key === "ArrowDown") return false;
    const all = [...this.buttons.values()].map((b) => b.button), at = all.indexOf(button);
    const next = all[(at + (key === "ArrowRight" ? 1 : -1) + all.length) % all.length];
    for (const other of all) other.tabIndex = other === next ? 0 : -1;
    next.focus();
    return true;
  }
}

function helpPanel(parent, entries = HELP) {
  const panel = pageElement("div", "dnb-ed-help", parent, { role: "dialog", "aria-label": "Keys and gestures", hidden: "",
    tabindex: "-1", ...OWN_KEYS });
  const list = pageElement("div", "dnb-ed-entries", panel, { role: "list", "aria-label": "Keys" });
  for (const [keys, what] of entries) {
    const row = pageElement("div", "dnb-ed-entry", list, { role: "listitem", "aria-label": `${keys}: ${what}` });
    pageElement("span", "", row).textContent = keys;
    pageElement("span", "", row).textContent = what;
  }
  return panel;
}
