// Elements of a page.

const SVG_SPACE = "http://www.w3.org/2000/svg";
// JupyterLab's own keys (x cuts the cell) stay away from an element with this, but look at the focused one only.
export const OWN_KEYS = { "data-lm-suppress-shortcuts": "true" };
export const SLACK = { mouse: 2, pen: 3, touch: 6 }; // CSS pixels: a press that moves less is a click

export function pageElement(tag, className, parent, attributes = {}) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  setAttributes(made, attributes);
  parent?.append(made);
  return made;
}

export function svgElement(tag, attributes, parent) {
  const made = document.createElementNS(SVG_SPACE, tag);
  setAttributes(made, attributes);
  parent?.append(made);
  return made;
}

export function setAttributes(node, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (node.getAttribute(name) !== String(value)) node.setAttribute(name, value);
  }
}

export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}
