// State that the widgets in a window share without the kernel: the live points of an editor, by the editor's uid.
//
// A front end gives each widget a proxy of its model, never the same object twice, so nothing can be stored on the
// model itself. An editor therefore has a trait `uid`, and its bus is found by that name in the window:
//
//   const bus = busOf(editorModel);              the same EventTarget for all callers, made by the first call
//   bus.addEventListener("deformnb:points", ...) event.detail: PointsDetail
//   bus.latest                                   the last detail, or null before the editor has drawn anything
//
// A listener need not fit again: the detail holds the result of layeredFit.

import type { Bus, BusEvents, FitSettings, Model, Point, PointsDetail } from "../types.ts";

const KEY = Symbol.for("deformnb.widgets");

const shared: Record<symbol, Map<string, Bus> | undefined> = Object(globalThis);

/** The bus of an editor or a player. */
export function busOf(model: Model): Bus {
  const buses = shared[KEY] ?? new Map(),
    uid = model.get("uid");
  shared[KEY] = buses;
  const bus = buses.get(uid) ?? Object.assign(new EventTarget(), { latest: null, owners: 0 });
  buses.set(uid, bus);
  Object.assign(model, { deformnb: bus }); // where the front end gives the model itself, this is the short path
  return bus;
}

/** The points that a window holds for an editor: an edit is there before Python has received it. */
export function pointsOf(bus: Bus, model: Model): Point[] {
  bus.sender?.receive();
  return bus.sender?.points ?? model.get("points");
}

export function publishPoints(bus: Bus, detail: PointsDetail) {
  bus.latest = detail;
  bus.dispatchEvent(new CustomEvent("deformnb:points", { detail }));
}

/** Traits of an editor that its fit depends on, other than the points. */
export const FIT_TRAITS = ["settings", "lone_support", "cuts", "cut_rule", "parts"];

/** The settings of a fit with the shapes, as the traits of an editor hold them. */
export function settingsOf(model: Model): FitSettings {
  const { settings, ...others } = Object.fromEntries(FIT_TRAITS.map((name) => [name, model.get(name)]));
  return { ...settings, ...others };
}

/**
 * Hold a bus. It exists while it has holders: the editor's model and its followers. Views open and close in between.
 */
export function holdBus(bus: Bus) {
  bus.owners += 1;
}

export function releaseBus(bus: Bus, uid: string) {
  bus.owners -= 1;
  if (bus.owners <= 0) shared[KEY]?.delete(uid);
}

/**
 * A widget of the window that another one follows, chosen by a reference; its bus is held until another is chosen.
 */
export class FollowedModel {
  reference: string | Model | null = null;

  /** Functions that end with it */
  ends: (() => void)[] = [];

  #ticket: object | null = null; // of the reference that is followed

  /** @param owner a model whose manager finds the others */
  constructor(readonly owner: Model) {}

  /** Null for none, or if another one is chosen meanwhile. */
  async choose(reference: string | Model | null): Promise<{ model: Model; bus: Bus } | null> {
    this.end();
    this.reference = reference;
    if (!reference) return null;
    const ticket = {};
    this.#ticket = ticket;
    const model =
      typeof reference === "string"
        ? await this.owner.widget_manager.get_model(reference.replace("IPY_MODEL_", ""))
        : reference;
    if (this.#ticket !== ticket) return null;
    const bus = busOf(model),
      uid = model.get("uid");
    holdBus(bus); // its own view may be closed and opened again
    this.ends.push(() => releaseBus(bus, uid));
    return { model, bus };
  }

  /** Calls a function at each event of a bus until another widget is chosen. */
  hear<Name extends keyof BusEvents>(bus: Bus, name: Name, heard: (event: CustomEvent<BusEvents[Name]>) => void) {
    const listener = heard as (event: Event) => void;
    bus.addEventListener(name, listener);
    this.ends.push(() => bus.removeEventListener(name, listener));
  }

  end() {
    for (const step of this.ends.splice(0).reverse()) step();
    this.#ticket = this.reference = null;
  }
}
