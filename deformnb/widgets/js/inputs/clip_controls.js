// The clip controls: a view's sliders in a cell of their own. Joined behind the files that widgets/inputs/clip_controls.py names.

import { ClipSliders } from "./clip_sliders.js";

async function render({ model, el }) {
  let sliders = null, ticket = null;
  const follow = async () => {
    const mine = (ticket = {}), reference = model.get("view");
    const view = typeof reference === "string"
      ? await model.widget_manager.get_model(reference.replace("IPY_MODEL_", "")) : reference;
    if (ticket !== mine) return; // another view came meanwhile, or the page has gone
    sliders?.close();
    sliders = view ? new ClipSliders(el, view) : null;
  };
  model.on("change:view", follow);
  await follow();
  return () => { ticket = null; model.off("change:view", follow); sliders?.close(); };
}

export default { render };
