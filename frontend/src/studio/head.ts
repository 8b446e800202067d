// The studio's head: the volume's name, undo and redo, menus, "Save", which Ctrl+S presses anywhere in the studio, and
// full screen. The menus and the panes are separate widgets, found by their classes in the same studio.
// Messages to Python: save; a menu that is opened, whose panel is made then. Undo and redo are the editor's.

import type { EditorDrawing } from "../editor/base.ts";
import { pictureSnapshot, type SavedEditor } from "../editor/snapshot.ts";
import type { MenuRequest, SaveRequest } from "../generated.ts";
import type { Model } from "../types.ts";
import {
  buttonElement,
  canFillScreen,
  fillScreen,
  iconElement,
  named,
  OWN_KEYS,
  pageElement,
  setText,
  viewOf,
} from "../ui/dom.ts";
import { SavedPictureMenu } from "../ui/saved_picture.ts";
import { Widget, widgetOf } from "../ui/widget.ts";
import { showInLanguage } from "../ui/words.ts";
import { nameControls } from "./accessible_names.ts";
import { PanesFoot } from "./foot.ts";
import { SidePanel } from "./side_panel.ts";

const ICONS = {
  undo: "M6 3L3 6l3 3M3 6h6a3.5 3.5 0 0 1 0 7H6",
  redo: "M10 3l3 3-3 3M13 6H7a3.5 3.5 0 0 0 0 7h3",
  full: "M2.5 6V2.5H6M10 2.5h3.5V6M13.5 10v3.5H10M6 13.5H2.5V10",
  alone: "M9.5 2.5h4v4M13.5 2.5L9 7M6.5 13.5h-4v-4M2.5 13.5L7 9",
  camera: "M2.5 5h2.3l1-1.5h4.4l1 1.5h2.3v8h-11zM8 6.5a2.4 2.4 0 1 1-.01 0",
  help: "M5.7 5.9a2.3 2.3 0 1 1 3.4 2c-.8.5-1.1.9-1.1 1.8M8 12.2v.1",
};
const MENUS = [
  ["history", "History"],
  ["examples", "Examples"],
  ["export", "Export"],
] as const;
const PANES = ["picture", "volume"] as const;
const NEARLY_SQUARE = 1.25; // width by height of a picture up to which two are side by side

/** The head of one view of a studio. */
class StudioHead extends Widget {
  name: HTMLElement;
  facts: HTMLSpanElement;
  undo: HTMLButtonElement;
  redo: HTMLButtonElement;
  menus: Map<MenuRequest["name"], HTMLButtonElement>;
  opener: HTMLButtonElement;
  saver: HTMLButtonElement;
  full: HTMLButtonElement;
  help: HTMLButtonElement;
  side: SidePanel | null = null;
  foot: PanesFoot | null = null;
  arrivals: MutationObserver;
  frame = 0; // of the next arrangement
  framed: Model | null = null; // of the editor whose picture the panes are arranged for
  sizes: ResizeObserver;

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-head", { role: "toolbar", "aria-label": "Studio", ...OWN_KEYS });
    el.classList.add("dnb-head-host");
    this.name = pageElement("strong", "dnb-head-name", this.root, { translate: "no" });
    this.facts = pageElement("span", "dnb-head-facts", this.root);
    pageElement("span", "dnb-head-gap", this.root);
    this.undo = this.#icon("undo", () => this.#travel("undo"));
    this.redo = this.#icon("redo", () => this.#travel("redo"));
    this.menus = new Map(
      MENUS.map(([key, label]) => {
        const button = this.#button(label, () => this.toggleMenu(key));
        button.setAttribute("aria-haspopup", "true");
        button.setAttribute("aria-expanded", "false");
        pageElement("span", "dnb-head-arrow", button, { "aria-hidden": "true" }, "\u25be");
        return [key, button];
      }),
    );
    this.opener = this.#button("Open", () => this.open());
    this.saver = this.#button("Save", () => this.save());
    this.saver.classList.add("dnb-save");
    this.full = this.#icon("full", () => fillScreen(this.studio), "Full screen");
    this.full.hidden = !canFillScreen();
    this.help = this.#icon("help", () => this.#editor?.commands.run("help", null), "Keys and gestures (?)");
    this.onChange(["name", "facts", "history", "unsaved", "tip"], () => this.draw());
    // In the capture phase: the host's listeners may end the event; they still receive it, so a notebook is saved too.
    this.listen(window, "keydown", (event) => this.#key(event), { capture: true });
    this.listen(window, "pointerdown", (event) => this.#press(event), { capture: true });
    this.listen(window, "click", (event) => {
      this.#dismiss(event);
      this.#closeExamples(event);
    });
    this.listen(window, "change", (event) => this.#returnFocus(event));
    const { signal } = this.closing;
    this.arrivals = new MutationObserver(() => this.#waitUntilLoaded());
    // In the next frame: what is arranged changes the sizes that are observed.
    this.sizes = new ResizeObserver(() => this.#schedule());
    this.sizes.observe(el);
    this.draw();
    requestAnimationFrame(() => {
      if (this.studio && !signal.aborted) this.arrivals.observe(this.studio, { subtree: true, childList: true });
      this.#waitUntilLoaded();
      if (this.studio && !signal.aborted) this.#showWords(this.studio, signal);
      if (this.studio && !signal.aborted) nameControls(this.studio, signal);
    });
  }

  /** Show the whole studio in the language of the head. */
  #showWords(studio: HTMLElement, signal: AbortSignal) {
    signal.addEventListener("abort", showInLanguage(studio, this.model.get("words"), this.model.get("language")));
  }

  /** The studio around it, once it is in the document. */
  get studio(): HTMLElement | null {
    return this.host.closest(".dnb-studio");
  }

  /** The editor that is shown, or would be if its pane were. */
  get #editor(): EditorDrawing | undefined {
    const all = [...(this.studio?.querySelectorAll(".dnb-studio-panes .dnb-editor:not(.dnb-sp-viewer)") ?? [])];
    const shown = all.find((element) => element instanceof HTMLElement && element.offsetWidth > 0) ?? all[0];
    return viewOf<EditorDrawing>(shown);
  }

  /** Choose files; what becomes of them is decided in Python. */
  open() {
    const chooser = this.studio?.querySelector(".dnb-studio-open .dnb-fi-chooser");
    if (chooser instanceof HTMLInputElement) chooser.click();
  }

  save() {
    this.model.send({ type: "save" } satisfies SaveRequest);
  }

  /** Open a menu and close the others; an open one is closed. */
  toggleMenu(key: string = "") {
    for (const [name, button] of this.menus) {
      const menu = this.studio?.querySelector(`.dnb-menu-${name}`),
        isOpen = name === key && !menu?.classList.contains("dnb-menu-open");
      menu?.classList.toggle("dnb-menu-open", isOpen);
      if (isOpen) this.model.send({ type: "menu", name } satisfies MenuRequest);
      button.setAttribute("aria-expanded", String(isOpen));
    }
  }

  /** More of the studio is loaded: until its panel and its editor are there. */
  #waitUntilLoaded() {
    this.#addSidePanel();
    this.arrange();
    if (this.side && this.#editor) this.arrivals.disconnect();
  }

  /** The splitter and the stored state of the panel, once it is loaded. */
  #addSidePanel() {
    const [body, panel] = [".dnb-studio-body", ".dnb-studio-panel"].map((name) => this.studio?.querySelector(name));
    if (this.side || this.closing.signal.aborted || !(body instanceof HTMLElement) || !(panel instanceof HTMLElement))
      return;
    this.side = new SidePanel(body, panel);
  }

  #schedule() {
    cancelAnimationFrame(this.frame);
    this.frame = requestAnimationFrame(() => this.arrange());
  }

  /** Picture and volume side by side or one above the other, whichever shows the object larger. */
  arrange() {
    const panes = this.studio?.querySelector(".dnb-studio-panes");
    if (!(panes instanceof HTMLElement) || !panes.offsetWidth) return;
    for (const name of PANES) this.#addAlone(panes, name);
    const editor = this.#editor,
      raster = editor?.model.get("raster");
    this.foot ??= new PanesFoot(panes, this.sizes, () => this.#schedule());
    this.foot.arrange();
    if (!editor) return;
    this.#follow(editor.model);
    if (!raster?.shape) {
      panes.classList.add("dnb-panes-stacked");
      return;
    } // three pictures of space: the whole width
    const [a0, a1, b0, b1] = editor.model.get("subject") ?? [],
      isFramed = b1 !== undefined,
      width = isFramed ? a1 - a0 : raster.shape[1] * raster.spacing[0],
      height = isFramed ? b1 - b0 : raster.shape[0] * raster.spacing[1],
      w = panes.clientWidth,
      h = panes.clientHeight;
    const beside = Math.min(w / 2 / width, h / height),
      above = Math.min(w / width, h / 2 / height);
    panes.classList.toggle("dnb-panes-stacked", above > beside && width / height > NEARLY_SQUARE);
  }

  /** Arrange the panes again with a picture of another shape, not only when something else happens to the page. */
  #follow(model: Model) {
    if (this.framed === model) return;
    this.framed = model;
    const changed = () => {
      if (this.framed === model) this.#schedule();
    };
    for (const name of ["change:raster", "change:subject"]) {
      model.on(name, changed);
      this.closing.signal.addEventListener("abort", () => model.off(name, changed));
    }
  }

  /** A button in the title of a pane that gives it the place of both; a double click on the title does so too. */
  #addAlone(panes: HTMLElement, name: (typeof PANES)[number]) {
    const title = panes.querySelector(`.dnb-pane-${name} > .dnb-pane-head`);
    if (!(title instanceof HTMLElement) || title.querySelector(".dnb-pane-alone")) return;
    const toggle = () => show(!panes.classList.contains(`dnb-panes-${name}`));
    const button = buttonElement("dnb-pane-alone", title, iconElement(ICONS.alone), toggle);
    if (name === "picture") this.#addCamera(title);
    const show = (isAlone: boolean) => {
      for (const other of PANES) panes.classList.toggle(`dnb-panes-${other}`, isAlone && other === name);
      for (const other of panes.querySelectorAll(".dnb-pane-alone:not(.dnb-pane-camera)"))
        other.setAttribute("aria-pressed", "false");
      button.setAttribute("aria-pressed", String(isAlone));
      button.title = isAlone ? "Picture and volume" : `Only the ${name}`;
      button.setAttribute("aria-label", `Only the ${name}`);
    };
    const { signal } = this.closing;
    title.addEventListener(
      "dblclick",
      ({ target }) => {
        if (target === title) toggle();
      },
      { signal },
    );
    signal.addEventListener("abort", () => {
      show(false);
      button.remove();
    });
    show(false);
  }

  /** The camera of the picture, next to the button that gives its pane the place of both. */
  #addCamera(title: HTMLElement) {
    const words = "Save a picture of the picture pane (PNG)";
    const opener = buttonElement(
      "dnb-pane-alone dnb-pane-camera",
      title,
      iconElement(ICONS.camera),
      () => menu.toggle(),
      named(words),
    );
    const menu: SavedPictureMenu = new SavedPictureMenu(
      opener,
      title,
      () => `${this.model.get("name")} picture`,
      async (wanted) => {
        const editor = this.#editor;
        return editor && "parts" in editor ? pictureSnapshot(editor.parts as SavedEditor, wanted) : null;
      },
      (message) => this.#editor?.messages.show(message, true),
    );
    this.closing.signal.addEventListener("abort", () => {
      menu.close();
      menu.root.remove();
      opener.remove();
    });
  }

  close() {
    super.close();
    this.arrivals.disconnect();
    this.side?.close();
    this.foot?.close();
    this.sizes.disconnect();
    cancelAnimationFrame(this.frame);
  }

  #button(label: string, act: () => void) {
    return buttonElement("dnb-head-button", this.root, label, act);
  }

  #icon(icon: keyof typeof ICONS, act: () => void, tip: string = "") {
    const name = `dnb-head-button dnb-head-icon dnb-head-${icon}`;
    return buttonElement(name, this.root, iconElement(ICONS[icon]), act, named(tip));
  }

  #travel(way: "undo" | "redo") {
    this.#editor?.commands.run(way, null);
  }

  #key(event: KeyboardEvent) {
    const { target } = event,
      studio = target instanceof Element ? target.closest(".dnb-studio") : null;
    if (!studio?.contains(this.host)) return;
    if (event.key === "Escape") this.toggleMenu();
    const isCommand = (event.ctrlKey || event.metaKey) && !event.shiftKey && !event.altKey;
    if (!isCommand || event.key.toLowerCase() !== "s") return;
    event.preventDefault(); // else the browser would offer to save the page
    if (!event.repeat) this.save();
  }

  /** A press outside an open menu closes it. */
  #press({ target }: PointerEvent) {
    const isInside = target instanceof Element && (this.root.contains(target) || target.closest(".dnb-studio-menu"));
    if (!isInside) this.toggleMenu();
  }

  /** An example that was chosen is to be seen, and the next choice is another one: its menu closes. */
  #closeExamples({ target }: MouseEvent) {
    const button = target instanceof Element ? target.closest(".dnb-menu-examples .jupyter-button") : null;
    if (button && this.studio?.contains(button)) this.toggleMenu();
  }

  /** After a choice with the pointer in a menu over the panes the keys are the picture's again. */
  #returnFocus({ target }: Event) {
    const isOurs =
      target instanceof HTMLSelectElement && this.studio?.contains(target) && target.closest(".dnb-pane-head");
    if (isOurs && !target.matches(":focus-visible")) this.#editor?.stage.focus();
  }

  /** A message that its user has read is removed, until Python has another one. */
  #dismiss({ target }: MouseEvent) {
    const button = target instanceof Element ? target.closest(".dnb-message-close") : null;
    if (button && this.studio?.contains(button)) button.parentElement?.remove();
  }

  draw() {
    const { model } = this,
      { undo = "", redo = "" } = model.get("history") ?? {};
    setText(this.name, model.get("name"));
    setText(this.facts, model.get("facts"));
    this.opener.title =
      "Open a volume, labels and their names, landmarks, or a session; or drop the file on the studio";
    for (const [button, words, label] of [
      [this.undo, undo, "Undo"],
      [this.redo, redo, "Redo"],
    ] as const) {
      button.disabled = !words;
      button.title = words ? `${label}: ${words}` : `Nothing to ${label.toLowerCase()}`;
      button.setAttribute("aria-label", button.title);
    }
    const isUnsaved = Boolean(model.get("unsaved")),
      tip = model.get("tip") || "";
    this.saver.title = isUnsaved ? `There are unsaved edits. ${tip}` : tip;
    this.saver.setAttribute("aria-label", isUnsaved ? "Save; there are unsaved edits" : "Save");
    this.saver.classList.toggle("dnb-save-unsaved", isUnsaved);
  }
}

export default widgetOf(StudioHead);
