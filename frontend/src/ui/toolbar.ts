// The buttons over the picture, and the menu of those that are rarely used.

import { buttonElement, iconElement, named, pageElement, setAttributes } from "./dom.ts";
import type { KeyTable } from "./keys.ts";
import { EDITOR_KEYS, keyWords, shortcutsOf, tipOf } from "./keys.ts";

/** A tool: `stays` means that its button remains pressed, `needs` that it needs points, a selection, history, ... */
export type ToolEntry = [command: keyof typeof ICONS, label: string, tip: string, stays?: boolean, needs?: Need];
export type Need = "points" | "selection" | "points_selected" | "one" | "turns" | "past" | "future";

/** The editor around a toolbar: `guard` reports an error of f, `run` does a command. */
export type ToolbarHost = { guard: (f: () => void) => void; run: (command: string, focused: null) => void };

/** Icons of 16 x 16, drawn with lines of the text's colour. */
const ICONS = {
  add: "M8 3v10M3 8h10",
  select: "M2.5 5V2.5H5M8 2.5h3M13.5 4.5V6M2.5 8v3M2.5 13.5H6M8 7l6 2.4-2.6 1L10.3 13z",
  remove: "M3.5 4.5h9M6.5 4.5v-2h3v2M5 4.5l.6 9h4.8l.6-9M7 7v4M9 7v4",
  rename: "M3 13l.6-2.8L10.8 3l2.2 2.2-7.2 7.2zM9.4 4.4l2.2 2.2",
  switch: "M8 2.5v5M5 4.2a5 5 0 1 0 6 0",
  cut: "M3.5 13.5L12 3M4 3l8.5 10.5M2.6 2.6a1.5 1.5 0 1 0 .1 0M13.3 2.6a1.5 1.5 0 1 0 .1 0",
  part: "M8 2.2l5.2 3.6-2 6.8H4.8l-2-6.8zM5.2 11l4.6-6M8 12.3l3.4-4.6",
  wand: "M2.5 13.5L9 7M10.5 2v2.4M10.5 7.6V10M6.6 6h2.3M12.1 6h2.4M13.3 3.2l-1 1M7.7 3.2l1 1M13.3 8.8l-1-1",
  fixed: "M1.5 9h13M3 13l3-4M7 13l3-4M11 13l3-4",
  straighten: "M2.5 13.5C3 7.5 5.5 4.5 8 4.5S12.5 3 13 1.8M2.5 8.5h.02M6 10.5l7.5-2.2M11.3 7l2.2 1.3-1.5 2.1",
  hinge: "M8 9.8a1.8 1.8 0 1 1 .02 0M6.3 7.2L1.8 4.4M9.8 7.2L14.2 4.4M12.6 10.6c-.8 1.8-2.4 2.9-4.4 3M8.2 13.6l1.6-1.4",
  turn: "M8 2v12M5.5 5L2.5 8l3 3M10.5 5l3 3-3 3",
  undo: "M6 3L3 6l3 3M3 6h6a3.5 3.5 0 0 1 0 7H6",
  redo: "M10 3l3 3-3 3M13 6H7a3.5 3.5 0 0 0 0 7h3",
  reset: "M3 8a5 5 0 1 0 1.6-3.7M3 2.5v3h3",
  grid: "M3 3h10v10H3zM3 6.3h10M3 9.7h10M6.3 3v10M9.7 3v10",
  radius: "M8 8h.01M13 8A5 5 0 1 1 3 8a5 5 0 0 1 10 0M8 8l3.5-3.5",
  compare: "M3 3h10v10H3zM8 1.5v13M3.2 11l4-4M3.2 7l3-3",
  "zoom-in": "M11.4 11.4l3 3M12.5 7.2a5.2 5.2 0 1 1-10.4 0 5.2 5.2 0 0 1 10.4 0M7.3 5v4.4M5 7.2h4.5",
  "zoom-out": "M11.4 11.4l3 3M12.5 7.2a5.2 5.2 0 1 1-10.4 0 5.2 5.2 0 0 1 10.4 0M5 7.2h4.5",
  window: "M13.5 8a5.5 5.5 0 1 1-11 0 5.5 5.5 0 0 1 11 0M8 2.5v11M8 5h4.4M8 8h5.4M8 11h4.4",
  fit: "M2.5 6V2.5H6M10 2.5h3.5V6M13.5 10v3.5H10M6 13.5H2.5V10",
  go: "M8 1.5v4M8 10.5v4M1.5 8h4M10.5 8h4M8 8h.01",
  move: "M3 13.5c0-3 2-2.6 3.4-4l5.2-5.2a1.3 1.3 0 0 1 1.9 1.9L8.3 11.4C6.9 12.8 6 13.5 3 13.5zM7.6 8.3l1.9 1.9",
  grow:
    "M10.4 8a2.4 2.4 0 1 1-4.8 0 2.4 2.4 0 0 1 4.8 0M8 3.6V1.4M8 14.6v-2.2M3.6 8H1.4M14.6 8h-2.2M3.3 3.3l1.5 1.5" +
    "M12.7 12.7l-1.5-1.5M12.7 3.3l-1.5 1.5M3.3 12.7l1.5-1.5",
  lock: "M4 7.5h8v6H4zM5.5 7.5V5a2.5 2.5 0 0 1 5 0v2.5",
  mirror: "M8 1.5v13M6 4L2 12h4zM10 4l4 8h-4z",
  "mirror-axis": "M1.5 8h13M4 6l8-4v4zM4 10l8 4v-4z",
  snap: "M2.5 2.5v11h11M6 13.5v-2M9.5 13.5v-2M2.5 10h2M2.5 6.5h2M9 6.5h.02M12 3.5h.02M12 6.5h.02M9 3.5h.02",
  stop: "M5.3 1.8h5.4l3.5 3.5v5.4l-3.5 3.5H5.3l-3.5-3.5V5.3zM5 8h6",
  "turn-left": "M3 7a5 5 0 1 1 1.6 4.6M3 3v4h4",
  "turn-right": "M13 7a5 5 0 1 0-1.6 4.6M13 3v4H9",
  more: "M3.5 8h.02M8 8h.02M12.5 8h.02",
  help: "M5.7 5.9a2.3 2.3 0 1 1 3.4 2c-.8.5-1.1.9-1.1 1.8M8 12.2v.1",
};

const GROUPS: ToolEntry[][] = [
  [
    ["add", "Add", "Add points: press on a feature and drag it, or click", true],
    ["select", "Select", "Select several points: drag a band, or tap them", true],
    ["remove", "Delete", "Delete the selected points, or the chosen shape", false, "selection"],
    ["rename", "Rename", "Name the selected point or shape", false, "one"],
    ["switch", "On/off", "Switch the selected points or shape on or off", false, "selection"],
    ["reset", "Put back", "Put the selected points, or all, back where they were taken", false, "points"],
  ],
  [
    ["move", "Move", "Move brush: drag what lies under it", true],
    ["grow", "Grow", "Grow brush: drag right to grow what lies under it, left to shrink it", true],
  ],
  [
    ["cut", "Cut", "Draw a cut, along which the picture comes apart", true],
    ["part", "Rigid", "Draw around a part that stays rigid", true],
    ["wand", "Wand", "Click on what becomes a rigid part or a cut", true],
    ["fixed", "Fixed side", "Draw a line: all on one side of it stays fixed", true],
    ["straighten", "Straighten", "Draw a line along what is bent: it becomes straight", true],
    ["hinge", "Hinge", "Drag from a joint along the side that turns, then turn it", true],
  ],
  [
    ["undo", "Undo", "Undo", false, "past"],
    ["redo", "Redo", "Redo", false, "future"],
  ],
  [["stop", "Safe drag", "Stop drags before tissue folds", true]],
  [
    ["grid", "Grid", "Show the deformed grid", true],
    ["compare", "Before", "Show the picture as it was", true],
    ["window", "Window", "Change the window: drag left and right for its width, up and down for its level", true],
  ],
  [["fit", "Fit", "Fit the object; again, the whole picture"]],
  [
    ["more", "More", "More tools", false],
    ["help", "Keys", "Keys and gestures", true],
  ],
];

/** The menu: groups of the same, each with the words of its line. */
const MORE: ToolEntry[][] = [
  [
    ["mirror", "Mirror", "Do the same on both sides of a line", true],
    ["mirror-axis", "Mirror in the other direction", "Make the line of the mirror horizontal or vertical", false],
    ["snap", "Snap to the grid", "Targets keep to the nodes of the grid", true],
    ["lock", "Lock the selected", "Lock the selected points, or free them", true, "selection"],
  ],
  [
    [
      "turn-left",
      "Turn left by 15\u00b0",
      "Turn the selected points to the left; one point turns the tissue around it",
      false,
      "points_selected",
    ],
    ["turn-right", "Turn right by 15\u00b0", "Turn the selected points to the right", false, "points_selected"],
    ["turn", "Swap sides", "Swap the sides of the chosen line", false, "turns"],
  ],
  [
    ["radius", "Reach of points", "Show how far points reach", true],
    ["zoom-in", "Zoom in", "Zoom in", false],
    ["zoom-out", "Zoom out", "Zoom out", false],
  ],
];

/** The commands that are disabled for points that are only shown. */
export const EDITS = [
  "add",
  "cut",
  "part",
  "wand",
  "fixed",
  "straighten",
  "hinge",
  "turn",
  "remove",
  "rename",
  "switch",
  "reset",
  "undo",
  "redo",
  "move",
  "grow",
  "lock",
  "turn-left",
  "turn-right",
];

export class Toolbar {
  root: HTMLDivElement;
  buttons = new Map<string, { button: HTMLButtonElement; tip: string; needs?: Need; isItem?: boolean }>();
  menu: MoreMenu | null;

  constructor(
    host: ToolbarHost,
    parent: HTMLElement,
    groups: ToolEntry[][] = GROUPS,
    table: KeyTable = EDITOR_KEYS,
    more: ToolEntry[][] = MORE,
  ) {
    this.root = pageElement("div", "dnb-ed-bar", parent, { role: "toolbar", "aria-label": "Control points" });
    for (const group of groups) {
      const box = pageElement("div", "dnb-ed-group", this.root, { role: "group" });
      for (const [command, label, text, stays, needs] of group) {
        const tip = tipOf(table, command, text);
        const act = () => (command === "more" ? this.menu?.toggle() : host.run(command, null));
        const button = this.#button("dnb-ed-button", box, command, tip, table, () => host.guard(act));
        if (label) pageElement("span", "dnb-ed-label", button, {}, label);
        if (stays) button.setAttribute("aria-pressed", "false");
        button.tabIndex = this.buttons.size ? -1 : 0; // one stop for Tab, arrows between the buttons
        this.buttons.set(command, { button, tip, needs });
      }
    }
    const opener = this.buttons.get("more")?.button;
    const items = () => more.map((entries) => entries.map((entry) => this.#item(entry, table)));
    this.menu = opener ? new MoreMenu(host, opener, parent, items()) : null;
  }

  #button(
    name: string,
    parent: Element | null,
    command: keyof typeof ICONS,
    tip: string,
    table: KeyTable,
    act: () => void = () => {},
  ) {
    const keys = shortcutsOf(table, command);
    const icon = iconElement(ICONS[command]);
    if (command === "more") icon.firstElementChild?.setAttribute("stroke-width", "2.6");
    return buttonElement(name, parent, icon, act, {
      ...named(tip),
      "data-command": command,
      ...(keys ? { "aria-keyshortcuts": keys } : {}),
    });
  }

  /** A line of the menu. */
  #item([command, label, text, stays, needs]: ToolEntry, table: KeyTable) {
    const tip = tipOf(table, command, text),
      item = this.#button("dnb-ed-item", null, command, tip, table);
    setAttributes(item, {
      role: stays ? "menuitemcheckbox" : "menuitem",
      tabindex: "-1",
      ...(stays ? { "aria-checked": "false" } : {}),
    });
    item.removeAttribute("aria-label"); // its words are its name
    pageElement("span", "", item, {}, label);
    pageElement("span", "dnb-ed-item-key", item, { "aria-hidden": "true" }, keyWords(table, command));
    this.buttons.set(command, { button: item, tip, needs, isItem: true });
    return item;
  }

  /** Enable and press the buttons by the state of the editor. `steps` are the words for the next undo and redo. */
  update({
    count,
    selected,
    pointsSelected = selected,
    turns = false,
    past,
    future,
    steps,
    pressed,
    readOnly,
  }: {
    count: number;
    selected: number;
    pointsSelected?: number;
    turns?: boolean;
    past: boolean;
    future: boolean;
    steps: Record<string, string>;
    pressed: string[];
    readOnly: boolean;
  }) {
    const met = {
      points: count > 0,
      selection: selected > 0,
      points_selected: pointsSelected > 0,
      one: selected === 1,
      turns,
      past,
      future,
    };
    for (const [command, { button, tip, needs }] of this.buttons) {
      const isOff = (needs !== undefined && !met[needs]) || (readOnly && EDITS.includes(command));
      if (button.ariaDisabled !== String(isOff)) button.setAttribute("aria-disabled", String(isOff));
      if (needs === "past" || needs === "future") this.#labelStep(button, tip, steps[command]);
      for (const state of ["aria-pressed", "aria-checked"]) {
        if (button.hasAttribute(state)) button.setAttribute(state, String(pressed.includes(command)));
      }
    }
  }

  /** Set the tip of a button. Where Python owns the history, it names the step that would be undone. */
  #labelStep(button: HTMLElement, tip: string, step: string | undefined) {
    const text = step ? tip.replace(" (", ` ${step} (`) : tip;
    if (button.title === text) return;
    button.title = text;
    button.setAttribute("aria-label", text);
  }

  /** Hide a button where there is no such tool. */
  hide(command: string, isHidden: boolean) {
    const button = this.buttons.get(command)?.button;
    if (button) button.hidden = isHidden;
  }

  isOff(command: string) {
    return this.buttons.get(command)?.button.getAttribute("aria-disabled") === "true";
  }

  /** Move the focus from a button to its neighbour; false for keys that do not. */
  focusNext(button: Element & HTMLOrSVGElement, key: string) {
    if (key === "ArrowUp" || key === "ArrowDown") return false;
    const all: (Element & HTMLOrSVGElement)[] = [...this.buttons.values()]
        .filter((b) => !b.isItem && !b.button.hidden)
        .map((b) => b.button),
      at = all.indexOf(button);
    const next = all[(at + (key === "ArrowRight" ? 1 : -1) + all.length) % all.length]!;
    for (const other of all) other.tabIndex = other === next ? 0 : -1;
    next.focus();
    return true;
  }
}

/** A menu of tools under its button; it closes when an item is chosen, by Escape, and when the focus leaves it. */
class MoreMenu {
  items: HTMLElement[];
  root: HTMLDivElement;
  isOverAll: boolean;
  leave: (event: Event) => void;

  constructor(
    readonly host: ToolbarHost,
    readonly opener: HTMLElement,
    readonly parent: HTMLElement,
    groups: HTMLElement[][],
  ) {
    this.items = groups.flat();
    setAttributes(opener, { "aria-haspopup": "menu", "aria-expanded": "false" });
    this.root = pageElement("div", "dnb-ed-more", parent, {
      role: "menu",
      "aria-label": "More tools",
      hidden: "",
    });
    this.isOverAll = typeof this.root.showPopover === "function"; // older browsers show it inside the editor
    if (this.isOverAll) this.root.popover = "manual";
    groups.forEach((group, k) => {
      if (k > 0) pageElement("div", "dnb-ed-line", this.root, { "aria-hidden": "true" });
      this.root.append(...group);
    });
    this.root.addEventListener("click", ({ target }) => host.guard(() => this.#choose(target)));
    this.root.addEventListener("keydown", (event) => host.guard(() => this.#key(event)));
    // Safari gives no focus to a button that is pressed: the menu would lose it, and close before the click.
    for (const part of [this.root, opener])
      part.addEventListener("mousedown", (event) => {
        if (this.isOpen) event.preventDefault();
      });
    this.root.addEventListener("focusout", ({ relatedTarget: next }) =>
      host.guard(() => {
        if (!(next instanceof Node && this.root.contains(next)) && next !== this.opener) this.close(false);
      }),
    );
    this.leave = ({ target }) => {
      if (target !== this.root) this.close();
    }; // it would not move with its scrolling parent
  }

  get isOpen() {
    return !this.root.hidden;
  }

  toggle() {
    if (this.isOpen) {
      this.close();
      return;
    }
    this.root.hidden = false;
    if (this.isOverAll) this.root.showPopover();
    this.opener.setAttribute("aria-expanded", "true");
    this.#place();
    this.items[0]!.focus({ preventScroll: true });
    for (const name of ["scroll", "resize"]) window.addEventListener(name, this.leave, { capture: true });
  }

  // Under its button, as far as there is room.
  #place() {
    const box = this.opener.getBoundingClientRect(),
      around = this.parent.getBoundingClientRect();
    const frame = this.isOverAll ? { left: 0, top: 0, width: window.innerWidth } : around;
    const left = Math.min(box.left - frame.left, frame.width - this.root.offsetWidth - 8);
    const top = box.bottom - frame.top + 2;
    const room = this.isOverAll ? window.innerHeight - this.root.offsetHeight - 8 : top;
    Object.assign(this.root.style, { left: `${Math.max(4, left)}px`, top: `${Math.max(4, Math.min(top, room))}px` });
  }

  close(givesBack = true) {
    if (!this.isOpen) return;
    for (const name of ["scroll", "resize"]) window.removeEventListener(name, this.leave, { capture: true });
    const place = this.root.getRootNode() as Document | ShadowRoot;
    const hadFocus = this.root.contains(place.activeElement);
    this.root.hidden = true; // a second close, by the focus that leaves, finds it closed
    if (this.isOverAll && this.root.isConnected) this.root.hidePopover();
    this.opener.setAttribute("aria-expanded", "false");
    if (givesBack && hadFocus) this.opener.focus({ preventScroll: true });
  }

  #choose(target: EventTarget | null) {
    const item = target instanceof Element ? target.closest(".dnb-ed-item") : null;
    const command = item?.getAttribute("data-command");
    if (!item || !command || item.getAttribute("aria-disabled") === "true") return;
    this.close();
    this.host.run(command, null);
  }

  #key(event: KeyboardEvent) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { items } = this,
      at = event.target instanceof HTMLElement ? items.indexOf(event.target) : -1;
    const places: Record<string, number> = {
      ArrowDown: at + 1,
      ArrowUp: at - 1 + items.length,
      Home: 0,
      End: items.length - 1,
    };
    const next: number | undefined = places[event.key];
    if (next !== undefined) items[next % items.length]!.focus();
    else if (event.key === "Escape") this.close();
    else if (event.key !== "Enter" && event.key !== " ") {
      if (event.key !== "Tab") event.stopPropagation();
      return;
    }
    event.stopPropagation(); // Enter and space click by themselves
    if (next !== undefined || event.key === "Escape") event.preventDefault();
  }
}
