// Elements of the document.

const SVG_SPACE = "http://www.w3.org/2000/svg";
// JupyterLab's own keys (x cuts the cell) stay away from an element with this, but look at the focused one only.
export const OWN_KEYS = { "data-lm-suppress-shortcuts": "true" };
/**
 * CSS pixels: a press that moves less is a click.
 * @type {Record<string, number>}
 */
export const SLACK = { mouse: 2, pen: 3, touch: 6 };

/** @typedef {Record<string, string | number | boolean>} Attributes */

/**
 * A new HTML element with a class name ("" for none) at the end of a parent.
 * @template {keyof HTMLElementTagNameMap} T
 * @param {T} tag
 * @param {string} className
 * @param {ParentNode | null} [parent]
 * @param {Attributes} [attributes]
 */
export function pageElement(tag, className, parent, attributes = {}) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  setAttributes(made, attributes);
  parent?.append(made);
  return made;
}

/**
 * A new SVG element at the end of a parent.
 * @template {keyof SVGElementTagNameMap} T
 * @param {T} tag
 * @param {Attributes} attributes
 * @param {ParentNode | null} [parent]
 */
export function svgElement(tag, attributes, parent) {
  const made = document.createElementNS(SVG_SPACE, tag);
  setAttributes(made, attributes);
  parent?.append(made);
  return made;
}

/**
 * Set the attributes that differ.
 * @param {Element} node
 * @param {Attributes} attributes
 */
export function setAttributes(node, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (node.getAttribute(name) !== String(value)) node.setAttribute(name, String(value));
  }
}

/**
 * Set the text of a node if it differs.
 * @param {Node} node
 * @param {string} text
 */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/**
 * Let the user keep a file.
 * @param {Blob} blob
 * @param {string} name
 */
export function saveFile(blob, name) {
  const link = pageElement("a", "", null, { download: name });
  link.href = URL.createObjectURL(blob);
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** @typedef {DocumentOrShadowRoot & { readonly activeElement: HTMLElement | SVGElement | null }} Tree */

/** The document or shadow tree of a node, in which focus and places are looked up. @param {Node} node */
export function treeOf(node) { return /** @type {Tree} */ (/** @type {unknown} */ (node.getRootNode())); }

/** The element to which an event was sent. @param {Event} event */
export function targetOf(event) { return /** @type {Element} */ (event.target); }

/**
 * Whether wheel and fingers are an element's own, and not the page's around it: someone works in it, or nothing scrolls.
 * @param {HTMLElement} root
 */
export function isWorkedIn(root) { return root.matches(":focus-within") || !scrollsAround(root); }

/** @param {Element} element */
function scrollsAround(element) {
  for (let box = parentOf(element); box; box = parentOf(box)) {
    const { overflowY } = getComputedStyle(box), isPage = box === document.scrollingElement;
    const scrolls = isPage ? overflowY !== "hidden" : overflowY === "auto" || overflowY === "scroll";
    if (scrolls && box.scrollHeight > box.clientHeight + 1) return true;
    if (box === document.fullscreenElement) return false; // what is around it is not seen
  }
  return window.parent !== window; // a frame is as high as its contents, and what is around it scrolls
}

/**
 * The element around one, also out of a shadow tree.
 * @param {Element} element
 */
function parentOf(element) {
  if (element.parentElement) return element.parentElement;
  const tree = element.getRootNode();
  return tree instanceof ShadowRoot ? tree.host : null;
}

/**
 * Call a function before each press and key that is meant for something outside an element.
 * @param {HTMLElement} root
 * @param {() => void} action
 * @param {AbortSignal} signal ends it
 */
export function beforeActionOutside(root, action, signal) {
  const listener = (/** @type {Event} */ event) => { if (!event.composedPath().includes(root)) action(); };
  for (const name of ["pointerdown", "keydown"]) window.addEventListener(name, listener, { capture: true, signal });
}
