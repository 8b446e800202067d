// The field in which a point or a shape is named, next to its place in the picture.

import type { Vector2 } from "../types.ts";
import { OWN_KEYS, pageElement, treeOf } from "../ui/dom.ts";
import type { Frames } from "./frames.ts";
import type { EditorRoot } from "./stage.ts";

export interface Naming {
  take: (text: string) => void;
  /** Give the focus back; false if the named thing is gone */
  focus: () => boolean;
}

/** Dependencies of the field on the editor. */
export type PromptEditor = { frames: Frames; stage: EditorRoot };

export class NamePrompt {
  input: HTMLInputElement;

  /** The name that is being requested. */
  naming: Naming | null = null;

  constructor(readonly editor: PromptEditor) {
    const { element, closing } = editor.stage,
      { signal } = closing;
    this.input = pageElement("input", "dnb-ed-input", element, {
      type: "text",
      maxlength: "80",
      hidden: "",
      "aria-label": "name",
      ...OWN_KEYS,
    });
    this.input.addEventListener(
      "keydown",
      (e) => {
        e.stopPropagation();
        if (e.key === "Enter") this.end(true);
        if (e.key === "Escape") this.end(false);
      },
      { signal },
    );
    this.input.addEventListener("blur", () => this.end(true), { signal });
  }

  /** Request a name next to a place of the view. */
  prompt(text: string, placeholder: string, [x, y]: Vector2, naming: Naming) {
    const { input } = this,
      { clientWidth: width, clientHeight: height } = this.editor.stage.element;
    this.naming = naming;
    input.hidden = false;
    input.value = text;
    input.placeholder = placeholder;
    input.style.left = `${Math.max(4, Math.min(width - 164, x + 12))}px`;
    input.style.top = `${Math.max(4, Math.min(height - 32, y - 30))}px`;
    input.focus();
    input.select();
  }

  end(isKept: boolean) {
    const { naming, input } = this,
      { frames, stage } = this.editor;
    if (!naming || input.hidden) return;
    const hadFocus = treeOf(stage.root).activeElement === input;
    input.hidden = true;
    if (isKept) frames.guard(() => naming.take(input.value));
    if (!naming.focus() && hadFocus) stage.focus(); // the point may be gone meanwhile
  }
}
