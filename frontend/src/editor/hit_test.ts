// Hit test of a pointer in the editor: a point, a shape, a handle, or a mark.

import { elementUnder } from "../ui/fingers.ts";
import type { PartHandle } from "./motion_handles.ts";
import type { EditorParts } from "./parts.ts";
import type { Chosen, Grip } from "./shape_handles.ts";

/** `handle`: of the motion of a rigid part, null on an outline. */
export type ShapeGrip = Grip & { chosen: Chosen; handle: PartHandle | null };

/** The nearest element around that of an event that a selector matches. */
export function around({ target }: { target: EventTarget | null }, selector: string): HTMLElement | SVGElement | null {
  return target instanceof Element ? target.closest(selector) : null;
}

function numberOf(text: string | undefined) {
  return text ? Number(text) : null;
}

/** The grip of a shape that an element belongs to. */
export function shapeGrip(hit: { target: EventTarget | null }, chosen: Chosen | null): ShapeGrip | null {
  const grip = around(hit, ".dnb-ed-grip");
  if (grip && chosen) {
    return { chosen, corner: numberOf(grip.dataset.corner), middle: numberOf(grip.dataset.middle), handle: null };
  }
  const found = around(hit, "[data-motion]")?.dataset.motion;
  const handle = found === "move" || found === "turn" || found === "pivot" ? found : null;
  if (chosen && handle && handle !== "move") return { chosen, corner: null, middle: null, handle };
  const [what, index] = around(hit, "[data-shape]")?.dataset.shape?.split(":") ?? [];
  if (what !== "cuts" && what !== "parts") return null;
  return { chosen: { what, index: Number(index) }, corner: null, middle: null, handle };
}

/** Dependencies of the test on the editor. */
export type HitEditor = EditorParts<"frames" | "stage", "shapes">;

export class HitTest {
  constructor(readonly editor: HitEditor) {}

  /**
   * The element that an event is about. While a pointer is captured, the element under its clicks is not their target. A
   * press may come before other points or shapes are drawn: then they are, and the element there now counts.
   */
  #hit(event: Event) {
    if (event.type === "pointerdown" && this.editor.frames.request) this.editor.frames.drawNow();
    const { type, target } = event,
      isPlaced = ["pointerdown", "dblclick", "contextmenu"].includes(type);
    if (!(event instanceof MouseEvent && isPlaced)) return { target };
    return { target: elementUnder(this.editor.stage.svg, event) };
  }

  /** The point that an event is about. */
  pointAt(event: Event): { id: number; what: "target" | "source" } | null {
    const hit = this.#hit(event),
      target = around(hit, "[data-id]"),
      source = around(hit, "[data-source]");
    if (target) return { id: Number(target.dataset.id), what: "target" };
    return source ? { id: Number(source.dataset.source), what: "source" } : null;
  }

  /**
   * The grip of a shape that an event is about: its line, a corner, the middle of an edge, or a handle of a part's
   * motion, of which its inside is one.
   */
  shapeAt(event: Event): ShapeGrip | null {
    return shapeGrip(this.#hit(event), this.editor.tools.shapes.choice.chosen);
  }

  /** The handle that turns, or the axis of the mirror. */
  markAt(event: Event) {
    return around(event, "[data-mark]")?.dataset.mark ?? null;
  }
}
