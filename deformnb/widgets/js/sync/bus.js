// What widgets of one page share without the kernel: the live points of an editor, by the editor's uid. No DOM.
//
// A front end hands each widget a proxy of its model, never the same object twice, so nothing can be stored on the
// model itself. An editor therefore has a trait `uid`, and its bus is found under that name on the page:
//
//   const bus = busOf(editorModel);              the same EventTarget for everyone who asks, made when first asked for
//   bus.addEventListener("deformnb:points", ...) event.detail = {points, settings, layered, fit,
//                                                phase: "move" | "end"}
//   bus.latest                                   the last detail, or null before the editor has drawn anything
//
// `layered` is what layeredFit made of points and settings (null where they cannot be fitted): a listener need not fit
// again. `fit` is its only fit where there are no cuts, else null.

export function busOf(model) {
  const key = Symbol.for("deformnb.widgets");
  const buses = (globalThis[key] ??= new Map());
  const uid = model.get("uid");
  if (!buses.has(uid)) buses.set(uid, Object.assign(new EventTarget(), { latest: null, owners: 0 }));
  const bus = buses.get(uid);
  model.deformnb = bus; // where the front end hands out the model itself, this is the short way
  return bus;
}

// The points that a window holds for an editor: an edit is there before Python has heard of it.
export function pointsOf(bus, model) {
  bus.sender?.receive();
  return bus.sender?.points ?? model.get("points");
}

export function publishPoints(bus, detail) {
  bus.latest = detail;
  bus.dispatchEvent(new CustomEvent("deformnb:points", { detail }));
}

// Traits of an editor that its fit depends on, besides the points.
export const FIT_TRAITS = ["settings", "lone_support", "cuts", "cut_rule", "parts"];

// The settings of a fit with the shapes, as the traits of an editor hold them.
export function settingsOf(model) {
  const { settings, ...others } = Object.fromEntries(FIT_TRAITS.map((name) => [name, model.get(name)]));
  return { ...settings, ...others };
}

// A bus lives as long as someone holds it: the editor's model and whoever follows it. Views come and go in between.
export function holdBus(bus) {
  bus.owners += 1;
}

export function releaseBus(bus, uid) {
  bus.owners -= 1;
  if (bus.owners <= 0) globalThis[Symbol.for("deformnb.widgets")]?.delete(uid);
}
