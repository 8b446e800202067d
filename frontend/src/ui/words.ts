// The visible words in another language. The sources have the English words; a table has their translations.
//
// A key of the table is the English text. A name in braces is a placeholder: one letter ({n}) for a number; {name} and
// {file}, with digits behind where there are several, for untranslated words, {symbol} for one; {text} and {unit} for
// words translated if the table has them; any other for words that the table must have. A text may be of several
// sentences, clauses or facts that are keys. deformnb/words/translator.py does the same in Python.
//
// All that is written into the document below a root is translated before it is drawn: texts, tooltips, and the names
// that screen readers speak. So widgets of ipywidgets are in the language too, and no module has to request it. What
// users name is in an element with translate="no", the attribute of HTML by which translators leave it alone.

import type { Model } from "../types.ts";

export type Table = Record<string, string>;

const ATTRIBUTES = [
  "title",
  "aria-label",
  "placeholder",
  "alt",
  "label",
  "aria-valuetext",
  "aria-description",
  "aria-roledescription",
];
const LEFT_ALONE = "[translate=no], script, style, code, pre, textarea, [contenteditable=true]";
const FILE = /^\S+\.\w+$/; // the name of one
const AS_GIVEN = /^(name\d*|file\d*|symbol)$/,
  ANY = /^(text|unit)\d*$/;
const WORD = /\p{L}{2}/u; // a single letter is the name of a key or an axis
const NUMBER = "[^\\sA-Za-z\u00c0-\u024f]*\\d[^\\sA-Za-z\u00c0-\u024f]*(?:e[-+]?\\d+)?";
const PARTED = / \u00b7 | \| |\n+/g; // between facts of a line
const BREAKS = [/; /g, /(?<=[.!?\u2026]) /g, /: /g, /, /g]; // the strongest first
const MOST_KNOWN = 4000; // cached translations of texts

/** Translates texts by a table. */
export class Translator {
  table: Map<string, string>;
  patterns: { regex: RegExp; names: string[]; value: string; length: number; free: number; part: string }[];
  known = new Map<string, string | null>();

  constructor(table: Table) {
    this.table = new Map(Object.entries(table));
    this.patterns = [...this.table]
      .filter(([key]) => key.includes("{"))
      .map(([key, value]) => patternOf(key, value))
      .sort((a, b) => b.length - a.length || a.free - b.free); // the most specific first
  }

  /** A text in the language; itself where the table has nothing for it. */
  translate(text: string) {
    const core = text.trim();
    if (this.known.size > MOST_KNOWN) this.known.clear(); // not within a text, whose parts are met again and again
    const found = this.#find(core.replaceAll("\u00a0", " ")); // ipywidgets' menus have such spaces
    return found === null ? text : text.replace(core, () => found);
  }

  #find(core: string): string | null {
    if (!WORD.test(core)) return null;
    let found = this.known.get(core);
    if (found === undefined) {
      found =
        this.table.get(core) ??
        this.#translateHalves(PARTED, core) ??
        this.#translatePattern(core) ??
        this.#translatePieces(core) ??
        this.#withoutPeriod(core);
      this.known.set(core, found);
    }
    return found;
  }

  #translatePattern(core: string) {
    for (const { part, regex, names, value } of this.patterns) {
      const match = core.includes(part) && regex.exec(core);
      if (!match) continue;
      const values = new Map(names.map((name, k) => [name, this.#value(name, match[k + 1]!)]));
      if ([...values.values()].includes(null)) continue;
      return value.replace(/\{(\w+)\}/g, (whole, name) => values.get(name) ?? whole);
    }
    return null;
  }

  /** The text for a placeholder; null if it is of words that the table does not have. */
  #value(name: string, given: string) {
    if (name.length === 1 || AS_GIVEN.test(name)) return given;
    return this.#piece(given) ?? (ANY.test(name) ? given : null);
  }

  /** A part of a text, translated; null if it is of words that the table does not have. */
  #piece(given: string) {
    if (!WORD.test(given) || FILE.test(given)) return given;
    const core = given.trim(),
      found = this.#find(core);
    return found === null ? null : given.replace(core, () => found);
  }

  /** Translates what is before and after the first break between two pieces; a piece may have breaks within. */
  #translateHalves(at: RegExp, core: string) {
    for (const { 0: between, index } of core.matchAll(at)) {
      const first = this.#piece(core.slice(0, index)),
        rest = first === null ? null : this.#piece(core.slice(index + between.length));
      if (rest !== null) return first + between + rest;
    }
    return null;
  }

  #withoutPeriod(core: string) {
    const found = core.endsWith(".") ? this.#find(core.slice(0, -1)) : null;
    return found && `${found}.`;
  }

  /** Translates the pieces of a text; null unless the table has all that are words. */
  #translatePieces(core: string) {
    for (const at of BREAKS) {
      const made = this.#translateHalves(at, core);
      if (made !== null) return made;
    }
    const [, before, aside, period] = /^(.+?) \((.+)\)(\.?)$/s.exec(core) ?? [],
      main = before && this.#find(before);
    return main && aside ? `${main} (${this.translate(aside)})${period}` : null;
  }
}

function patternOf(key: string, value: string) {
  const pieces = key.split(/\{(\w+)\}/),
    names = pieces.filter((_, k) => k % 2),
    plain = pieces.filter((_, k) => k % 2 === 0);
  const source = pieces
    .map((piece, k) => {
      if (k % 2) return piece.length === 1 ? `(${NUMBER})` : piece === "symbol" ? "([^\\s\\d]*)" : "(.*?)";
      return piece.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
    })
    .join("");
  return {
    regex: new RegExp(`^${source}$`, "su"),
    names,
    value,
    length: plain.join("").length,
    free: names.filter((name) => name.length > 1).length,
    part: plain.reduce((longest, piece) => (piece.length > longest.length ? piece : longest)),
  };
}

/** The translator of a page that has one, for texts outside its document. */
let ofPage: Translator | null = null;

/** A text in the language of the page, for a dialog of the browser. */
export function localize(text: string) {
  return ofPage?.translate(text) ?? text;
}

function isUntranslated(node: Node) {
  const element = node instanceof Element ? node : node.parentElement;
  return Boolean(element?.closest(LEFT_ALONE));
}

/**
 * Show all words below a root in a language, now and whenever they change; returns the function that ends it.
 * @param language its code, as of the attribute lang
 */
export function showInLanguage(root: HTMLElement, table: Table, language: string) {
  if (!Object.keys(table).length) return () => {};
  const translator = new Translator(table);
  if (root === document.body) ofPage = translator;
  root.lang = language;
  const text = (node: Node) => {
    if (!node.nodeValue || isUntranslated(node)) return;
    const made = translator.translate(node.nodeValue);
    if (made !== node.nodeValue) node.nodeValue = made;
  };
  const attribute = (element: Element, name: string) => {
    const given = element.getAttribute(name);
    if (!given || element.closest("[translate=no]")) return;
    const made = translator.translate(given);
    if (made !== given) element.setAttribute(name, made);
  };
  const all = (node: Node) => {
    if (node.nodeType === Node.TEXT_NODE) text(node);
    if (!(node instanceof Element)) return;
    const walker = document.createTreeWalker(node, NodeFilter.SHOW_ELEMENT | NodeFilter.SHOW_TEXT);
    for (let at = node as Node | null; at; at = walker.nextNode()) {
      if (at.nodeType === Node.TEXT_NODE) text(at);
      else for (const name of ATTRIBUTES) attribute(at as Element, name);
    }
  };
  const changes = new MutationObserver((records) => {
    for (const { type, target, attributeName, addedNodes } of records) {
      if (type === "characterData") text(target);
      else if (type === "attributes") attribute(target as Element, attributeName ?? "");
      else addedNodes.forEach(all);
    }
  });
  changes.observe(root, { subtree: true, childList: true, characterData: true, attributeFilter: ATTRIBUTES });
  all(root);
  return () => changes.disconnect();
}

type Given = { model: Model; el: HTMLElement };
export type AnyWidget = { render: (given: Given) => () => void; initialize?: (given: { model: Model }) => unknown };

/** A widget whose words are in the language of its model: its traits `language` and `words`, the table. */
export function translateWidget(widget: AnyWidget): AnyWidget {
  return {
    ...widget,
    render: (given) => {
      const { model, el } = given,
        words = model.get("words"),
        close = widget.render(given);
      if (!words || !Object.keys(words).length) return close; // a page without Python has them once, for all of it
      const end = showInLanguage(el, words, model.get("language"));
      return () => {
        end();
        close();
      };
    },
  };
}
