// Edits of the chosen cut or rigid part, on a picture or in space.

import { type motionWords, SHAPE_NAMES, shapeName, updateShape } from "../maths/shapes.ts";
import type { PartData, ShapeData, ShapeKind } from "../types.ts";
import type { Messages } from "./messages.ts";
import { type ChoiceEditor, ShapeChoice } from "./shape_choice.ts";

/** Dependencies of the edits on the editor. */
export interface ShapeEditsEditor extends ChoiceEditor {
  messages: Messages;
  stage: { focus(): void };
}

export abstract class ShapeEdits {
  readonly choice: ShapeChoice;

  /** @param wordsOf the motion of a part */
  constructor(
    readonly editor: ShapeEditsEditor,
    wordsOf?: typeof motionWords,
  ) {
    this.choice = new ShapeChoice(editor, wordsOf);
  }

  /** Replace all cuts or all parts; false where that is refused. */
  abstract edit(what: ShapeKind, shapes: ShapeData[], kind: string): boolean;

  protected change(change: Partial<PartData>, kind: string) {
    const {
      choice: { chosen, shape },
      editor,
    } = this;
    if (!chosen || !shape) return false;
    const { what, index } = chosen;
    return this.edit(
      what,
      updateShape(editor.points.shapes[what], index, change),
      `${kind} ${shape.name || SHAPE_NAMES[what]}`,
    );
  }

  remove() {
    const {
      choice: { chosen, shape },
      editor,
    } = this;
    if (!chosen || !shape) return;
    const { what, index } = chosen,
      name = shapeName(shape, what, index);
    const others = editor.points.shapes[what].filter((_, k) => k !== index);
    if (!this.edit(what, others, `remove ${SHAPE_NAMES[what]}`)) return;
    this.choice.chosen = null;
    editor.frames.drawNow();
    editor.stage.focus();
    editor.messages.announce(`${name} deleted`);
  }

  switch() {
    const isOn = this.choice.shape?.enabled;
    if (this.change({ enabled: !isOn }, "switch")) this.editor.messages.announce(`switched ${isOn ? "off" : "on"}`);
  }

  /** Give the chosen shape another name. */
  protected setName(text: string) {
    const { chosen } = this.choice;
    if (!chosen) return;
    const shapes: ShapeData[] = this.editor.points.shapes[chosen.what];
    this.edit(chosen.what, updateShape(shapes, chosen.index, { name: text.trim().slice(0, 80) }), "rename");
  }
}
