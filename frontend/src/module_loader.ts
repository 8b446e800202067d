// The module of each widget in a kernel of Jupyter: it takes the widget's bundle from a map of the page.
//
// anywidget imports the text of a module anew for every model, and a browser holds what it has imported until the page
// is left. Here a page imports a bundle once. Its script and its style sheet are in a model of their own, which all
// widgets of a kernel share; bundles of another version of the package have other digests.

import { releaseWhenClosed } from "./sync/closed_models.ts";
import type { Model } from "./types.ts";
import type { AnyWidget } from "./ui/words.ts";

type Modules = Map<string, Promise<{ default: AnyWidget }>>;

const KEY = Symbol.for("deformnb.modules");

function importText(text: string) {
  const url = URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
  return import(url).finally(() => URL.revokeObjectURL(url));
}

/** As anywidget does: one element for each class of widgets, whose text is of the version shown last. */
function setStyle(id: string, text: string) {
  let style = document.querySelector(`style[id="${id}"]`);
  if (style?.textContent === text) return;
  style ??= document.head.appendChild(Object.assign(document.createElement("style"), { id }));
  style.textContent = text;
}

async function loadWidget(model: Model) {
  const page = globalThis as { [KEY]?: Modules };
  page[KEY] ??= new Map();
  const modules = page[KEY];
  const source: Model = await model.widget_manager.get_model(model.get("module").replace("IPY_MODEL_", ""));
  setStyle(model.get("_anywidget_id"), source.get("style"));
  const digest = source.get("digest");
  const loaded = modules.get(digest) ?? importText(source.get("script"));
  modules.set(digest, loaded);
  loaded.catch(() => modules.delete(digest)); // the next model tries again
  return (await loaded).default;
}

/** anywidget calls it once for each model, and initializes the model before it renders a view. */
export default (): AnyWidget => {
  let widget: AnyWidget;
  return {
    async initialize(given) {
      releaseWhenClosed(given.model);
      widget = await loadWidget(given.model);
      return widget.initialize?.(given);
    },
    render: (given) => widget.render(given),
  };
};
