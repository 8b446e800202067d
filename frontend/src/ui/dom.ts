// Elements of the document.

import type { Vector2 } from "../types.ts";

const SVG_SPACE = "http://www.w3.org/2000/svg";
// JupyterLab's own keys (x cuts the cell) ignore an element with this, but check only the focused one.
/** The view that an element is the root of. */
export function viewOf<View>(root: Element | null | undefined) {
  return (root as (Element & { deformnb?: View }) | null | undefined)?.deformnb;
}

export const OWN_KEYS = { "data-lm-suppress-shortcuts": "true" };
/** Steps of the arrow keys, to the right and down. */
export const ARROWS: Record<string, Vector2> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, -1],
  ArrowDown: [0, 1],
};

/** CSS pixels: a press that moves less is a click. */
const SLACK = { mouse: 2, pen: 3, touch: 6 };

/** CSS pixels that a pointer of this kind may move before a press becomes a drag. */
export const slackOf = (kind: string): number => SLACK[kind as keyof typeof SLACK] ?? SLACK.mouse;

export type Attributes = Record<string, string | number | boolean>;

/** A new HTML element with a class name ("" for none) and contents at the end of a parent. */
export function pageElement<T extends keyof HTMLElementTagNameMap>(
  tag: T,
  className: string,
  parent?: ParentNode | null,
  attributes: Attributes = {},
  ...contents: (string | Node)[]
) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  setAttributes(made, attributes);
  made.append(...contents);
  parent?.append(made);
  return made;
}

/** A new SVG element with a text at the end of a parent. */
export function svgElement<T extends keyof SVGElementTagNameMap>(
  tag: T,
  attributes: Attributes,
  parent?: ParentNode | null,
  text: string = "",
) {
  const made = document.createElementNS(SVG_SPACE, tag);
  setAttributes(made, attributes);
  if (text) made.textContent = text;
  parent?.append(made);
  return made;
}

/** An icon of 16 x 16: lines of the text's colour along a path. */
export function iconElement(path: string, attributes: Attributes = {}) {
  const icon = svgElement("svg", { viewBox: "0 0 16 16", "aria-hidden": "true", focusable: "false", ...attributes });
  svgElement("path", { d: path }, icon);
  return icon;
}

/** A button with a text or an icon, which blocks JupyterLab's keys. */
export function buttonElement(
  className: string,
  parent: ParentNode | null,
  content: string | Node,
  act: (event: MouseEvent) => void,
  attributes: Attributes = {},
) {
  const button = pageElement("button", className, parent, { type: "button", ...OWN_KEYS, ...attributes }, content);
  button.addEventListener("click", act);
  return button;
}

/** A tip that is also the name of the element for screen readers. */
export const named = (tip: string): Attributes => ({ title: tip, "aria-label": tip });

/** Set the attributes that differ. */
export function setAttributes(node: Element, attributes: Attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (node.getAttribute(name) !== String(value)) node.setAttribute(name, String(value));
  }
}

/** Set the text of a node if it differs. */
export function setText(node: Node, text: string) {
  if (node.textContent !== text) node.textContent = text;
}

/** Whether elements can be shown in full screen: an iPhone shows videos alone so, and a frame needs permission. */
export const canFillScreen = () => Boolean(document.fullscreenEnabled);

/** Show an element in full screen, or leave full screen; false where the browser refuses. */
export async function fillScreen(element: Element | null) {
  try {
    await (document.fullscreenElement ? document.exitFullscreen() : element?.requestFullscreen());
    return true;
  } catch {
    return false;
  }
}

/** Download a file. */
export function saveFile(blob: Blob, name: string) {
  const link = pageElement("a", "", null, { download: name });
  link.href = URL.createObjectURL(blob);
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

export type Tree = DocumentOrShadowRoot & { readonly activeElement: HTMLElement | SVGElement | null };

/** The document or shadow tree of a node, in which focus and places are looked up. */
export function treeOf(node: Node) {
  return node.getRootNode() as unknown as Tree;
}

/** The place of an event in an element, in CSS pixels. */
export function placeIn(element: Element, event: MouseEvent): Vector2 {
  const { left, top } = element.getBoundingClientRect();
  return [event.clientX - left, event.clientY - top];
}

/** The element to which an event was sent. */
export function targetOf(event: Event) {
  return event.target as Element;
}

/**
 * Whether an element handles wheel and fingers, and not its scrolling parents: it is in use, or nothing scrolls.
 */
export function isInUse(root: HTMLElement) {
  return root.matches(":focus-within") || !scrollsAround(root);
}

function scrollsAround(element: Element) {
  for (let box = parentOf(element); box; box = parentOf(box)) {
    const { overflowY } = getComputedStyle(box),
      isPage = box === document.scrollingElement;
    const scrolls = isPage ? overflowY !== "hidden" : overflowY === "auto" || overflowY === "scroll";
    if (scrolls && box.scrollHeight > box.clientHeight + 1) return true;
    if (box === document.fullscreenElement) return false; // its surroundings are not visible
  }
  return window.parent !== window; // a frame is as high as its contents, and its parent scrolls
}

/** The parent of an element, also out of a shadow tree. */
function parentOf(element: Element) {
  if (element.parentElement) return element.parentElement;
  const tree = element.getRootNode();
  return tree instanceof ShadowRoot ? tree.host : null;
}

/**
 * Call a function before each press and key that is meant for something outside an element.
 * @param signal ends it
 */
export function beforeActionOutside(root: HTMLElement, action: () => void, signal: AbortSignal) {
  const listener = (event: Event) => {
    if (!event.composedPath().includes(root)) action();
  };
  for (const name of ["pointerdown", "keydown"]) window.addEventListener(name, listener, { capture: true, signal });
}
