// Boxes of widgets: elements for a tree of boxes, tabs and folds, with the views of ipywidgets' and our own widgets in
// them. A box has the class names of ipywidgets' boxes, and caches its element and its views while it is in the tree.
//
// Messages to Python: the tab that was chosen, the section that was opened or closed. They are shown immediately, and
// Python adds contents to a section that it had not made before.

import type { BoxChoice } from "../generated.ts";
import type { ViewWithChildren } from "../sync/closed_models.ts";
import { releaseWhenClosed, removeChildViews } from "../sync/closed_models.ts";
import type { Model } from "../types.ts";
import { buttonElement, pageElement, setAttributes } from "../ui/dom.ts";
import { widgetOf } from "../ui/widget.ts";

/** A box as Python describes it; a child is a box, or the index of a widget in the trait "contents". */
interface BoxNode {
  id: number;
  kind: "box" | "tabs" | "fold";
  classes: string[];
  style: Record<string, string>;
  shown: boolean;
  children: (BoxNode | number)[];
  titles?: string[];
  selected?: number | null;
}

/** A view of ipywidgets, as far as it is used here. */
interface WidgetView extends ViewWithChildren {
  el: HTMLElement;
  luminoWidget: { processMessage: (message: object) => void };
  remove: () => void;
}

/** A widget manager, of which anywidget's types have less. */
interface WidgetManager {
  get_model: (id: string) => Promise<Model>;
  create_view: (model: Model) => Promise<WidgetView>;
}

const BOX = ["lm-Widget", "lm-Panel", "jupyter-widgets", "widget-container", "widget-box"];
const LATE = "dnb-late"; // class of a box whose contents Python has yet to make
const WAITING = "Waiting for Python \u2026";

let made = 0; // elements with ids, in this page

/** Lumino's message of this type: a widget in an element that is none of Lumino's receives it from here. */
function notify({ luminoWidget }: WidgetView, type: string) {
  luminoWidget.processMessage({ type, isConflatable: false, conflate: () => false });
}

function removeView(view: WidgetView) {
  view.remove();
  removeChildViews(view);
}

/** The place of a widget: an empty comment until its view is made. */
class WidgetPlace {
  node: ChildNode = document.createComment("");
  view: WidgetView | null = null;
  isGone = false;

  constructor(model: Model, reference: string) {
    this.#show(model, reference).catch((error) => {
      if (!this.isGone) console.error(error);
    });
  }

  async #show({ widget_manager }: Model, reference: string) {
    const manager = widget_manager as unknown as WidgetManager;
    const model = await manager.get_model(reference.replace("IPY_MODEL_", ""));
    releaseWhenClosed(model);
    const view = await manager.create_view(model);
    if (this.isGone) {
      removeView(view);
      return;
    }
    this.view = view;
    notify(view, "before-attach");
    this.node.replaceWith(view.el);
    this.node = view.el;
    notify(view, "after-attach"); // ipywidgets sets layout and style now
  }

  remove() {
    this.isGone = true;
    if (this.view) notify(this.view, "before-detach");
    this.node.remove();
    if (!this.view) return;
    notify(this.view, "after-detach");
    removeView(this.view);
  }
}

/** The element of a box, and its contents. */
class BoxPlace {
  data: BoxNode | null = null;

  /** Headings of tabs and sections. */
  headings: HTMLButtonElement[] = [];

  /** The index of the child that is shown, of tabs and sections. */
  selected: number | null = null;

  widgets: Map<string, WidgetPlace> = new Map();
  waiting: HTMLElement | null = null;

  constructor(readonly root: HTMLElement) {
    root.classList.add(...BOX);
  }

  remove() {
    for (const widget of this.widgets.values()) widget.remove();
    this.root.remove();
  }
}

class BoxesView {
  top: BoxPlace;
  places: Map<number, BoxPlace> = new Map();
  draw: () => void;
  isDue = false;

  constructor(
    readonly model: Model,
    el: HTMLElement,
  ) {
    this.top = new BoxPlace(el);
    el.classList.add("widget-vbox");
    this.draw = () => {
      if (this.isDue) return; // tree and contents change together
      this.isDue = true;
      queueMicrotask(() => {
        this.isDue = false;
        this.#draw();
      });
    };
    for (const name of ["tree", "contents"]) model.on(`change:${name}`, this.draw);
    this.#draw();
  }

  close() {
    for (const name of ["tree", "contents"]) this.model.off(`change:${name}`, this.draw);
    this.isDue = true; // nothing more is drawn
    for (const place of [this.top, ...this.places.values()]) {
      for (const widget of place.widgets.values()) widget.remove();
    }
    for (const place of this.places.values()) place.root.remove();
  }

  #draw() {
    const tree: BoxNode | undefined = this.model.get("tree"),
      contents: string[] = this.model.get("contents") ?? [];
    if (!tree?.children) return;
    const there = new Set<number>();
    const collect = ({ id, children }: BoxNode) => {
      there.add(id);
      for (const child of children) if (typeof child !== "number") collect(child);
    };
    collect(tree);
    for (const [id, place] of this.places) {
      if (there.has(id)) continue;
      place.remove();
      this.places.delete(id);
    }
    this.#fill(this.top, tree, contents);
  }

  #fill(place: BoxPlace, data: BoxNode, contents: string[]) {
    const { root, widgets } = place,
      before = place.data;
    place.data = data;
    if (before) {
      root.classList.remove(...before.classes.filter((name) => !data.classes.includes(name)));
      for (const name of Object.keys(before.style)) if (!(name in data.style)) root.style.removeProperty(name);
    }
    root.classList.add(...data.classes);
    root.classList.toggle("dnb-hidden", !data.shown);
    for (const [name, value] of Object.entries(data.style)) root.style.setProperty(name, value);
    const references = new Set(data.children.map((child) => (typeof child === "number" ? contents[child] : undefined)));
    for (const [reference, widget] of widgets) {
      if (references.has(reference)) continue;
      widget.remove();
      widgets.delete(reference);
    }
    const children = data.children.map((child) => {
      if (typeof child === "number") return this.#widget(place, contents[child] ?? "");
      const inner = this.places.get(child.id) ?? new BoxPlace(document.createElement("div"));
      this.places.set(child.id, inner);
      this.#fill(inner, child, contents);
      return inner.root;
    });
    this.#arrange(place, [...this.#headings(place, data), ...this.#waiting(place, data), ...children]);
    // Changes by Python are shown; a choice of the user that it does not know yet is left unchanged.
    if (data.titles && (!before || before.selected !== data.selected)) place.selected = data.selected ?? null;
    if (data.titles) this.#select(place);
  }

  #widget({ widgets }: BoxPlace, reference: string) {
    const widget = widgets.get(reference) ?? new WidgetPlace(this.model, reference);
    widgets.set(reference, widget);
    return widget.node;
  }

  /** Put elements into this order; others of the box, such as a splitter, stay where they are. */
  #arrange(place: BoxPlace, nodes: Node[]) {
    const own = new Set(nodes);
    let at = place.root.firstChild;
    for (const node of nodes) {
      while (at && !own.has(at)) at = at.nextSibling;
      if (node === at) at = at.nextSibling;
      else place.root.insertBefore(node, at);
    }
  }

  #waiting(place: BoxPlace, { classes }: BoxNode) {
    if (!classes.includes(LATE)) {
      place.waiting?.remove();
      place.waiting = null;
      return [];
    }
    place.waiting ??= pageElement("div", "dnb-waiting", null, { role: "status" }, WAITING);
    return [place.waiting];
  }

  /** The list of tabs, or the heading of a section. */
  #headings(place: BoxPlace, { kind, titles = [] }: BoxNode): HTMLElement[] {
    if (!place.headings.length && titles.length) {
      const list = pageElement("div", kind === "tabs" ? "dnb-tab-list" : "dnb-section-heading");
      if (kind === "tabs") list.setAttribute("role", "tablist");
      place.headings = titles.map((title, index) => {
        const choose = () => this.#choose(place, kind === "fold" && place.selected === index ? null : index);
        const words = pageElement("span", "", null, {}, title);
        const heading = buttonElement(kind === "tabs" ? "dnb-tab" : "dnb-section-head", list, words, choose);
        if (kind === "tabs") setAttributes(heading, { role: "tab", id: `dnb-tab-${++made}` });
        else words.before(pageElement("span", "dnb-section-arrow", null, { "aria-hidden": "true" }));
        return heading;
      });
      if (kind === "tabs") list.addEventListener("keydown", (event) => this.#key(place, event));
    }
    const list = place.headings[0]?.parentElement;
    return list ? [list] : [];
  }

  #choose(place: BoxPlace, index: number | null) {
    if (!place.data || index === place.selected) return;
    place.selected = index;
    this.#select(place);
    this.model.send({ type: "choose", box: place.data.id, index } satisfies BoxChoice);
  }

  #key(place: BoxPlace, event: KeyboardEvent) {
    const last = place.headings.length - 1,
      at = place.selected ?? 0;
    const to: Record<string, number> = {
      ArrowLeft: at ? at - 1 : last,
      ArrowRight: at < last ? at + 1 : 0,
      Home: 0,
      End: last,
    };
    const index = to[event.key];
    if (index === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    this.#choose(place, index);
    place.headings[index]?.focus();
  }

  /** Show the child that is selected, and no other. */
  #select(place: BoxPlace) {
    const { data, headings, selected } = place;
    const panels = (data?.children ?? []).map((child) =>
      typeof child === "number" ? undefined : this.places.get(child.id)?.root,
    );
    panels.forEach((panel, index) => {
      panel?.classList.toggle("dnb-unselected", index !== selected);
    });
    headings.forEach((heading, index) => {
      const isSelected = index === selected,
        panel = panels[index];
      if (panel && !panel.id) panel.id = `dnb-panel-${++made}`;
      if (panel) heading.setAttribute("aria-controls", panel.id);
      if (data?.kind !== "tabs") {
        heading.setAttribute("aria-expanded", String(isSelected));
        return;
      }
      setAttributes(heading, { "aria-selected": isSelected, tabindex: isSelected ? 0 : -1 });
      if (panel) setAttributes(panel, { role: "tabpanel", "aria-labelledby": heading.id });
    });
  }
}

export default widgetOf(BoxesView);
