// The keys and gestures of the editors: one table for the handlers, the list on "?", and the tips of the buttons.

import { OWN_KEYS, pageElement, treeOf } from "./dom.ts";

/**
 * `keys` are those of the handlers, letters small, "Shift+" and "Alt+" before the keys that need them.
 */
export type KeyRow = [shown: string, what: string, about?: { command?: string; keys: string[] }];
export type KeyTable = [title: string, rows: KeyRow[]][];

const MANY_KEYS: KeyRow[] = [
  ["Drag a disc", "move a feature"],
  ["Drag a ring", "where it was taken"],
  ["Alt + drag, arrows", "move both"],
  ["Del, right click", "delete", { command: "remove", keys: ["Delete", "Backspace"] }],
  ["Home", "put back", { command: "reset", keys: ["Home"] }],
  ["O", "switch on or off", { command: "switch", keys: ["o"] }],
  ["L", "lock, unlock", { command: "lock", keys: ["l"] }],
];

const CHOICE_KEYS: KeyRow[] = [
  ["Shift + click", "add to the selected"],
  ["Ctrl + A", "select all", { command: "select-all", keys: ["Control+a"] }],
  ["Esc", "select none, cancel", { keys: ["Escape"] }],
  ["B", "select several: band, taps", { command: "select", keys: ["b"] }],
  ["Tab", "to the points, to each line", { keys: ["Tab"] }],
  [
    "Ctrl + arrows",
    "next point, the one before",
    { keys: ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"].map((key) => `Control+${key}`) },
  ],
  ["Enter on a point", "select it", { keys: ["Enter"] }],
];

const VOLUME_KEYS: KeyRow[] = [
  ["Double-click, double tap", "put a point on what is seen"],
  ["Drag a disc", "in the view's plane, or along the surface"],
  ["Drag an arrow", "along that axis"],
  ["Wheel on it, Alt + wheel", "along the ray"],
  ["Page up, down on it", "deeper, nearer by 1 (10) voxels"],
  ["E", "edit this view"],
  ["0", "camera as at first"],
];

const HISTORY_KEYS: KeyRow[] = [
  ["Ctrl + Z", "undo", { command: "undo", keys: ["Control+z"] }],
  ["Ctrl + Y", "redo", { command: "redo", keys: ["Control+y", "Control+Shift+z"] }],
];

const HELP_KEY: KeyRow = ["?", "this list", { command: "help", keys: ["?"] }];

export const EDITOR_KEYS: KeyTable = [
  [
    "Points",
    [
      ["Double-click, A", "add a point; after A press and drag", { command: "add", keys: ["a"] }],
      ["Enter on the picture", "add a point in the middle", { keys: ["Enter"] }],
      ...MANY_KEYS,
      ["F2, double-click", "rename", { command: "rename", keys: ["F2"] }],
      ["(Shift +) arrows", "move 1 (10) pixels", { keys: ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"] }],
    ],
  ],
  ["In the volume", VOLUME_KEYS],
  [
    "Several points",
    [
      ["Drag on the picture", "select by a band"],
      ...CHOICE_KEYS,
      [", and .", "turn by 2\u00b0, with Shift 15\u00b0", { command: "rotate", keys: [",", "."] }],
      ["Drag the round arrow", "turn; Alt scales, Shift in steps"],
      ["Alt + , and .", "scale by 2 %, with Shift 15 %", { command: "scale", keys: ["Alt+,", "Alt+."] }],
    ],
  ],
  [
    "Brushes",
    [
      ["S", "move: drag what lies under it", { command: "move", keys: ["s"] }],
      ["E", "grow: drag right; left shrinks", { command: "grow", keys: ["e"] }],
      ["[ and ], wheel", "radius of the brush", { command: "brush-radius", keys: ["[", "]"] }],
    ],
  ],
  [
    "Helpers",
    [
      ["M", "mirror: both sides move", { command: "mirror", keys: ["m"] }],
      ["Shift + M", "mirror in the other direction", { command: "mirror-axis", keys: ["Shift+m"] }],
      ["Shift + N", "snap to the grid; Alt does not", { command: "snap", keys: ["Shift+n"] }],
      ["T", "stop drags before tissue folds", { command: "stop", keys: ["t"] }],
    ],
  ],
  [
    "Cuts and rigid parts",
    [
      ["X", "draw a cut", { command: "cut", keys: ["x"] }],
      ["P", "draw a rigid part", { command: "part", keys: ["p"] }],
      ["G", "draw a fixed side", { command: "fixed", keys: ["g"] }],
      ["Q", "wand; [ and ] its tolerance", { command: "wand", keys: ["q"] }],
      ["Click a line", "reshape it"],
      ["Double-click an end", "let the cut stop there, or go on"],
      ["Drag inside a part", "move it; its ring turns it"],
      ["(Shift +) arrows on it", "move it by 1 (10) pixels"],
      [", and . on a part", "turn it by 1\u00b0, with Shift 15\u00b0"],
      ["Home on a part", "put it back"],
      ["F", "swap the sides of a line", { command: "turn", keys: ["f"] }],
    ],
  ],
  [
    "View",
    [
      ["Wheel, pinch, +, -", "zoom", { command: "zoom", keys: ["+", "=", "-"] }],
      ["Space, middle drag", "move the view", { keys: [" "] }],
      ["0", "whole picture", { command: "fit", keys: ["0"] }],
      ["N", "grid", { command: "grid", keys: ["n"] }],
      ["R", "reach of points", { command: "radius", keys: ["r"] }],
      ["C", "before", { command: "compare", keys: ["c"] }],
      ["V", "overlay", { command: "overlay", keys: ["v"] }],
      ["W", "window: drag, arrows, Home", { command: "window", keys: ["w"] }],
      ["Right drag", "width and level of the window"],
      ["Wheel, Page up, down", "other slices; Ctrl + wheel zooms", { keys: ["PageUp", "PageDown"] }],
      ...HISTORY_KEYS,
      HELP_KEY,
    ],
  ],
];

export const SPACE_EDITOR_KEYS: KeyTable = [
  [
    "Points",
    [
      ["Double-click, A", "add a point on the slice, or on what is seen", { command: "add", keys: ["a"] }],
      ["Enter on a picture", "add a point at the cross-hair", { keys: ["Enter"] }],
      ...MANY_KEYS,
      ["F2", "rename", { command: "rename", keys: ["F2"] }],
      [
        "Arrows",
        "move by one voxel: points, else the cross-hair",
        { keys: ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"] },
      ],
      ["Shift + arrows", "move by ten"],
      ["Alt + Page up, down", "move points across the slices", { keys: ["Alt+PageUp", "Alt+PageDown"] }],
    ],
  ],
  ["In the volume", [...VOLUME_KEYS, ["X, Y, Z in a drag", "along that axis only"]]],
  [
    "Several points",
    [
      ["Shift + drag", "select by a band"],
      ...CHOICE_KEYS,
      [", and .", "turn in the picture by 2\u00b0, with Shift 15\u00b0", { command: "rotate", keys: [",", "."] }],
      ["Drag the round arrow", "turn; Alt scales, Shift in steps"],
      ["Alt + , and .", "scale by 2 %, with Shift 15 %", { command: "scale", keys: ["Alt+,", "Alt+."] }],
    ],
  ],
  [
    "Brushes",
    [
      ["S", "move: drag what lies in its ball", { command: "move", keys: ["s"] }],
      ["E", "grow: drag right; left shrinks", { command: "grow", keys: ["e"] }],
      ["[ and ], wheel", "radius of the brush", { command: "brush-radius", keys: ["[", "]"] }],
    ],
  ],
  [
    "Helpers",
    [
      ["M", "mirror: both sides move", { command: "mirror", keys: ["m"] }],
      ["Shift + M", "mirror across the next axis", { command: "mirror-axis", keys: ["Shift+m"] }],
      ["Shift + N", "snap to a lattice; Alt does not", { command: "snap", keys: ["Shift+n"] }],
      ["T", "stop drags before tissue folds", { command: "stop", keys: ["t"] }],
    ],
  ],
  [
    "Cuts and rigid parts",
    [
      ["P", "draw a rigid part", { command: "part", keys: ["p"] }],
      ["Click a line", "choose the part"],
      ["Drag inside a part", "move it; its ring turns it"],
      ["(Shift +) arrows on it", "move it by 1 (10) voxels"],
      [", and . on a part", "turn it by 1\u00b0, with Shift 15\u00b0"],
      ["Home on a part", "put it back"],
      ["Wand", "on a picture only: choose a step that has one"],
    ],
  ],
  [
    "Slices",
    [
      ["Wheel, Page up, down", "go through the slices", { keys: ["PageUp", "PageDown"] }],
      ["J, double-click a point", "bring the slices to it", { command: "go", keys: ["j"] }],
      ["Click, drag a line", "move the cross-hair"],
      ["Click a title", "this slice large, or all of one size"],
      ["Right drag", "width and level of the window"],
      ["W", "automatic window", { command: "window", keys: ["w"] }],
    ],
  ],
  [
    "View",
    [
      ["Ctrl + wheel, +, -", "zoom", { command: "zoom", keys: ["+", "=", "-"] }],
      ["Space, middle drag", "move the view", { keys: [" "] }],
      ["0", "whole pictures", { command: "fit", keys: ["0"] }],
      ["N", "grid", { command: "grid", keys: ["n"] }],
      ["V", "folds", { command: "overlay", keys: ["v"] }],
      ["C", "before", { command: "compare", keys: ["c"] }],
      ...HISTORY_KEYS,
      HELP_KEY,
    ],
  ],
];

/**
 * Keys of the live view (view/pointer.ts, view/picture_plane.ts). It shows no list; they are here so that one module
 * holds all keys.
 */
export const VIEW_KEYS: KeyTable = [
  [
    "View",
    [
      ["Arrows", "turn, with Shift faster", { keys: ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"] }],
      ["+, -", "zoom", { keys: ["+", "=", "-"] }],
      ["0", "as at first", { keys: ["0"] }],
      ["E", "edit this view", { keys: ["e"] }],
      ["Hold space", "before", { keys: [" "] }],
    ],
  ],
];

export function keyRows(table: KeyTable) {
  return table.flatMap(([, rows]) => rows);
}

/** Buttons that share a row of the table with others: the row's command, and the key of the button. */
const SAME_ROW: Record<string, [row: string, key: string]> = {
  "zoom-in": ["zoom", "+"],
  "zoom-out": ["zoom", "-"],
  "turn-left": ["rotate", "Shift + ,"],
  "turn-right": ["rotate", "Shift + ."],
};

function keyRow(table: KeyTable, given: string) {
  const command = SAME_ROW[given]?.[0] ?? given;
  return keyRows(table).find(([, , about]) => about?.command === command);
}

/** The command of a key, for keys of which one command is all they do; else null. */
export function commandOf(table: KeyTable, key: string) {
  return keyRows(table).find(([, , about]) => about?.keys.includes(key))?.[2]?.command ?? null;
}

/** Place of a key among those of a command, -1 for keys of others: the first of "[" and "]" shrinks, the second grows. */
export function keyPlace(table: KeyTable, command: string, key: string) {
  return keyRow(table, command)?.[2]?.keys.indexOf(key) ?? -1;
}

/** The keys of a command as they are shown, "" for none. */
export function keyWords(table: KeyTable, command: string) {
  return SAME_ROW[command]?.[1] ?? keyRow(table, command)?.[0] ?? "";
}

/** The tip of a button: its action and its keys. */
export function tipOf(table: KeyTable, command: string, text: string) {
  const words = keyWords(table, command);
  return words ? `${text} (${words.replaceAll(" + ", "+")})` : text;
}

/** The same for the browser: aria-keyshortcuts. */
export function shortcutsOf(table: KeyTable, command: string) {
  const own = SAME_ROW[command]?.[1].replaceAll(" ", ""),
    keys = own ? [own] : (keyRow(table, command)?.[2]?.keys ?? []);
  return keys
    .map((key) => (key.length === 1 ? key.toUpperCase() : key.replace(/\+([a-z])$/, (_, k) => `+${k.toUpperCase()}`)))
    .join(" ");
}

/** The list over the picture, hidden at first. */
export class HelpPanel {
  before: HTMLElement | SVGElement | null = null; // had the focus before
  panel: HTMLDivElement;

  /**
   * @param root of the editor: the focused element within receives it back
   * @param focusStage called where that is removed meanwhile
   */
  constructor(
    parent: Element,
    readonly root: Element,
    readonly focusStage: () => void,
    table: KeyTable = EDITOR_KEYS,
  ) {
    this.panel = pageElement("div", "dnb-ed-help", parent, {
      role: "dialog",
      "aria-label": "Keys and gestures",
      hidden: "",
      "aria-modal": "false",
      tabindex: "0", // arrows scroll it
      ...OWN_KEYS,
    });
    const list = pageElement("div", "dnb-ed-entries", this.panel);
    for (const [title, rows] of table) {
      const group = pageElement("div", "dnb-ed-chapter", list, { role: "list", "aria-label": title });
      pageElement("div", "dnb-ed-title", group, { "aria-hidden": "true" }, title);
      for (const [keys, what] of rows) {
        const row = pageElement("div", "dnb-ed-entry", group, { role: "listitem", "aria-label": `${keys}: ${what}` });
        for (const text of [keys, what]) pageElement("span", "", row, {}, text);
      }
    }
  }

  get isOpen() {
    return !this.panel.hidden;
  }

  /** Focus the list, and later the element before it. */
  toggle() {
    const { activeElement } = treeOf(this.root);
    this.panel.hidden = this.isOpen;
    if (this.isOpen) {
      this.before = this.root.contains(activeElement) ? (activeElement as HTMLElement) : null;
      this.panel.focus();
    } else if (this.before?.isConnected) this.before.focus({ preventScroll: true });
    else this.focusStage();
  }
}
