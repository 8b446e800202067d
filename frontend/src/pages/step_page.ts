// A page that is one section of another one: a picture or a volume in the room that it is given, without controls of its
// own.

import type { EditorView } from "../editor/editor.ts";
import type { PicturePoint, Point, Values } from "../types.ts";
import { pageElement, viewOf } from "../ui/dom.ts";
import { FilePage } from "./file_page.ts";
import type { PageData } from "./standalone_page.ts";

/** CSS pixels */
export interface Room {
  width: number;
  height: number;
}

/** The elements in which a page is shown. */
export function pageParts(parent: Element) {
  const root = pageElement("div", "dnb-page-section", parent);
  pageElement("div", "dnb-page-controls", root, { role: "group", "aria-label": "Deformation" });
  const main = pageElement("div", "dnb-page-main", root);
  pageElement("div", "dnb-page-picture", main);
  pageElement("div", "dnb-page-volume", main);
  return root;
}

export class StepPage extends FilePage {
  /**
   * @param room that picture or volume have
   */
  constructor(
    data: PageData,
    widgets: Values,
    name: string,
    root: HTMLElement,
    readonly room: () => Room,
  ) {
    super(data, widgets, name, root);
  }

  override fit() {
    const { width, height } = this.room();
    this.editor.update({ height: Math.round(height) });
    this.view?.update({ width: Math.round(width), height: Math.round(height) });
  }

  /** The editor that is in the section, if it has one. */
  get editorView() {
    return viewOf<EditorView>(this.part("picture").querySelector(".dnb-editor"));
  }

  get points(): PicturePoint[] {
    return this.editor.get("points");
  }

  /** Show how far the deformation has come: 0 not at all, 1 all of it. */
  setShare(strength: number) {
    this.editor.update({ settings: { ...this.editor.get("settings"), strength } });
  }

  undo() {
    this.editorView?.commands.run("undo", null);
  }

  /** Traits of an editor that holds points, fitted by a thin-plate spline, which passes through all of them. */
  static splineTraits(editor: Values, points: Point[]): Values {
    const settings = { ...editor.settings, kernel: "thin_plate", trend: "affine", support: null, chosen_support: null };
    return { ...editor, points, next_id: points.length, selected: [], settings };
  }

  override close() {
    super.close();
    this.root.remove();
  }
}
