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

/** The page with a state in it. */
export function pageWithState(state: Values) {
  const escaped = JSON.stringify(state).replaceAll("<", "\\u003c"),
    element = `<script type="application/json" id="${STATE}">${escaped}</script>`;
  const without = ORIGINAL.replace(new RegExp(`<script type="application/json" id="${STATE}">.*?</script>`, "s"), "");
  const at = without.indexOf('<script type="application/json" id="dnb-data">');
  return new Blob([`<!doctype html>\n${without.slice(0, at)}${element}${without.slice(at)}`], { type: "text/html" });
}
