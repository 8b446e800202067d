// Accessible names of ipywidgets' controls where they have none: a screen reader stops at the handles of noUiSlider,
// which no label names, at the number next to them, and at fields with an empty label, whose tooltip describes them.
// Their keys are their own, too: a letter that chooses an option of a menu is no command for a cell of the notebook.

import { OWN_KEYS, setAttributes } from "../ui/dom.ts";

const HANDLES = ".widget-slider .noUi-handle:not([aria-label])";
const READOUTS = ".widget-readout[contenteditable]:not([aria-label])";
const WITH_KEYS = ".jupyter-widgets :is(select, input, button, [tabindex]):not([data-lm-suppress-shortcuts])";
const FIELDS = ".jupyter-widgets :is(input, select, textarea)[title]:not([aria-label])";

function nameAll(root: Element) {
  for (const handle of root.querySelectorAll(HANDLES)) {
    const slider = handle.closest(".widget-slider"),
      label = slider?.querySelector(".widget-label")?.textContent?.trim();
    if (!slider || !label) continue; // the label is set by a later change
    const isRange = slider.querySelectorAll(".noUi-handle").length > 1;
    const end = handle.classList.contains("noUi-handle-lower") ? "from" : "to";
    handle.setAttribute("aria-label", isRange ? `${label}, ${end}` : label);
  }
  for (const readout of root.querySelectorAll(READOUTS)) {
    const label = readout.closest(".jupyter-widgets")?.querySelector(".widget-label")?.textContent?.trim();
    if (label) setAttributes(readout, { role: "textbox", "aria-label": label });
  }
  for (const control of root.querySelectorAll(WITH_KEYS)) setAttributes(control, OWN_KEYS);
  for (const field of root.querySelectorAll(FIELDS)) {
    const { labels } = field as HTMLInputElement,
      title = field.getAttribute("title") ?? "";
    if (labels?.length && ![...labels].some((label) => label.textContent?.trim()))
      field.setAttribute("aria-label", title);
  }
}

/**
 * Name the controls of a studio, and those that are added later.
 * @param signal ends it
 */
export function nameControls(root: Element, signal: AbortSignal) {
  // Editors and views name their own controls, and change something in every frame of a drag.
  const isOwn = ({ target }: MutationRecord) =>
    target instanceof Element && target.closest(".dnb-editor, .dnb-space, .dnb-view") !== null;
  const changes = new MutationObserver((records) => {
    if (!records.every(isOwn)) nameAll(root);
  });
  changes.observe(root, { childList: true, subtree: true, attributeFilter: ["title"] });
  signal.addEventListener("abort", () => changes.disconnect());
  nameAll(root);
}
