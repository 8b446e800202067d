// Fingers, whose targets are 44 CSS pixels wide and high. The style sheet fingers.css gives handles in drawings circles of
// that size, which overlap where handles are close: a finger grabs the one whose middle is nearest to it.

import { treeOf } from "./dom.ts";

export const FINGER = 44; // CSS pixels of a target, as the style sheets have it
const HANDLES = "circle.dnb-ed-hit, circle.dnb-cv-hit, .dnb-cv-grip > rect.dnb-cv-hit";
const LINES = "path.dnb-sp-arrow-hit";
const LINE_BEGINS = 14; // CSS pixels from a point: where the arrows of its axes begin
const SAMPLED = 2; // CSS pixels along a line

/** Whether fingers are what points. */
export const isForFingers = () => Boolean(globalThis.matchMedia?.("(pointer: coarse)").matches);

/** The size of a target in CSS pixels: this one, or that of a finger where fingers are what points. */
export const targetSize = (small: number) => (isForFingers() ? Math.max(FINGER, small) : small);

/** CSS pixels from a place to the middle of an element, or to the line of an axis. */
function awayFrom(hit: Element, x: number, y: number) {
  if (!(hit instanceof SVGPathElement && hit.matches(LINES))) {
    const { left, top, width, height } = hit.getBoundingClientRect();
    return Math.hypot(left + width / 2 - x, top + height / 2 - y);
  }
  const matrix = hit.getScreenCTM(),
    count = Math.ceil(hit.getTotalLength() / SAMPLED);
  const places = Array.from({ length: count + 1 }, (_, k) =>
    hit.getPointAtLength(k * SAMPLED).matrixTransform(matrix!),
  );
  return LINE_BEGINS + Math.min(...places.map((place) => Math.hypot(place.x - x, place.y - y)));
}

/** The handle in a drawing that a finger at a place grabs: of those whose area it is in the nearest; null for none. */
export function handleAt(root: Element, { clientX: x, clientY: y }: MouseEvent): Element | null {
  const found = treeOf(root)
    .elementsFromPoint(x, y)
    .filter((hit) => root.contains(hit) && hit.matches(`${HANDLES}, ${LINES}`))
    .map((hit) => ({ hit, away: awayFrom(hit, x, y) }));
  return found.sort((p, q) => p.away - q.away)[0]?.hit ?? null;
}

const isFinger = (event: Event) => event instanceof PointerEvent && event.pointerType === "touch";

/** The element under a pointer: for a finger the handle that it grabs, if there is one. */
export function elementUnder(root: Element, event: MouseEvent): Element | null {
  const { clientX, clientY } = event;
  return (isFinger(event) && handleAt(root, event)) || treeOf(root).elementFromPoint(clientX, clientY);
}

/** Of elements that are seen the one that is pressed: for a finger the one whose middle is nearest, not too far away. */
export function findPressed<T extends Element>(elements: T[], event: MouseEvent): T | null {
  const { clientX: x, clientY: y, target } = event;
  if (!isFinger(event)) return elements.find((one) => target instanceof Node && one.contains(target)) ?? null;
  const [nearest] = elements
    .filter((one) => one.getClientRects().length)
    .map((one) => ({ one, away: awayFrom(one, x, y) }))
    .sort((p, q) => p.away - q.away);
  return nearest && nearest.away <= FINGER / 2 ? nearest.one : null;
}

/** Pass each press of a finger on a drawing to the handle that is nearest to it, whichever of them is above the others. */
export function grabNearest(root: SVGElement, signal: AbortSignal) {
  const pass = (event: PointerEvent) => {
    const handle = event.isTrusted && isFinger(event) ? handleAt(root, event) : null;
    if (!handle?.parentElement || (event.target instanceof Node && handle.parentElement.contains(event.target))) return;
    event.stopImmediatePropagation();
    if (!handle.dispatchEvent(new PointerEvent(event.type, event))) event.preventDefault();
  };
  root.addEventListener("pointerdown", pass, { capture: true, signal });
}
