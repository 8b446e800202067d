// The clip controls: a view's sliders in a separate cell.

import type { Model } from "../types.ts";

import { ClipSliders } from "./clip_sliders.ts";

async function render({ model, el }: { model: Model; el: HTMLElement }) {
  let sliders: ClipSliders | null = null;
  let turn = 0;
  const follow = async () => {
    turn += 1;
    const mine = turn,
      reference = model.get("view");
    const view =
      typeof reference === "string"
        ? await model.widget_manager.get_model(reference.replace("IPY_MODEL_", ""))
        : reference;
    if (turn !== mine) return; // another view came meanwhile, or the widget has been closed
    sliders?.close();
    sliders = view ? new ClipSliders(el, view) : null;
  };
  model.on("change:view", follow);
  await follow();
  return () => {
    turn += 1;
    model.off("change:view", follow);
    sliders?.close();
  };
}

export default { render };
