// The picture that is edited, in a view of the volume: its frame, its name where the camera looks as it does, and the
// button that makes the picture of the camera the one that is edited.

import { difference } from "../maths/camera.ts";
import type { Vector3 } from "../types.ts";
import { buttonElement, iconElement, named, pageElement, setAttributes, setText, svgElement } from "../ui/dom.ts";
import type { VolumeViewLike } from "./types.ts";

const SAME = 1e-6; // largest difference of unit vectors of one direction, as in volume/plane.py
const FRAME = "M2.5 5.5l7-2.5 4 7.5-7 2.5z";
const CORNER = 0.12; // length of the mark at the upper left corner, as a share of the frame's sides

/** The trait "picture_plane"; empty outside of a studio. */
interface PlaneTrait {
  /** Places in space, clockwise from the left one at the top; none for points in space */
  corners?: Vector3[];
  direction?: Vector3;
  up?: Vector3;
  name?: string;
  /** Whether a user has given the name */
  named?: boolean;
  /** Whether it is one of the six sides */
  side?: boolean;
  /** Whether Python answers the wish to edit another */
  editable?: boolean;
}

export class PicturePlane {
  #svg: SVGSVGElement;
  #outline: SVGPathElement;
  #bar: HTMLDivElement;
  #edit: HTMLElement;
  #label: HTMLSpanElement;
  #name: HTMLSpanElement;
  #projection: HTMLSpanElement;
  #toggle: HTMLElement;
  #drawn = "";
  #closing = new AbortController();

  constructor(readonly view: VolumeViewLike) {
    const { root, canvas } = view.elements;
    this.#svg = svgElement("svg", { class: "dnb-plane", "aria-hidden": "true", visibility: "hidden" }, root);
    this.#outline = svgElement("path", {}, this.#svg);
    this.#bar = pageElement("div", "dnb-plane-bar", root, { hidden: "" });
    const tip = "Edit on the picture that the volume shows now (E)";
    this.#edit = buttonElement("dnb-button dnb-edit-view", this.#bar, "Edit this view", () => this.edit(), {
      title: tip,
    });
    this.#label = pageElement("span", "dnb-plane-label", this.#bar, { role: "status" });
    this.#name = pageElement("span", "dnb-plane-name", this.#label);
    this.#projection = pageElement("span", "dnb-plane-projection", this.#label);
    this.#toggle = buttonElement(
      "dnb-button dnb-plane-frame",
      this.#bar,
      iconElement(FRAME),
      () => this.#toggleFrame(),
      named("Frame of the picture in the volume"),
    );
    for (const name of ["picture_plane", "plane_frame"]) view.messages.on(`change:${name}`, () => this.draw());
    canvas.addEventListener("keydown", (event) => this.#press(event), { signal: this.#closing.signal });
  }

  get #trait(): PlaneTrait {
    return this.view.model.get("picture_plane") ?? {};
  }

  /** Whether a studio answers: a view alone has no picture to edit. */
  get #isInStudio() {
    return this.#trait.name !== undefined;
  }

  /** Whether the camera looks as the picture does. */
  get #isAt() {
    const { direction, up } = this.#trait,
      { camera } = this.view;
    const isSame = (a: Vector3, b: Vector3 | undefined) =>
      b !== undefined && difference(a, b).every((x) => Math.abs(x) < SAME);
    return isSame(camera.direction, direction) && isSame(camera.up, up);
  }

  get #isFramed() {
    const { corners, side } = this.#trait,
      chosen: boolean | null | undefined = this.view.model.get("plane_frame");
    return Boolean(corners?.length) && (chosen ?? !side);
  }

  /** Make the picture that the camera sees the one that is edited. */
  edit() {
    const { view } = this;
    if (!this.#isInStudio || !view.info || this.#isReadOnly) return false;
    view.writeCamera();
    const { eye, box } = view.spacePoints.camera,
      scale = box.height / view.camera.height;
    view.messages.send({ type: "edit_view", camera: view.camera.trait, middle: eye, scale });
    return true;
  }

  /** A page without Python has one picture. */
  get #isReadOnly() {
    return !this.#trait.editable;
  }

  #press(event: KeyboardEvent) {
    if (event.key.toLowerCase() !== "e" || event.ctrlKey || event.metaKey || event.altKey || !this.edit()) return;
    event.preventDefault();
    event.stopPropagation();
  }

  #toggleFrame() {
    const { model } = this.view;
    model.set("plane_frame", !this.#isFramed);
    model.save_changes();
    this.draw();
  }

  /** Follow the camera. */
  draw() {
    if (!this.view.info) return;
    const { box } = this.view.elements,
      { camera } = this.view.spacePoints;
    const trait = this.#trait,
      isFramed = this.#isFramed;
    const state = JSON.stringify([trait, isFramed, camera, box]);
    if (state === this.#drawn) return;
    this.#drawn = state;
    const isAt = this.#isAt;
    this.#bar.hidden = !this.#isInStudio;
    this.#edit.hidden = isAt || this.#isReadOnly;
    this.#label.hidden = !isAt;
    this.#toggle.hidden = !trait.corners?.length;
    this.#toggle.setAttribute("aria-pressed", String(isFramed));
    setText(this.#name, trait.name ?? "");
    setAttributes(this.#name, { translate: trait.named ? "no" : "yes" });
    setText(this.#projection, camera.bend > 0 ? "perspective" : "parallel projection");
    setAttributes(this.#svg, {
      visibility: isFramed ? "visible" : "hidden",
      viewBox: `0 0 ${Math.max(1, box.width)} ${Math.max(1, box.height)}`,
    });
    if (isFramed && trait.corners) setAttributes(this.#outline, { d: this.#path(trait.corners) });
  }

  /** The frame, with a mark at its upper left corner, which tells how the picture lies. */
  #path(corners: Vector3[]) {
    const { camera } = this.view.spacePoints;
    const [first, second, , last] = corners as [Vector3, Vector3, Vector3, Vector3];
    const towards = (to: Vector3) => first.map((x, k) => x + CORNER * (to[k]! - x)) as Vector3;
    const line = (places: Vector3[]) =>
      places.map((place) => camera.see(place).at.map((x) => x.toFixed(1))).join(" L ");
    return `M ${line(corners)} Z M ${line([towards(second), towards(last)])}`;
  }

  close() {
    this.#closing.abort();
    this.#svg.remove();
    this.#bar.remove();
  }
}
