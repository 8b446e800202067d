// A copy of this page with its state in it, to be given to somebody else as one file.

import type { Values } from "../types.ts";

const STATE = "dnb-state";

/** The text of the page as it was loaded: scripts of a page run before any of them has changed it. */
const ORIGINAL = document.documentElement.outerHTML;

/** The state that is in the page, null where it is as it was made. */
export function includedState(): Values | null {
  const text = document.getElementById(STATE)?.textContent;
  return text ? JSON.parse(text) : null;
}

/** The page with a state in it, in front of its data and in place of the state that it may have. */
export function pageWithState(state: Values) {
  const element = Object.assign(document.createElement("script"), {
    type: "application/json",
    id: STATE,
    textContent: JSON.stringify(state).replaceAll("<", "\\u003c"),
  });
  const beginOf = (id: string) => ORIGINAL.indexOf(`<script type="application/json" id="${id}">`),
    data = beginOf("dnb-data"),
    before = ORIGINAL.slice(0, beginOf(STATE) < 0 ? data : beginOf(STATE));
  return new Blob(["<!doctype html>\n", before, element.outerHTML, ORIGINAL.slice(data)], { type: "text/html" });
}
